"""The problem of recordings: real ones, and a simulator that plays them back them under their controls."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any

import numpy as np

from swim2real.calibration.problem import Problem
from swim2real.calibration.recording_pairs import save_recordings
from swim2real.calibration.run_folder import RunFolder
from swim2real.errors import TrialError
from swim2real.objective import Comparison, PlaybackComparison, PlaybackTarget, compare_playback
from swim2real.objective.evidence import rounded
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON
from swim2real.simulation import Engine, PlaybackSimulator, Rollout
from swim2real.tracking import unseen
from swim2real.trials import Trial, TrialSet

_ROUNDING = 1e-3  # s, of a table's time stamps


class PlaybackProblem(Problem):
    """Evaluates parameter values against recordings."""

    def __init__(self, reference: TrialSet, simulator: PlaybackSimulator, horizon: float | None = HORIZON) -> None:
        """Prepares the recordings to play back.

        Args:
            reference: Real trials.
            simulator: Simulator of the robot.
            horizon: Seconds of each trial that are compared, None for all.

        Raises:
            TrialError: The markers or sensors aren't the robot's, or a trial can't be played back.
        """
        super().__init__(simulator.robot, reference.trials, "playback", horizon)
        about = self.robot.recordings
        _check_markers(reference, self.robot)
        self.simulator = simulator
        self.lost = [unseen(trial.track) for trial in self.trials]
        self.targets: list[PlaybackTarget] = []
        self.rollouts: list[Rollout] = []
        for trial, lost in zip(self.trials, self.lost, strict=True):
            cut = trial.cut(horizon)
            weights = lost.weights[: cut.track.frame_count]
            worths = {sensor.name: sensor.meters_per_unit for sensor in about.sensors}
            target = PlaybackTarget(cut, weights, about.frame, about.score_progress, worths)
            for name in worths:
                target.readings(name)
            self.targets.append(target)
            self.rollouts.append(simulator.request(cut, weights))

    @property
    def engine(self) -> Engine:
        return self.simulator.engine

    def of(self, reference: TrialSet) -> PlaybackProblem:
        return PlaybackProblem(reference, self.simulator, self.horizon)

    def blocks(self) -> list[tuple[int, int]]:
        found: list[tuple[int, int]] = []
        for target in self.targets:
            track = target.trial.track
            found.append((track.frame_count, 2 * track.marker_count))
            found += [(len(target.readings(name).times), 1) for name in target.worths]
        return found

    def examined(self) -> dict[str, dict[str, Any]]:
        commanded = "table" in self.robot.recordings.controls.values()
        return {
            trial.name: rounded(
                {
                    "nominal_frequency": trial.nominal_frequency,
                    "meters_per_pixel": trial.meters_per_pixel,
                    "duration": trial.track.duration,
                    "frames": trial.track.frame_count,
                    "controls": [] if trial.controls is None else list(trial.controls.names),
                    "sensors": [] if trial.sensors is None else list(trial.sensors.names),
                    "lost_share": lost.lost_share,
                    "left_out_share": lost.left_out_share,
                    "usable": lost.usable,
                    "findings": lost.findings(self.robot.marker_names) + (_uncommanded(trial) if commanded else []),
                }
            )
            for trial, lost in zip(self.trials, self.lost, strict=True)
        }

    def tried(self, values: Values) -> dict[str, Any]:
        """Nothing: a playback starts where its recording did."""
        return {}

    def save(self, folder: RunFolder, fit: Comparison, held_out: Comparison | None) -> None:
        save_recordings(folder, fit, held_out)

    def _cost(self, index: int) -> float:
        return self.rollouts[index].trial.track.duration

    def _simulate_each(self, values: Values, order: Sequence[int]) -> Generator[Trial]:
        return self.simulator.simulate_each(values, [self.rollouts[i] for i in order])

    def _simulate_many(self, candidates: Sequence[Values]) -> list[TrialSet]:
        return self.simulator.simulate_many(candidates, self.rollouts)

    def _compared(self, index: int, simulated: Trial) -> PlaybackComparison:
        return compare_playback(self.targets[index], simulated)


def _uncommanded(trial: Trial) -> list[str]:
    """A sentence for each end of a trial that its controls don't reach, where they hold longer than between rows."""
    if trial.controls is None:
        return []
    rows, frames, found = trial.controls.times, trial.track.times, list[str]()
    if rows[0] > frames[1]:
        found.append(
            f"its controls begin at {rows[0]:g} s, its frames at {frames[0]:g} s; the first value is held until then"
        )
    if len(rows) > 1 and frames[-1] - rows[-1] > np.diff(rows).max() + _ROUNDING:
        found.append(
            f"its controls end at {rows[-1]:g} s, its frames at {frames[-1]:g} s; the last value is held from there on"
        )
    return found


def _check_markers(reference: TrialSet, robot: Robot) -> None:
    if reference.marker_names != robot.marker_names:
        raise TrialError(
            f"the reference has the markers {', '.join(reference.marker_names)}; robot '{robot.name}' has "
            f"{', '.join(robot.marker_names)}; name them alike, in the same order"
        )
