"""The error of every marker, from head to tail."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import SwimPair
from swim2real.report.run import ReportedRun
from swim2real.report.units import mm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MarkerErrors:
    """One kind of error for every trial and marker.

    Attributes:
        key: `aligned`, `shape` or `marker`.
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


def marker_errors(run: ReportedRun) -> tuple[MarkerErrors, ...]:
    """Aligned, shape (only when the swims are there) and plain marker errors; trials that diverged are left out."""
    trials = [trial for trial in run.trials if not trial.diverged]
    count = len(run.marker_names)
    swims = {swim.name: swim for swim in run.swims}

    def stored(figure: str) -> list[Array]:
        return [_row(trial.figures.get(figure), count) for trial in trials]

    def made(key: str, label: str, note: str, rows: list[Array]) -> MarkerErrors:
        values = np.array(rows, dtype=float).reshape(len(trials), count)
        return MarkerErrors(key, label, note, tuple(t.name for t in trials), tuple(t.held_out for t in trials), values)

    if not trials or count == 0:
        return ()
    aligned_note = "Shape and thrust: a part that is equal for all markers is thrust."
    marker_note = "Before any alignment: it also holds placement of the markers and lost tracks."
    found = [
        made("aligned", "Aligned error", aligned_note, stored("aligned_marker_errors")),
        made("marker", "Marker error (the paper's Eq. 1)", marker_note, stored("marker_errors")),
    ]
    if all(trial.name in swims for trial in trials):
        rows = [shape_errors(swims[trial.name]) for trial in trials]
        found.insert(1, made("shape", "Shape error", "How the body bends, without how far it has come.", rows))
    return tuple(found)


def shape_errors(swim: SwimPair) -> Array:
    """Weighted mean distance in the body frame after registration [m]. Shape (M,).

    NaN for a marker that never counts.
    """
    counts = (swim.weights > 0) & np.isfinite(swim.real).all(axis=2)
    weights = np.where(counts, swim.weights, 0.0)
    lengths = np.linalg.norm(np.where(counts[..., None], swim.simulated + swim.registration - swim.real, 0.0), axis=2)
    total = weights.sum(axis=0)
    return np.where(total > 0, (weights * lengths).sum(axis=0) / np.where(total > 0, total, 1.0), np.nan)


def _row(stored: list[float | None] | None, count: int) -> Array:
    row = np.full(count, np.nan)
    for i, value in enumerate((stored or [])[:count]):
        row[i] = np.nan if value is None else value
    return row
