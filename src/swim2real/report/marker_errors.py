"""The error of every marker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim2real.objective import ComparedTrial
from swim2real.report.run import ReportedRun, ReportedTrial
from swim2real.report.units import mm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MarkerErrors:
    """One kind of error for every trial and marker.

    Attributes:
        key: A short name, such as `aligned`.
        label: For a person.
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


def by_trial(run: ReportedRun, key: str, label: str, note: str, row: Callable[[ReportedTrial], Array]) -> MarkerErrors:
    """One kind of error; trials that diverged are left out.

    Args:
        run: As reported.
        key: As in `MarkerErrors`, like label and note.
        label: Likewise.
        note: Likewise.
        row: A trial's errors [m]. Shape (M,).
    """
    trials = [trial for trial in run.trials if not trial.diverged]
    values = np.array([row(trial) for trial in trials], dtype=float).reshape(len(trials), len(run.marker_names))
    return MarkerErrors(key, label, note, tuple(t.name for t in trials), tuple(t.held_out for t in trials), values)


def stored(run: ReportedRun, figure: str) -> Callable[[ReportedTrial], Array]:
    """What an evaluation's evidence holds of each marker, NaN where it holds nothing."""
    count = len(run.marker_names)

    def row(trial: ReportedTrial) -> Array:
        found = np.full(count, np.nan)
        for i, value in enumerate((trial.figures.get(figure) or [])[:count]):
            found[i] = np.nan if value is None else value
        return found

    return row


def marker_errors(run: ReportedRun, swims: Sequence[ComparedTrial]) -> tuple[MarkerErrors, ...]:
    """Of swims: aligned, shape (only when the swims are there) and plain marker errors."""
    trials = [trial for trial in run.trials if not trial.diverged]
    if not trials or not run.marker_names:
        return ()
    by_name = {swim.name: swim for swim in swims}
    aligned_note = "Shape and thrust: a part that is equal for all markers is thrust."
    marker_note = "Before any alignment: it also holds placement of the markers and lost tracks."
    found = [
        by_trial(run, "aligned", "Aligned error", aligned_note, stored(run, "aligned_marker_errors")),
        by_trial(run, "marker", "Marker error (the paper's Eq. 1)", marker_note, stored(run, "marker_errors")),
    ]
    if all(trial.name in by_name for trial in trials):
        shape_note = "How the body bends, without how far it has come."
        shape = by_trial(run, "shape", "Shape error", shape_note, lambda trial: shape_errors(by_name[trial.name]))
        found.insert(1, shape)
    return tuple(found)


def shape_errors(swim: ComparedTrial) -> Array:
    """Weighted mean distance in the body frame after registration [m]. Shape (M,).

    NaN for a marker that never counts.
    """
    counts = (swim.weights > 0) & np.isfinite(swim.real).all(axis=2)
    weights = np.where(counts, swim.weights, 0.0)
    lengths = np.linalg.norm(np.where(counts[..., None], swim.simulated + swim.registration - swim.real, 0.0), axis=2)
    total = weights.sum(axis=0)
    return np.where(total > 0, (weights * lengths).sum(axis=0) / np.where(total > 0, total, 1.0), np.nan)
