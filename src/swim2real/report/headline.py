"""What a reader wants to know first: how far off the best parameters are, and what the error is made of."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swim2real.report.run import Json, ReportedRun
from swim2real.report.units import NOTHING, mm, percent, significant, text
from swim2real.robots.robot import Sensor

_SENSOR = "sensor_errors"
_POOR = 0.5  # of the size of the motion: an error above it is bad
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
    rows = [row for row in split(run) if row.name in _LARGE or row.name.startswith(_SENSOR)]
    minimized = [row for row in split(run) if row.name == "marker_error" and paper]
    return tuple(
        Tile(row.label, row.cells[1], row.cells[0], "".join(row.cells[2:]), row.meaning) for row in [*minimized, *rows]
    )


def split(run: ReportedRun) -> tuple[SplitRow, ...]:
    """The lines of the small table: of the figures that the trials have."""
    columns: list[Json] = [run.first["evidence"], run.fit]
    if run.held_out is not None:
        columns.append(run.held_out)
    rows: list[SplitRow] = []

    def add(label: str, name: str, shown: Callable[[Json], str], meaning: str, main: bool = False) -> None:
        rows.append(SplitRow(label, name, tuple(shown(figures) for figures in columns), meaning, main))

    def add_length(label: str, name: str, meaning: str, unit: str = "mm", main: bool = False) -> None:
        if run.has(name):
            add(label, name, lambda figures: with_unit(figures, name, unit), meaning, main)

    trials = run.robot.trials
    if trials.sensors:
        meaning = "The marker error, and what the errors of the sensors count as; this is minimized."
        add_length("Playback error", "loss", meaning, main=True)
    add_length(
        "Motion", "motion_error",
        "Mean distance between simulated and real markers in the frame of the path, once phase and placement of the "
        "markers are accounted for: shape, recoil and progress together.", main=True,
    )  # fmt: skip
    add_length("Recoil", "recoil_error", "What differences in the yaw and the sway of the head move markers by.")
    if run.has("yaw_error"):
        add("Yaw", "yaw_error", _angle("yaw_error"), "Mean difference in the amplitude of the head's yaw.")
    add_length("Sway", "sway_error", "Mean difference in the amplitude of the head's sway.")
    label = "Aligned marker error" if run.registered else "Marker error"
    add_length(label, "aligned_marker_error", _meaning(run), main=True)
    if run.has_progress:
        add_length("Shape", "shape_error", "How the body bends: the same without how far it has come.")
        add_length(
            "Progress", "progress_error",
            "How far it has come along its line of travel, which thrust and drag explain: mean difference over the "
            "compared time.",
        )  # fmt: skip
    for sensor in trials.sensors:
        counts = f"An error of 1 {sensor.unit} counts as {significant(1e3 * sensor.meters_per_unit)} mm."
        meaning = f"Mean difference of the readings. {counts}"
        add(f"Sensor {sensor.name}", f"{_SENSOR}.{sensor.name}", _reading(sensor), meaning)
    add_length("Speed", "velocity_error", "Mean difference in speed along the line of travel.", "mm/s")
    if run.has("heading_error"):
        meaning = "Mean difference in the turn since the first frame. Reported, not counted above."
        add("Heading", "heading_error", _angle("heading_error"), meaning)
    add_length(
        "Registration", "static_offset",
        "Markers are placed by hand: mean constant shift of a marker against its place in the simulation. Reported, "
        "not counted above.",
    )  # fmt: skip
    if run.has("unweighted_error"):
        add(
            "Lost tracks", "unweighted_error − aligned_marker_error", _lost,
            "How the error would change if frames in which tracking lost a marker counted too.",
        )  # fmt: skip
    add(
        "Left out", "left_out_share", lambda figures: percent(figures.get("left_out_share")),
        "Share of marker positions that don't count because tracking lost the marker.",
    )  # fmt: skip
    add_length(
        "Marker error, the paper's Eq. 1", "marker_error",
        "Mean distance over all markers and frames, no registration, nothing left out; only start and heading are "
        "removed.", main=True,
    )  # fmt: skip
    return tuple(rows)


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
        f"other seeds (--seeds 3) or a larger --budget",
    )


def diverged(figures: Json) -> bool:
    """Whether the simulation of any trial has failed."""
    return any(trial.get("divergence") for trial in figures.get("trials", {}).values())


def with_unit(figures: Json, name: str, unit: str) -> str:
    """A figure in mm or mm/s, with its unit, or that the simulation diverged."""
    if diverged(figures):
        return "diverged"
    shown = mm(figures.get(name))
    return shown if shown == NOTHING else f"{shown} {unit}"


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


def _lost(figures: Json) -> str:
    counted, unweighted = figures.get("aligned_marker_error"), figures.get("unweighted_error")
    if counted is None or unweighted is None or diverged(figures):
        return NOTHING
    return f"{mm(unweighted - counted, signed=True)} mm"


def _reading(sensor: Sensor) -> Callable[[Json], str]:
    def shown(figures: Json) -> str:
        if diverged(figures):
            return "diverged"
        value = significant((figures.get(_SENSOR) or {}).get(sensor.name))
        return value if value == NOTHING else f"{value} {sensor.unit}"

    return shown


def _angle(name: str) -> Callable[[Json], str]:
    """Shows a figure in degrees."""

    def shown(figures: Json) -> str:
        if diverged(figures):
            return "diverged"
        value = text(figures.get(name), 1, 180 / math.pi)
        return value if value == NOTHING else f"{value}°"

    return shown
