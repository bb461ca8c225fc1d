"""Settings of runs that tests make without `calibrate`."""

from pathlib import Path

from swim2real.calibration import Problem, RunFolder, RunSettings, reference_fingerprint
from swim2real.simulation import Engine
from swim2real.trials import TrialSet

ENGINE = Engine("mujoco 0", "implicit", 0.001, ())


def run_settings(**chosen) -> RunSettings:
    """Resolved settings of a run of nothing in particular."""
    given = {"robot": "fish", "reference_fingerprint": "0", "engine": ENGINE, "first": "random", "starts": 1}
    return RunSettings(**{**given, "scale": "log", **chosen})


def settings_of(problem: Problem, reference: TrialSet, **chosen) -> RunSettings:
    """Resolved settings of a run of a problem."""
    return run_settings(
        robot=problem.robot.name, protocol=problem.protocol.name, start=problem.protocol.start,
        reference_fingerprint=reference_fingerprint(reference), engine=problem.engine, **chosen,
    )  # fmt: skip


def record_of(run: Path | RunFolder) -> list[dict]:
    """The record of a run as its lines have it."""
    folder = run if isinstance(run, RunFolder) else RunFolder(run)
    return [entry.model_dump(exclude_unset=True) for entry in folder.record()]
