"""A calibration problem: real trials, checked and identified, and a simulator to compare with them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

from swim2real.errors import TrialError
from swim2real.objective import Comparison, Protocol, Target, TrialComparison, compare, compare_trial
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation import Simulator, Swim
from swim2real.tracking import Beat, TrackQuality, check_track, identify_beat
from swim2real.trials import Actuation, Trial, TrialSet

HORIZON = 4.0  # s, the prior code's
_ROUNDING = 1e-9  # an early stop must not hang on the order of a sum


@dataclass(frozen=True)
class RealTrial:
    """A real trial with what was found in it."""

    trial: Trial
    quality: TrackQuality
    beat: Beat


def examine(reference: TrialSet, robot: Robot) -> tuple[RealTrial, ...]:
    """Checks the tracks and identifies what drove each trial.

    Raises:
        TrialError: The markers aren't the robot's, or a trial shows no beat.
    """
    if len(reference.marker_names) != len(robot.marker_names):
        raise TrialError(
            f"the reference has {len(reference.marker_names)} markers ({', '.join(reference.marker_names)}); "
            f"robot '{robot.name}' has {len(robot.marker_names)} ({', '.join(robot.marker_names)})"
        )
    found: list[RealTrial] = []
    for trial in reference:
        quality = check_track(trial.track, robot.rest_markers)
        beat = identify_beat(trial.track, robot.swims.tail_markers, quality, trial.name)
        found.append(RealTrial(trial, quality, beat))
    return tuple(found)


class Problem:
    """Evaluates parameter values against real trials."""

    def __init__(
        self, robot: Robot, real: Sequence[RealTrial], simulator: Simulator, protocol: Protocol = "aligned",
        horizon: float | None = HORIZON,
    ) -> None:  # fmt: skip
        """Prepares the swims to simulate.

        Args:
            robot: What is calibrated.
            real: Examined trials.
            simulator: Of the same robot.
            protocol: `aligned`: identified frequency, steady state, phase, registration, weights. `paper`: nominal
                frequency, from rest, none of the others.
            horizon: Seconds of each trial that are compared, None for all.

        Raises:
            TrialError: The paper's protocol needs nominal frequencies and a trial has none.
        """
        if horizon is not None and not horizon > 0:
            raise TrialError(f"horizon is {horizon} s; it must be above 0")
        self.robot, self.real, self.simulator = robot, tuple(real), simulator
        self.protocol: Protocol = protocol
        self.horizon = horizon
        self.targets: list[Target] = []
        self.swims: list[Swim] = []
        for one in self.real:
            actuation = one.beat.actuation if protocol == "aligned" else Actuation(_nominal(one.trial))
            lead = actuation.period if protocol == "aligned" else 0.0
            self.targets.append(Target(one.trial, one.quality.weights, actuation.frequency, one.beat.frequency))
            self.swims.append(Swim(one.trial.name, actuation, one.trial.track.duration + lead))

    def evaluate(self, values: Values, stop_above: float | None = None) -> Comparison:
        """Simulates all trials and compares them with the real ones.

        Args:
            values: Of the candidate.
            stop_above: Stop as soon as the loss is certain to exceed this [m]. A trial's error can't be negative, so
                the sum over the trials so far bounds the loss from below. The trials are taken from the shortest period
                to the longest; how many it takes doesn't depend on threads.
        """
        if stop_above is None:
            return self.evaluate_many([values])[0]
        order = sorted(range(len(self.swims)), key=lambda i: self.swims[i].actuation.period)
        limit = stop_above * len(order) * (1 + _ROUNDING)
        found: dict[int, TrialComparison] = {}
        with closing(self.simulator.simulate_each(values, [self.swims[i] for i in order])) as simulated:
            for i, trial in zip(order, simulated, strict=True):
                found[i] = compare_trial(self.targets[i], trial, self.protocol, self.horizon)
                if trial.divergence or sum(one.loss(self.protocol) for one in found.values()) > limit:
                    break
        compared = tuple(found[i] for i in sorted(found))
        return Comparison(compared, self.protocol, self.horizon, len(order) - len(found))

    def evaluate_many(self, candidates: Sequence[Values]) -> list[Comparison]:
        """The same for several candidates in one batch."""
        simulated = self.simulator.simulate_many(candidates, self.swims)
        return [compare(self.targets, trials, self.protocol, self.horizon) for trials in simulated]


def _nominal(trial: Trial) -> float:
    if trial.nominal_frequency is None:
        raise TrialError(
            f"trial '{trial.name}' has no nominal frequency, which protocol 'paper' needs; "
            f"write it into reference.json or use protocol 'aligned'"
        )
    return trial.nominal_frequency
