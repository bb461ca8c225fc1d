"""Recordings by formula, of an arm seen from the side: what a VLM is told of them is known beforehand."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from markertrack.track import MarkerTrack
from recorded import PENDULUM
from swim2real.objective import Comparison, compare_playback, evidence, playback_target
from swim2real.optimizers import Candidate, Evaluation
from swim2real.robots.drives import TABLE, Drive
from swim2real.robots.robot import Robot, Sensor, Trials
from swim2real.trials import Signals, Trial

TIMES = 1.0 + np.arange(81) / 20  # from 1 to 5 s, windows of half a second
LENGTHS = np.array([0.0, 0.2, 0.4])  # m, of the markers from the base
HAND = Sensor("force", "N", 0.01)
ARM = replace(
    PENDULUM, name="arm", description="An arm with two links that hangs from a base.",
    marker_names=("base", "elbow", "hand"), trials=Trials({"torque": TABLE}, (HAND,), "rest"),
)  # fmt: skip
CART = replace(ARM, name="cart", trials=Trials({"wheel": Drive(offset=2.0)}, (), "markers", (0, 1), True), plane=(0, 1))


@dataclass(frozen=True)
class Swing:
    """A straight arm that swings about its base."""

    size: float = 0.1  # rad
    at: tuple[float, float] = (0.0, 0.0)  # m, of the base
    drift: float = 0.0  # m, by which the hand is off to the right at the end, from nothing at the start
    fade: float = 0.0  # m, by which it is off to the right at the start, until nothing at the end
    speed: float = 0.0  # m/s, at which all of it goes to the left
    force: float = 1.0  # N, that the sensor reads

    def trial(self, name: str, robot: Robot, divergence: str | None = None) -> Trial:
        since = TIMES - TIMES[0]
        angles = self.size * np.sin(2 * np.pi * since) - (np.pi / 2 if robot.recordings.frame is None else 0.0)
        positions = LENGTHS[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]
        positions += self.at
        share = since / since[-1]
        positions[:, -1, 0] += self.drift * share**2 + self.fade * (1 - share) ** 2
        positions[..., 0] -= self.speed * since[:, None]
        if divergence is not None:
            positions = np.full_like(positions, np.nan)
        sensors = Signals(TIMES, ("force",), np.full((TIMES.size, 1), self.force))
        positions = positions[:, : len(robot.marker_names)]
        return Trial(name, MarkerTrack(TIMES, positions), divergence=divergence, sensors=sensors)


def compared(
    pairs: Mapping[str, tuple[Swing, Swing | str]], robot: Robot = ARM, lost: tuple[int, ...] = ()
) -> Comparison:
    """Recordings by name, each real with its playback, or with the reason why there is none."""
    about, found = robot.recordings, []
    for name, (real, simulated) in pairs.items():
        trial = real.trial(name, robot)
        weights = np.ones(trial.track.confidence.shape)
        weights[:, list(lost)] = 0.0
        worths = {sensor.name: sensor.meters_per_unit for sensor in about.sensors}
        target = playback_target(trial, weights, about.frame, about.score_progress, worths)
        made = real.trial(name, robot, simulated) if isinstance(simulated, str) else simulated.trial(name, robot)
        found.append(compare_playback(target, made))
    return Comparison(tuple(found), "playback", None)


def evaluated(comparison: Comparison, robot: Robot = ARM) -> Evaluation:
    """Its evaluation, in the middle of the space."""
    failed = comparison.divergence is not None
    point = np.full(len(robot.space), 0.5)
    return Evaluation(Candidate(point), comparison.loss, failed, evidence(comparison))
