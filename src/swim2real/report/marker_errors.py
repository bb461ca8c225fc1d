"""The error of every marker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim2real.report.run import ReportedRun, ReportedTrial
from swim2real.report.units import mm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MarkerErrors:
    """One kind of error for every trial and marker.

    Attributes:
        key: A short name, such as `aligned`.
        label: Name of the trial as it is shown.
        note: What it tells, in a sentence.
        trials: F names.
        held_out: Whether each trial was left out of the fit. Length F.
        values: [m], NaN for a marker that never counts. Shape (F, M).
    """

    key: str
    label: str
    note: str
    trials: tuple[str, ...]
    held_out: tuple[bool, ...]
    values: Array

    @cached_property
    def mean(self) -> Array:
        """Over the fitted trials in which a marker counts [m]. Shape (M,)."""
        fitted = self.values[~np.array(self.held_out, dtype=bool)]
        counts = np.isfinite(fitted)
        total = counts.sum(axis=0)
        return np.where(total > 0, np.where(counts, fitted, 0.0).sum(axis=0) / np.maximum(total, 1), np.nan)

    @cached_property
    def cells(self) -> tuple[tuple[tuple[str, int], ...], ...]:
        """Text [mm] and share of the largest value [%] for every trial and marker, the mean last."""
        everything = np.vstack([self.values, self.mean])
        largest = float(np.nan_to_num(everything).max(initial=1e-9))
        return tuple(
            tuple((mm(value), round(100 * value / largest) if np.isfinite(value) else 0) for value in row)
            for row in everything.tolist()
        )


def marker_errors(run: ReportedRun) -> tuple[MarkerErrors, ...]:
    """The errors of each marker that the trials have, and what they may be made of."""
    if not any(not trial.diverged for trial in run.trials) or not run.marker_names:
        return ()
    count = len(run.marker_names)

    def offset(trial: ReportedTrial) -> Array:
        vectors = np.array(trial.figures.get("offset") or [[None, None]] * count, dtype=float)
        return np.linalg.norm(vectors, axis=1)

    def amplitude(trial: ReportedTrial) -> Array:
        real, simulated = (_stored(f"amplitude_{kind}", count)(trial) for kind in ("real", "simulated"))
        return np.abs(simulated - real)

    kinds: list[MarkerErrors] = []
    if run.registered:
        note = "Shape and progress: a part that is equal for all markers is progress."
        kinds.append(_by_trial(run, "aligned", "Aligned error", note, _stored("aligned_marker_errors", count)))
    else:
        note = "Mean distance at the same times."
        kinds.append(_by_trial(run, "aligned", "Marker error", note, _stored("aligned_marker_errors", count)))
    if run.has_progress and run.has("shape_marker_errors"):
        note = "How the body bends, without how far it has come."
        kinds.append(_by_trial(run, "shape", "Shape error", note, _stored("shape_marker_errors", count)))
    if run.has("marker_errors"):
        note = "Before any alignment: it also holds placement of the markers and lost tracks."
        label = "Marker error (the paper's Eq. 1)"
        kinds.append(_by_trial(run, "marker", label, note, _stored("marker_errors", count)))
    if run.has("offset"):
        note = "What stays of it in the mean over time: a marker in another place, or a pose that sags."
        kinds.append(_by_trial(run, "offset", "Constant offset", note, offset))
    if run.has("amplitude_real"):
        note = "By how much it moves more or less, as a standard deviation along the line that it moves along."
        kinds.append(_by_trial(run, "amplitude", "Difference in amplitude", note, amplitude))
    return tuple(kinds)


def _by_trial(run: ReportedRun, key: str, label: str, note: str, row: Callable[[ReportedTrial], Array]) -> MarkerErrors:
    """One kind of error; trials that diverged are left out. `row` gives a trial's errors [m], shape (M,)."""
    trials = [trial for trial in run.trials if not trial.diverged]
    values = np.array([row(trial) for trial in trials], dtype=float).reshape(len(trials), len(run.marker_names))
    return MarkerErrors(key, label, note, tuple(t.name for t in trials), tuple(t.held_out for t in trials), values)


def _stored(figure: str, count: int) -> Callable[[ReportedTrial], Array]:
    """What an evaluation's evidence holds of each marker, NaN where it holds nothing."""

    def row(trial: ReportedTrial) -> Array:
        values = np.full(count, np.nan)
        for i, value in enumerate((trial.figures.get(figure) or [])[:count]):
            values[i] = np.nan if value is None else value
        return values

    return row
