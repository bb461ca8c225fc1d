"""The problem of steady swims: real ones, checked and their beat identified, against a simulator of swims."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from swim2real.calibration.from_rest import from_rest
from swim2real.calibration.problem import Problem
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.swim_pairs import save_swims
from swim2real.errors import TrialError
from swim2real.objective import Comparison, Protocol, Target, TrialComparison, compare_trial
from swim2real.objective.evidence import rounded
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON, Start
from swim2real.simulation import Engine, Simulator, Swim
from swim2real.tracking import Beat, TrackQuality, check_track, identify_beat
from swim2real.trials import Actuation, Trial, TrialSet


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


class SwimProblem(Problem):
    """Evaluates parameter values against real swims."""

    def __init__(
        self, robot: Robot, real: Sequence[RealTrial], simulator: Simulator, protocol: Protocol = "aligned",
        horizon: float | None = HORIZON, start: Start = "speed",
    ) -> None:  # fmt: skip
        """Prepares the swims to simulate.

        Args:
            robot: What is calibrated.
            real: Examined trials.
            simulator: Of the same robot.
            protocol: `aligned`: identified frequency, steady state, phase, registration, weights. `paper`: nominal
                frequency, from rest, none of the others.
            horizon: Seconds of each trial that are compared, None for all.
            start: Of steady swims: at the real speed, or at rest. Both look for the steady cycle that follows.

        Raises:
            TrialError: The paper's protocol needs nominal frequencies and a trial has none.
        """
        super().__init__(robot, [one.trial for one in real], protocol, horizon)
        self.real, self.simulator = tuple(real), simulator
        self.start: Start = start
        self.targets: list[Target] = []
        self.swims: list[Swim] = []
        for one in self.real:
            actuation = one.beat.actuation if protocol == "aligned" else Actuation(_nominal(one.trial))
            if protocol == "aligned" and start == "rest":
                actuation = replace(actuation, start_speed=0.0)
            lead = actuation.period if protocol == "aligned" else 0.0
            self.targets.append(Target(one.trial, one.quality.weights, actuation.frequency, one.beat.frequency))
            self.swims.append(simulator.request(one.trial, actuation, lead))

    @property
    def engine(self) -> Engine:
        return self.simulator.engine

    def of(self, reference: TrialSet) -> SwimProblem:
        real = examine(reference, self.robot)
        return SwimProblem(self.robot, real, self.simulator, self.protocol, self.horizon, self.start)

    def blocks(self) -> list[tuple[int, int]]:
        shapes = [
            (target.trial.cut(self.horizon).track.frame_count, target.weights.shape[1]) for target in self.targets
        ]
        return [(frames, 2 * markers) for frames, markers in shapes]

    def examined(self) -> dict[str, dict[str, Any]]:
        return {one.trial.name: examined(one, self.robot.marker_names) for one in self.real}

    def tried(self, values: Values) -> dict[str, Any]:
        """How each trial's beat swims from rest."""
        found = from_rest(self.simulator, values, {swim.name: swim.actuation.frequency for swim in self.swims})
        return rounded({"from_rest": {name: swim.as_dict() for name, swim in found.items()}})

    def save(self, folder: RunFolder, fit: Comparison, held_out: Comparison | None) -> None:
        save_swims(folder, fit, held_out)

    def _cost(self, index: int) -> float:
        return self.swims[index].actuation.period

    def _simulate_each(self, values: Values, order: Sequence[int]) -> Generator[Trial]:
        return self.simulator.simulate_each(values, [self.swims[i] for i in order])

    def _simulate_many(self, candidates: Sequence[Values]) -> list[TrialSet]:
        return self.simulator.simulate_many(candidates, self.swims)

    def _compared(self, index: int, simulated: Trial) -> TrialComparison:
        return compare_trial(self.targets[index], simulated, self.protocol, self.horizon)


def examined(one: RealTrial, names: tuple[str, ...]) -> dict[str, Any]:
    """Quality and beat of a real trial, ready for JSON."""
    beat = one.beat
    return rounded(
        {
            "nominal_frequency": one.trial.nominal_frequency,
            "meters_per_pixel": one.trial.meters_per_pixel,
            "duration": one.trial.track.duration,
            "frames": one.trial.track.frame_count,
            "frequency": beat.frequency,
            "frequency_std": beat.frequency_std,
            "phase": beat.phase,
            "phase_std": beat.phase_std,
            "start_speed": beat.start_speed,
            "start_speed_std": beat.start_speed_std,
            "amplitude": beat.amplitude,
            "explained": beat.explained,
            "lost_share": one.quality.lost_share,
            "left_out_share": one.quality.left_out_share,
            "head_spread": one.quality.head_spread,
            "body_spread": one.quality.body_spread,
            "usable": one.quality.usable,
            "findings": one.quality.findings(names),
        }
    )


def _nominal(trial: Trial) -> float:
    if trial.nominal_frequency is None:
        raise TrialError(
            f"trial '{trial.name}' has no nominal frequency, which protocol 'paper' needs; "
            f"write it into reference.json or use protocol 'aligned'"
        )
    return trial.nominal_frequency
