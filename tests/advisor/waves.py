"""Robots that swim by formula: every amplitude, lag and speed of what a VLM is told is known beforehand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markertrack import frames
from markertrack.track import MarkerTrack
from swim2real.objective import Comparison, compare_steady, evidence, steady_target
from swim2real.optimizers import Candidate, Evaluation, Proposal, Round, Situation, Step
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.fish import FISH
from swim2real.trials import Trial

EEL_SPACE = ParameterSpace(
    (
        Parameter("grip", "-", 0.0, 10.0, "Grip in the water: more of it is faster.", 1.0, log_offset=0.1),
        Parameter("spring", "N·m/rad", 0.1, 5.0, "Stiffness of the only joint.", 0.5),
    )
)


def eel(count: int = 5):
    """A robot with two parameters. What it is built of doesn't matter here."""
    names = tuple(f"P{i}" for i in range(count))
    rest = np.column_stack([0.1 * np.arange(count), np.zeros(count)])
    return replace(
        FISH, name="eel", description="A swimming chain of links.", space=EEL_SPACE, marker_names=names,
        rest_markers=rest, marker_heights=np.zeros(count), links=(),
        trials=replace(FISH.swims, tail_markers=(count - 1,)),
    )  # fmt: skip


@dataclass(frozen=True)
class Wave:
    """A wave that runs along the markers from head to end."""

    frequency: float = 1.0  # Hz
    speed: float = 0.1  # m/s, forward
    amplitudes: tuple[float, ...] = (0.0, 0.0, 0.03, 0.06, 0.1)  # m, of each marker, sideways
    behind: tuple[float, ...] = (0.0, 0.0, 0.0, 20.0, 50.0)  # deg of a beat by which each marker comes later
    lost: tuple[int, ...] = ()  # markers that are never seen
    yaw: float = 0.0  # rad, by which the whole robot swings about its head

    def track(self, seconds: float, phase: float = 0.0) -> MarkerTrack:
        times = np.arange(round(seconds * 50) + 1) / 50
        angles = 2 * np.pi * self.frequency * times[:, None] + phase - np.radians(self.behind)
        behind = np.broadcast_to(0.1 * np.arange(len(self.amplitudes)), angles.shape)
        heading = self.yaw * np.cos(angles[:, :1])
        axes = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        positions = frames.composed(np.stack([behind, self.amplitudes * np.cos(angles)], axis=-1), axes)
        positions[:, :, 0] -= self.speed * times[:, None]
        positions[:, list(self.lost)] = np.nan
        return MarkerTrack(times, positions)


def compared_waves(pairs: Sequence[tuple[Wave, Wave | str]], protocol="aligned") -> Comparison:
    """Swims, each real with its simulated one, or with the reason why there is none."""
    found = []
    for i, (real, simulated) in enumerate(pairs):
        track = real.track(3.0, 0.0 if protocol == "paper" else 0.7)
        driven = real.frequency if isinstance(simulated, str) else simulated.frequency
        weights = np.isfinite(track.positions[:, :, 0]).astype(float)
        target = steady_target(
            Trial(f"swim{i}", track), weights, driven, real.frequency, 2.0, protocol == "motion"
        )  # fmt: skip
        if isinstance(simulated, str):
            swim = Trial(f"swim{i}", track, divergence=simulated)
        else:
            swim = Trial(f"swim{i}", simulated.track(3.0 + 1 / driven + 0.1))
        found.append(compare_steady(target, swim, fit_phase=protocol != "paper"))
    return Comparison(tuple(found), protocol, 2.0)


def evaluate(
    point: Sequence[float], pairs: Sequence[tuple[Wave, Wave | str]], protocol="aligned",
    loss: float | None = None,
) -> Evaluation:  # fmt: skip
    """The evaluation of such swims."""
    whole = compared_waves(pairs, protocol)
    failed = whole.divergence is not None
    known = whole.loss if loss is None else loss
    return Evaluation(Candidate(np.array(point)), known, failed, evidence(whole))


def start(evaluation: Evaluation) -> Situation:
    """The situation at the first round."""
    return Situation(evaluation, (), evaluation)


def after(first: Evaluation, *rounds: tuple[Proposal, Sequence[Evaluation]]) -> Situation:
    """The situation after rounds whose steps are given; the last step of a round counts if it is an improvement."""
    incumbent, done = first, []
    for proposal, steps in rounds:
        tried = tuple(Step(0.5**k, one) for k, one in enumerate(steps))
        better = steps[-1].loss < incumbent.loss and not steps[-1].failed
        done.append(Round(proposal, incumbent, tried, better))
        incumbent = steps[-1] if better else incumbent
    return Situation(incumbent, tuple(done), first)
