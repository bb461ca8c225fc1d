"""What a run folder tells, gathered for the page, whether the run has ended or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.calibration import RunFolder, SwimPair, load_swims
from swim2real.calibration.from_rest import backward_from_rest
from swim2real.calibration.outcome import SWIMS
from swim2real.errors import RunError
from swim2real.parameters import ParameterSpace
from swim2real.report.recorded_calls import RecordedCalls, read_calls

Json = Mapping[str, Any]

_SAME_LOSS = 1e-5  # m, by which a loss may differ when the same parameters are simulated again


@dataclass(frozen=True)
class ReportedTrial:
    """A trial at the best parameters.

    Attributes:
        name: Of the trial.
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
        name: Of the folder.
        settings: As recorded.
        space: On the run's scale.
        entries: The record, one entry an evaluation, at least one.
        fit: Figures of the best parameters on the fitted trials, in SI.
        held_out: The same on trials left out of the fit, None without any.
        quality: By trial, what was found in the real tracks.
        sensitivity: By parameter, empty where it wasn't determined.
        swims: Real and simulated swims at the best parameters, by frequency; simulated positions are NaN where the
            simulation diverged. Empty before a run ends.
        marker_names: M names, head first.
        unfinished: What is missing and why, in sentences; None for a run that ended.
        backward: That the best parameters don't swim forward from rest, and what to do; None where they do and where
            nobody tried.
        calls: Of the advisor; None for a run that made none.
    """

    name: str
    settings: Json
    space: ParameterSpace
    entries: tuple[Json, ...]
    fit: Json
    held_out: Json | None
    quality: Json
    sensitivity: Json
    swims: tuple[SwimPair, ...]
    marker_names: tuple[str, ...]
    unfinished: str | None
    backward: str | None
    calls: RecordedCalls | None

    @property
    def first(self) -> Json:
        """The first evaluation's entry."""
        return self.entries[0]

    @cached_property
    def best(self) -> Json:
        """The incumbent's entry."""
        return incumbent(self.entries) or self.entries[0]

    @property
    def paper_protocol(self) -> bool:
        return self.settings.get("protocol") == "paper"

    @cached_property
    def trials(self) -> tuple[ReportedTrial, ...]:
        """Fitted and held-out trials by frequency."""
        found: list[ReportedTrial] = []
        for figures, held_out in ((self.fit, False), (self.held_out or {}, True)):
            for name, trial in figures.get("trials", {}).items():
                found.append(ReportedTrial(name, held_out, trial, self.quality.get(name, {})))
        return tuple(sorted(found, key=lambda t: (t.figures["frequency"] or 0.0, t.name)))


def incumbent(entries: tuple[Json, ...]) -> Json | None:
    """The entry with the lowest loss of those that didn't fail, the earliest of equals; None when all failed."""
    proper = [entry for entry in entries if not entry["failed"]]
    return min(proper, key=lambda entry: entry["loss"]) if proper else None


def best_losses(entries: tuple[Json, ...]) -> list[float]:
    """Loss of the incumbent after each evaluation [m]; that of a failure as long as all failed."""
    found: list[float] = []
    best: float | None = None
    for entry in entries:
        if not entry["failed"]:
            best = entry["loss"] if best is None else min(best, entry["loss"])
        found.append(entry["loss"] if best is None else best)
    return found


def read_run(path: str | Path, space: ParameterSpace) -> ReportedRun:
    """Gathers a run.

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
    best = incumbent(entries) or entries[0]
    space.check(best["values"], where=f"run '{path}'")
    outcome = folder.outcome()
    has_swims = (folder.path / SWIMS).is_file()
    current = outcome is not None and abs(outcome["fit"]["loss"] - best["loss"]) <= _SAME_LOSS
    fit: Json = outcome["fit"] if outcome is not None and current else best["evidence"]
    of_best: Json = outcome if outcome is not None and current else {}
    swims = [_without_diverged(swim, of_best) for swim in load_swims(folder)] if current and has_swims else []
    return ReportedRun(
        name=folder.path.resolve().name,
        settings=settings,
        space=replace(space, scale=settings.get("scale", space.scale)),
        entries=entries,
        fit=fit,
        held_out=of_best.get("held_out"),
        quality=(outcome or {}).get("trials") or {},
        sensitivity={one["name"]: one for one in of_best.get("sensitivity") or ()},
        swims=tuple(sorted(swims, key=lambda swim: (swim.frequency, swim.name))),
        marker_names=_marker_names(outcome, fit),
        unfinished=_unfinished(settings, len(entries), outcome is not None, current, has_swims),
        backward=backward_from_rest(of_best.get("from_rest") or {}),
        calls=read_calls(folder.path, settings, entries),
    )


def _without_diverged(swim: SwimPair, outcome: Json) -> SwimPair:
    """The swim, its simulated part NaN if that diverged: what is stored then is no motion."""
    figures = outcome["held_out" if swim.held_out else "fit"]["trials"][swim.name]
    return replace(swim, simulated=np.full_like(swim.simulated, np.nan)) if figures.get("divergence") else swim


def _marker_names(outcome: Json | None, fit: Json) -> tuple[str, ...]:
    if outcome is not None and outcome.get("marker_names"):
        return tuple(str(name) for name in outcome["marker_names"])
    counts = [len(trial.get("marker_errors") or ()) for trial in fit.get("trials", {}).values()]
    return tuple(f"M{i}" for i in range(max(counts, default=0)))


def _unfinished(settings: Json, done: int, ended: bool, current: bool, has_swims: bool) -> str | None:
    on_record = f"{done} of {settings.get('budget', '?')} evaluations are on record"
    if not ended:
        return (
            f"This run has not ended: {on_record}. The page shows what the record can tell. Marker paths, body "
            f"envelopes, held-out trials, track quality and the effect of each parameter are written when the run "
            f"ends; go on with --resume and make the report again."
        )
    if not current:
        return (
            f"This run went on after it had ended once, and has found better parameters since: {on_record}. Marker "
            f"paths, held-out trials and the effect of each parameter belong to the earlier ones and are left out; "
            f"finish the run with --resume and make the report again."
        )
    if not has_swims:
        return (
            f"The run folder has no {SWIMS}, so marker paths and body envelopes are left out; --resume writes it again."
        )
    return None
