"""A run folder, read for its page: what is on record, and the trials at the best parameters where it has ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from swim2real.calibration import RunFolder, RunSettings, SavedTrial, load_trials
from swim2real.calibration.convergence import never_beaten, still_falling
from swim2real.calibration.from_rest import backward_from_rest
from swim2real.calibration.run_folder import TRIALS
from swim2real.errors import RunError
from swim2real.parameters import ParameterSpace
from swim2real.report.calls import RecordedCalls, read_calls
from swim2real.robots.robot import Robot

Json = Mapping[str, Any]

_SAME_LOSS = 1e-5  # m, by which a loss may differ when the same parameters are simulated again


@dataclass(frozen=True)
class ReportedTrial:
    """A trial at the best parameters.

    Attributes:
        name: Name of the trial.
        held_out: Whether it was left out of the fit.
        figures: SI numbers as in an evaluation's evidence.
        quality: What was found in the real track; empty before a run ends.
    """

    name: str
    held_out: bool
    figures: Json
    quality: Json

    @property
    def diverged(self) -> bool:
        return bool(self.figures.get("divergence"))


@dataclass(frozen=True)
class ReportedRun:
    """A run as it is reported.

    Attributes:
        name: Name of the folder.
        robot: The robot that was calibrated.
        settings: Settings as recorded.
        space: On the run's scale.
        entries: The record, one entry an evaluation, at least one.
        fit: Figures of the best parameters on the fitted trials, in SI.
        held_out: The same on trials left out of the fit, None without any.
        quality: What was found in the real tracks, by trial.
        sensitivity: Sensitivity to each parameter, by name; empty where it wasn't determined.
        marker_names: M names.
        unfinished: What is missing and why, in sentences; None for a run that ended.
        calls: Calls of the advisor; None for a run that made none.
        saved: Trials at the best parameters by frequency and name; empty before a run ends.
        backward: A sentence that the best parameters don't swim forward from rest, and what to do; None where they do
            and where nobody tried.
    """

    name: str
    robot: Robot
    settings: RunSettings
    space: ParameterSpace
    entries: tuple[Json, ...]
    fit: Json
    held_out: Json | None
    quality: Json
    sensitivity: Json
    marker_names: tuple[str, ...]
    unfinished: str | None
    calls: RecordedCalls | None
    saved: tuple[SavedTrial, ...] = ()
    backward: str | None = None

    @property
    def first(self) -> Json:
        """The first evaluation's entry."""
        return self.entries[0]

    @cached_property
    def best(self) -> Json:
        """The incumbent's entry."""
        return incumbent(self.entries) or self.entries[0]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before the best parameters are used."""
        told = (self.backward, *(tell(self.entries, self.settings) for tell in (still_falling, never_beaten)))
        return tuple(warning for warning in told if warning)

    @property
    def loss(self) -> str:
        """What is minimized, in words."""
        if self.robot.trials.sensors:
            return "playback error"
        if not self.registered:
            return "marker error"
        names = {"motion": "motion error", "paper": "marker error"}
        return names.get(self.settings.protocol, "aligned marker error")

    @cached_property
    def trials(self) -> tuple[ReportedTrial, ...]:
        """Fitted and held-out trials by frequency, where they have one, and name."""
        trials = [
            ReportedTrial(name, held_out, figures, self.quality.get(name, {}))
            for content, held_out in ((self.fit, False), (self.held_out or {}, True))
            for name, figures in content.get("trials", {}).items()
        ]
        return tuple(sorted(trials, key=lambda t: (t.figures.get("frequency") or 0.0, t.name)))

    @property
    def registered(self) -> bool:
        """Whether a constant shift of each marker is taken out before trials are compared."""
        return self.has("static_offset")

    @property
    def has_beat(self) -> bool:
        """Whether trials have the frequency of a beat."""
        return self.has("frequency")

    @property
    def has_progress(self) -> bool:
        """Whether trials are scored by how far the robot has come."""
        return self.robot.trials.score_progress

    def has(self, figure: str) -> bool:
        """Whether a trial has a figure."""
        return any(trial.figures.get(figure) is not None for trial in self.trials)


def read_run(path: str | Path, robot: Robot) -> ReportedRun:
    """Gathers a run.

    Args:
        path: The run folder.
        robot: The robot that was calibrated.

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
    current = outcome is not None and (
        outcome.evaluations == len(entries) or abs((outcome.fit.loss or 0.0) - best["loss"]) <= _SAME_LOSS
    )
    content = {} if outcome is None else outcome.to_json()
    of_best: Json = content if current else {}
    has_trials = (folder.path / TRIALS).is_file()
    saved = load_trials(folder) if of_best and has_trials else ()
    return ReportedRun(
        name=folder.path.resolve().name,
        robot=robot,
        settings=settings,
        space=replace(space, scale=settings.resolved_scale),
        entries=entries,
        fit=of_best.get("fit") or best["evidence"],
        held_out=of_best.get("held_out"),
        quality=content.get("trials") or {},
        sensitivity={effect["name"]: effect for effect in of_best.get("sensitivity") or ()},
        marker_names=tuple(content.get("marker_names") or robot.marker_names),
        unfinished=_unfinished(settings, len(entries), outcome is not None, current, has_trials),
        calls=read_calls(folder.path, settings, entries),
        saved=tuple(sorted(saved, key=lambda trial: (trial.compared.frequency or 0.0, trial.compared.name))),
        backward=backward_from_rest(of_best.get("from_rest") or {}),
    )


def incumbent(entries: tuple[Json, ...]) -> Json | None:
    """The entry with the lowest loss of those that didn't fail, the earliest of equals; None when all failed."""
    proper = [entry for entry in entries if not entry["failed"]]
    return min(proper, key=lambda entry: entry["loss"]) if proper else None


def _unfinished(settings: RunSettings, done: int, ended: bool, current: bool, has_trials: bool) -> str | None:
    on_record = f"{done} of {settings.budget} evaluations are on record"
    if not ended:
        return (
            f"This run has not ended: {on_record}. The page shows what the record can tell. Charts of each trial, "
            f"held-out trials, track quality and the effect of each parameter are written when the run ends; go on "
            f"with --resume and make the report again."
        )
    if not current:
        return (
            f"This run went on after it had ended once, and has found better parameters since: {on_record}. Charts of "
            f"each trial, held-out trials and the effect of each parameter belong to the earlier ones and are left "
            f"out; finish the run with --resume and make the report again."
        )
    if not has_trials:
        return f"The run folder has no {TRIALS}, so charts of each trial are left out; --resume writes it again."
    return None
