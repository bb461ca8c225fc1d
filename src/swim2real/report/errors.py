"""Errors of the best parameters, the parts that they consist of, and the error of every marker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swim2real.formatting import NOTHING, mm, significant
from swim2real.objective.figures import (
    AVERAGED,
    SENSORS,
    UNSIMULATED,
    Figure,
    FitFigures,
    TrialFigures,
    figure_values,
    figures_for,
    sensor_figure,
)
from swim2real.objective.trial import TAIL_FIRST_LOSS
from swim2real.report.run import ReportedRun
from swimbase.arrays import Array

_SUMS = ("loss", "motion_error", "aligned_marker_error", "marker_error")  # of which the others are parts
_LARGE = ("loss", "motion_error", "recoil_error", "aligned_marker_error", "shape_error", "velocity_error")


@dataclass(frozen=True)
class ErrorRow:
    """One line of the table that splits the error.

    Attributes:
        label: What it is.
        name: The figure's name in files.
        first: At the first evaluation, with unit.
        best: At the best one.
        held_out: The same on held-out trials; empty without any.
        meaning: In a sentence.
        is_sum: Whether other lines are parts of it.
        is_large: Whether it is a large number at the top of the page.
    """

    label: str
    name: str
    first: str
    best: str
    held_out: str
    meaning: str
    is_sum: bool
    is_large: bool


def error_rows(run: ReportedRun) -> tuple[ErrorRow, ...]:
    """The lines of the table: of the figures that the trials have."""
    known = figures_for(run.registered)
    shown = {name: known[name] for name in AVERAGED if name != SENSORS and run.has(name)}
    if not run.registered and "aligned_marker_error" in shown:
        shown["aligned_marker_error"] = replace(shown["aligned_marker_error"], meaning=_unregistered(run))
    if sensors := run.robot.trials.sensors:
        counted = "The marker error, and what the errors of the sensors count as; this is minimized."
        shown = {"loss": Figure("Playback error", "mm", counted, "loss"), **shown}
    for sensor in sensors:
        figure = sensor_figure(sensor.name, sensor.unit)
        counts = f"An error of 1 {sensor.unit} counts as {significant(1e3 * sensor.meters_per_unit)} mm."
        meaning = f"{figure.meaning} {counts}"
        shown[f"{SENSORS}.{sensor.name}"] = replace(figure, label=f"Sensor {sensor.name}", meaning=meaning)
    large = (*_LARGE, "marker_error") if run.settings.protocol == "paper" else _LARGE
    rows: list[ErrorRow] = []
    for name, figure in shown.items():
        first, best, held_out = (
            _with_unit(fit, name, figure) for fit in (run.entries[0].evidence, run.of_best.fit, run.of_best.held_out)
        )
        is_large = name in large or name.startswith(SENSORS)
        rows.append(ErrorRow(figure.label, name, first, best, held_out, figure.meaning, name in _SUMS, is_large))
    return tuple(rows)


def _with_unit(fit: FitFigures | None, name: str, figure: Figure) -> str:
    """A figure with its unit, or that the simulation diverged; empty without a fit."""
    if fit is None:
        return ""
    if name not in UNSIMULATED and any(trial.divergence for trial in fit.trials.values()):
        return "diverged"
    shown = figure.text(fit.loss if name == "loss" else figure_values(fit).get(name))
    return shown if shown == NOTHING else f"{shown} {figure.unit}"


def _unregistered(run: ReportedRun) -> str:
    """Meaning of the error without registration, in a sentence."""
    meaning = "Mean distance between simulated and real markers at the same times"
    if run.robot.trials.frame is not None:
        names = " and ".join(run.marker_names[marker] for marker in run.robot.trials.frame)
        meaning += f", in the frame of {names}{', with the difference in how far they have come' * run.has_progress}"
    return f"{meaning}."


def warnings(run: ReportedRun) -> tuple[str, ...]:
    """Warnings to read before the best parameters are used."""
    found = [*run.warnings]
    loss = run.of_best.fit.loss or 0.0
    if loss >= TAIL_FIRST_LOSS and run.settings.protocol == "motion":
        found.append(
            f"a trial goes tail first, so the loss, {mm(loss)} mm, has {mm(TAIL_FIRST_LOSS, 0)} mm added; the other "
            f"errors are without it"
        )
    return tuple(found)


@dataclass(frozen=True)
class MarkerErrors:
    """One kind of error for every trial and marker.

    Attributes:
        key: A short name, such as `aligned`.
        label: Name of the error as it is shown.
        note: Its meaning, in a sentence.
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
        total = np.isfinite(fitted).sum(axis=0)
        return np.where(total > 0, np.nansum(fitted, axis=0) / np.maximum(total, 1), np.nan)

    @cached_property
    def shares(self) -> NDArray[np.int64]:
        """Share of the largest value for every trial and marker, the mean last [%]. Shape (F + 1, M)."""
        everything = np.nan_to_num(np.vstack([self.values, self.mean]))
        return np.rint(100 * everything / max(float(everything.max(initial=0.0)), 1e-9)).astype(int)


def marker_errors(run: ReportedRun) -> tuple[MarkerErrors, ...]:
    """The errors of each marker that the trials have, and what they may be made of."""
    trials = [trial for trial in run.trials if not trial.diverged]
    if not trials or not run.marker_names:
        return ()
    kinds: dict[str, tuple[str, str, Callable[[TrialFigures], list[float | None] | Array]]] = {
        "aligned": (
            "Aligned error" if run.registered else "Marker error",
            "Shape and progress: a part that is equal for all markers is progress." if run.registered
            else "Mean distance at the same times.",
            lambda figures: figures.aligned_marker_errors,
        ),
        "shape": (
            "Shape error", "How the body bends, without how far it has come.",
            lambda figures: figures.shape_marker_errors if run.has_progress else [],
        ),
        "marker": (
            "Marker error (the paper's Eq. 1)",
            "Before any alignment: it also holds placement of the markers and lost tracks.",
            lambda figures: figures.marker_errors,
        ),
        "offset": (
            "Constant offset",
            "What stays of it in the mean over time: a marker in another place, or a pose that sags.",
            lambda figures: np.hypot(*np.array(figures.offset, dtype=float).reshape(-1, 2).T),
        ),
        "amplitude": (
            "Difference in amplitude",
            "By how much it moves more or less, as a standard deviation along the line that it moves along.",
            lambda figures: np.abs(np.subtract(*(np.array(one, dtype=float) for one in (
                figures.amplitude_simulated, figures.amplitude_real)))),
        ),
    }  # fmt: skip
    found: list[MarkerErrors] = []
    for key, (label, note, of) in kinds.items():
        values = np.full((len(trials), len(run.marker_names)), np.nan)
        for row, trial in zip(values, trials, strict=True):
            errors = np.array(of(trial.figures), dtype=float)[: len(row)]
            row[: len(errors)] = errors
        if np.isfinite(values).any():
            names, held_out = zip(*((trial.name, trial.held_out) for trial in trials), strict=True)
            found.append(MarkerErrors(key, label, note, names, held_out, values))
    return tuple(found)
