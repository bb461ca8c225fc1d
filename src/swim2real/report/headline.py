"""What a reader wants to know first: how far off the best parameters are, and what the error is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from swim2real.objective.figures import AVERAGED, SENSORS, UNSIMULATED, Figure, figures_for, sensor_figure
from swim2real.report.run import Json, ReportedRun
from swim2real.report.units import NOTHING, mm, significant

_POOR = 0.5  # of the size of the motion: an error above it is bad
_SUMS = ("loss", "motion_error", "aligned_marker_error", "marker_error")  # of which the others are parts
_LARGE = ("loss", "motion_error", "recoil_error", "aligned_marker_error", "shape_error", "velocity_error")


@dataclass(frozen=True)
class Tile:
    """One large number.

    Attributes:
        label: What it is.
        value: At the best parameters, with unit.
        first: At the first evaluation, with unit.
        held_out: On held-out trials, with unit; empty without any.
        meaning: In a sentence.
    """

    label: str
    value: str
    first: str
    held_out: str
    meaning: str


@dataclass(frozen=True)
class SplitRow:
    """One line of the table that splits the error.

    Attributes:
        label: What it is.
        name: The figure's name in files.
        cells: Texts with units: at the first evaluation, at the best, and on held-out trials where there are any.
        meaning: In a sentence.
        main: Whether the line is a sum, not a part.
    """

    label: str
    name: str
    cells: tuple[str, ...]
    meaning: str
    main: bool = False


def tiles(run: ReportedRun) -> tuple[Tile, ...]:
    """The large numbers; what is minimized first."""
    paper = run.settings.protocol == "paper"
    rows = [row for row in split(run) if row.name in _LARGE or row.name.startswith(SENSORS)]
    minimized = [row for row in split(run) if row.name == "marker_error" and paper]
    return tuple(
        Tile(row.label, row.cells[1], row.cells[0], "".join(row.cells[2:]), row.meaning) for row in [*minimized, *rows]
    )


def split(run: ReportedRun) -> tuple[SplitRow, ...]:
    """The lines of the small table: of the figures that the trials have."""
    columns: list[Json] = [run.first["evidence"], run.fit]
    if run.held_out is not None:
        columns.append(run.held_out)
    known = figures_for(run.registered)
    shown = {name: known[name] for name in AVERAGED if name != SENSORS and run.has(name)}
    if not run.registered and "aligned_marker_error" in shown:
        shown["aligned_marker_error"] = replace(shown["aligned_marker_error"], meaning=_meaning(run))
    if sensors := run.robot.trials.sensors:
        counted = "The marker error, and what the errors of the sensors count as; this is minimized."
        shown = {"loss": Figure("Playback error", "mm", counted, "loss"), **shown}
    for sensor in sensors:
        figure = sensor_figure(sensor.name, sensor.unit)
        counts = f"An error of 1 {sensor.unit} counts as {significant(1e3 * sensor.meters_per_unit)} mm."
        shown[f"{SENSORS}.{sensor.name}"] = replace(
            figure, label=f"Sensor {sensor.name}", meaning=f"{figure.meaning} {counts}"
        )
    cells = {name: tuple(with_unit(one, name, figure) for one in columns) for name, figure in shown.items()}
    return tuple(SplitRow(f.label, name, cells[name], f.meaning, name in _SUMS) for name, f in shown.items())


def warnings(run: ReportedRun) -> tuple[str, ...]:
    """What to know before the best parameters are used."""
    return (*run.warnings, *poor_fit(run))


def poor_fit(run: ReportedRun) -> tuple[str, ...]:
    """A sentence that the fit is bad for the size of the real motion, where it is.

    The size is the root mean square distance of the real markers from their mean places: on the way of a trial that is
    scored by it, else in the frame of comparison.
    """
    errors: list[float] = []
    squares: list[float] = []
    for trial in (one.compared for one in run.saved if not one.held_out and one.compared.divergence is None):
        real = trial.real if trial.progress is None else trial.path_real
        seen = (trial.weights > 0) & np.isfinite(real).all(axis=2)
        count = np.maximum(seen.sum(axis=0), 1)[:, None]
        places = np.where(seen[:, :, None], real, 0.0)
        apart = np.where(seen[:, :, None], places - places.sum(axis=0) / count, 0.0)
        errors.append(float(getattr(trial, trial.loss_figure)))
        squares.append(float((apart**2).sum() / max(int(seen.sum()), 1)))
    if not errors:
        return ()
    error, size = float(np.mean(errors)), math.sqrt(float(np.mean(squares)))
    if not error > _POOR * size:
        return ()
    return (
        f"the fit is bad: its error is {mm(error)} mm, and the real markers move by {mm(size)} mm about their mean "
        f"places (root mean square), so it explains little of the motion; look at the film for what is wrong, and try "
        f"other seeds (--seeds 0:3) or a larger --budget",
    )


def diverged(figures: Json) -> bool:
    """Whether the simulation of any trial has failed."""
    return any(trial.get("divergence") for trial in figures.get("trials", {}).values())


def with_unit(figures: Json, name: str, figure: Figure) -> str:
    """A figure with its unit, or that the simulation diverged."""
    if diverged(figures) and name not in UNSIMULATED:
        return "diverged"
    group, _, sensor = name.partition(".")
    shown = figure.text((figures.get(group) or {}).get(sensor) if sensor else figures.get(name))
    return shown if shown == NOTHING else f"{shown} {figure.unit}"


def _meaning(run: ReportedRun) -> str:
    """What the error of the markers is, in a sentence."""
    if run.registered:
        return (
            "Mean distance between simulated and real markers once phase and placement of the markers are accounted "
            "for: shape and progress together."
        )
    meaning = "Mean distance between simulated and real markers at the same times"
    if run.robot.trials.frame is not None:
        names = " and ".join(run.marker_names[marker] for marker in run.robot.trials.frame)
        meaning += f", in the frame of {names}{', with the difference in how far they have come' * run.has_progress}"
    return f"{meaning}."
