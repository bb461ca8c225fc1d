"""A finished run with its problem posed again, for studies of its best fit."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

from swim2real.calibration.file_models import RecordedEvaluation
from swim2real.calibration.problem import Problem
from swim2real.calibration.provenance import reference_fingerprint
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.run_settings import RunSettings
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot
from swim2real.trials import TrialSet
from swimbase.errors import RunError
from swimbase.store import source_at


@dataclass(frozen=True)
class FinishedRun:
    """A run, its problem and its evaluations.

    Attributes:
        folder: Folder of the run.
        settings: Recorded settings.
        problem: The fitted trials and a simulator, as in the run.
        space: Parameters on the run's scale.
        record: Evaluations that didn't fail.
    """

    folder: RunFolder
    settings: RunSettings
    problem: Problem
    space: ParameterSpace
    record: tuple[RecordedEvaluation, ...]

    @property
    def best(self) -> RecordedEvaluation:
        """The record's entry of the lowest loss, the first of several."""
        return min(self.record, key=lambda entry: entry.loss)

    def conditions(self) -> dict[str, object]:
        """Conditions that decide a loss, for the file of a study: robot, protocol, trials, reference and engine."""
        conditions = {
            "robot": self.settings.robot,
            "parameters": list(self.space.names),
            "scale": self.space.scale,
            "protocol": self.problem.protocol.name,
            "horizon": self.problem.horizon,
            "trials": [trial.name for trial in self.problem.trials],
            "reference_fingerprint": self.settings.reference_fingerprint,
            "engine": self.problem.engine.as_dict(),
        }
        return json.loads(json.dumps(conditions))  # as it will be when it is read back


def reopen(path: str | Path, reference: TrialSet, robot: Robot, threads: int | None = None) -> FinishedRun:
    """Reads a run and makes its problem again.

    Args:
        path: Run folder.
        reference: That the run was made with, held-out trials included.
        robot: Robot of the run.
        threads: Swims simulated at a time, None for all cores.

    Raises:
        RunError: No run there, nothing usable in it, or it was made with another robot, reference or engine.
    """
    folder = RunFolder(path)
    settings = folder.settings()
    if settings.robot != robot.name:
        raise RunError(f"run '{folder.path}' is of robot '{settings.robot}', not '{robot.name}'")
    if settings.reference_fingerprint != reference_fingerprint(reference):
        source = source_at(folder.path, settings.reference)
        raise RunError(
            f"run '{folder.path}' was made with another reference than this one of {len(reference)} trials; give the "
            f"one that it was made with" + (f", {source}" if source else "")
        )
    fitted, _ = reference.split(settings.hold_out)
    problem = Problem.with_settings(robot, fitted, replace(settings, threads=threads))
    note = problem.engine.difference(settings.engine.as_dict())
    if note:
        raise RunError(f"run '{folder.path}' was {note}; losses can't be compared, so make a new run")
    record = tuple(e for e in folder.record() if not e.failed)
    if not record:
        raise RunError(f"run '{folder.path}' has no evaluation that went well; calibrate first")
    space = replace(robot.space, scale=settings.resolved_scale)
    try:
        for entry in record:
            space.to_values(entry.point)
    except (KeyError, ValueError, TypeError) as error:
        raise RunError(f"the record of '{folder.path}' is damaged: {error!r}; begin a new run") from error
    return FinishedRun(folder, settings, problem, space, record)
