"""What a reader wants to know first of recordings: how far off the playback is, in markers and in sensors."""

from __future__ import annotations

import math
from collections.abc import Callable

from swim2real.report.headline import SplitRow, Tile, diverged, with_unit
from swim2real.report.run import Json, ReportedRun
from swim2real.report.units import NOTHING, percent, significant, text
from swim2real.robots.robot import Sensor

_LARGE = ("loss", "aligned_marker_error", "velocity_error")
_SENSOR = "sensor_errors"


def loss_name(run: ReportedRun) -> str:
    """What is minimized, in words: without sensors it is the marker error alone."""
    return "playback error" if run.robot.recordings.sensors else "marker error"


def tiles(run: ReportedRun) -> tuple[Tile, ...]:
    """The large numbers; the loss first."""
    return tuple(
        Tile(row.label, row.cells[1], row.cells[0], "".join(row.cells[2:]), row.meaning)
        for row in split(run)
        if row.name in _LARGE or row.name.startswith(_SENSOR)
    )


def split(run: ReportedRun) -> tuple[SplitRow, ...]:
    """The lines of the small table: of what there is."""
    columns: list[Json] = [run.first["evidence"], run.fit]
    if run.held_out is not None:
        columns.append(run.held_out)

    def row(label: str, name: str, shown: Callable[[Json], str], meaning: str, main: bool = False) -> SplitRow:
        return SplitRow(label, name, tuple(shown(figures) for figures in columns), meaning, main)

    def length(label: str, name: str, meaning: str, unit: str = "mm", main: bool = False) -> SplitRow:
        return row(label, name, lambda figures: with_unit(figures, name, unit), meaning, main)

    about = run.robot.recordings
    found: list[SplitRow] = []
    if about.sensors:
        meaning = "The marker error, and what the errors of the sensors are worth; this is minimized."
        found.append(length("Playback error", "loss", meaning, main=True))
    marker = "Mean distance between simulated and real markers at the same times"
    if about.frame is not None:
        names = " and ".join(run.marker_names[marker] for marker in about.frame)
        marker += f", in the frame of {names}{', with the difference in how far they have come' * about.score_progress}"
    found.append(length("Marker error", "aligned_marker_error", f"{marker}.", main=True))
    if about.score_progress:
        found.append(length("Shape", "shape_error", "The same without how far it has come."))
    for sensor in about.sensors:
        worth = f"An error of 1 {sensor.unit} counts as {significant(1e3 * sensor.meters_per_unit)} mm."
        meaning = f"Mean difference of the readings. {worth}"
        found.append(row(f"Sensor {sensor.name}", f"{_SENSOR}.{sensor.name}", _reading(sensor), meaning))
    if about.score_progress:
        found.append(length("Speed", "velocity_error", "Mean difference in speed along the line of travel.", "mm/s"))
    if about.frame is not None:
        meaning = "Mean difference in the turn since the first frame. Reported, not counted above."
        found.append(row("Heading", "heading_error", _heading, meaning))
    left_out = "Share of marker positions that don't count because tracking lost the marker."
    found.append(row("Left out", "left_out_share", lambda figures: percent(figures.get("left_out_share")), left_out))
    return tuple(found)


def _reading(sensor: Sensor) -> Callable[[Json], str]:
    def shown(figures: Json) -> str:
        if diverged(figures):
            return "diverged"
        value = significant((figures.get("sensor_errors") or {}).get(sensor.name))
        return value if value == NOTHING else f"{value} {sensor.unit}"

    return shown


def _heading(figures: Json) -> str:
    if diverged(figures):
        return "diverged"
    value = text(figures.get("heading_error"), 1, 180 / math.pi)
    return value if value == NOTHING else f"{value}°"
