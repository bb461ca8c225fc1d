"""Reads a run folder for the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from swim2real.calibration import RunFolder
from swim2real.errors import RunError
from swim2real.report.kinds import read_sections
from swim2real.report.recorded_calls import read_calls
from swim2real.report.run import Json, ReportedRun, Sections, incumbent
from swim2real.robots.robot import Robot

_SAME_LOSS = 1e-5  # m, by which a loss may differ when the same parameters are simulated again


def read_run(path: str | Path, robot: Robot) -> ReportedRun:
    """Gathers a run.

    Args:
        path: Run folder.
        robot: That was calibrated.

    Raises:
        RunError: No run there, nothing evaluated yet, or a file is damaged.
        ParameterError: The run is of another robot.
    """
    folder = RunFolder(path)
    settings = folder.settings()
    entries: tuple[Json, ...] = tuple(folder.record())
    if not entries:
        raise RunError(
            f"run '{path}' has no evaluation on record yet, so there is nothing to report; go on with --resume"
        )
    best, space = incumbent(entries) or entries[0], robot.space
    space.check(best["values"], where=f"run '{path}'")
    outcome = folder.outcome()
    current = outcome is not None and abs(outcome["fit"]["loss"] - best["loss"]) <= _SAME_LOSS
    of_best: Json = outcome if outcome is not None and current else {}
    sections = read_sections(robot, folder, of_best)
    has_trials = (folder.path / sections.file).is_file()
    return ReportedRun(
        name=folder.path.resolve().name,
        robot=robot,
        settings=settings,
        space=replace(space, scale=settings.get("scale", space.scale)),
        entries=entries,
        fit=of_best.get("fit") or best["evidence"],
        held_out=of_best.get("held_out"),
        quality=(outcome or {}).get("trials") or {},
        sensitivity={one["name"]: one for one in of_best.get("sensitivity") or ()},
        marker_names=tuple((outcome or {}).get("marker_names") or robot.marker_names),
        unfinished=_unfinished(settings, len(entries), outcome is not None, current, has_trials, sections),
        calls=read_calls(folder.path, settings, entries),
        sections=sections,
    )


def _unfinished(
    settings: Json, done: int, ended: bool, current: bool, has_trials: bool, sections: Sections
) -> str | None:
    on_record = f"{done} of {settings.get('budget', '?')} evaluations are on record"
    first, second = sections.drawn
    if not ended:
        return (
            f"This run has not ended: {on_record}. The page shows what the record can tell. {first.capitalize()}, "
            f"{second}, held-out trials, track quality and the effect of each parameter are written when the run "
            f"ends; go on with --resume and make the report again."
        )
    if not current:
        return (
            f"This run went on after it had ended once, and has found better parameters since: {on_record}. "
            f"{first.capitalize()}, held-out trials and the effect of each parameter belong to the earlier ones and "
            f"are left out; finish the run with --resume and make the report again."
        )
    if not has_trials:
        return f"The run folder has no {sections.file}, so {first} and {second} are left out; --resume writes it again."
    return None
