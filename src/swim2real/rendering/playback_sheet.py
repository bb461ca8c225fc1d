"""Sheets of pictures of recordings: moments of one trial, and of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swim2real.rendering.drawing import PAGE, Bytes, Canvas, contact_sheet, plain, to_pillow
from swim2real.rendering.error_chart import ErrorChart
from swim2real.rendering.labels import draw_heading, gap_of, text_height
from swim2real.rendering.panel import Panel
from swim2real.rendering.playback_frame import draw_way
from swim2real.rendering.playback_panel import plane_panel
from swim2real.rendering.playback_view import (
    PlaybackLimits,
    PlaybackView,
    grid_step,
    length_text,
    millimeters,
    playback_limits,
)
from swim2real.rendering.sheet import TEXT, Row, check_tile, stacked, trials_sheet

if TYPE_CHECKING:
    from PIL.Image import Image


def moments_sheet(
    view: PlaybackView, count: int, columns: int, width: int, limits: PlaybackLimits | None = None
) -> Bytes:
    """A trial in several moments; below them the way that it has come, if it travels, and the error over time.

    Args:
        view: The recording.
        count: Moments, evenly spread over the trial.
        columns: Pictures in a row.
        width: Of each picture [px].
        limits: What is shown; None for what this view needs.

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: A number is too small.
        MissingExtraError: Pillow isn't installed.
    """
    check_tile(width)
    limits = limits or playback_limits([view])
    panel, samples = Panel(limits.plane, width, grid_step(limits.plane)), view.moments(count).tolist()
    images = [np.asarray(plane_panel(view, k, panel, TEXT)) for k in samples]
    captions = [f"{view.times[k]:.3f} s   {millimeters(float(view.errors[k]))}" for k in samples]
    sheet = to_pillow(contact_sheet(images, captions, columns, width))
    heading = draw_heading(view.name, _note(view, panel), sheet.width)
    return stacked([heading, sheet, _foot(view, samples, limits, sheet.width)])


def trials_overview(
    views: Sequence[PlaybackView], count: int, width: int, limits: PlaybackLimits | None = None
) -> Bytes:
    """Every trial from its start to its end: a row is a trial, a column a share of its time.

    Args:
        views: The recordings, in the order of the rows.
        count: Moments, evenly spread over each trial.
        width: Of each picture [px].
        limits: What is shown; None for what these views need together.

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No views, or a number is too small.
        MissingExtraError: Pillow isn't installed.
    """
    check_tile(width)
    limits = limits or playback_limits(views)
    panel = Panel(limits.plane, width, grid_step(limits.plane))
    rows: list[Row] = []
    for view in views:
        samples = view.moments(count).tolist()
        pictures = [plane_panel(view, sample, panel, TEXT) for sample in samples]
        rows.append(Row(view.name, millimeters(view.error), pictures, view.times[samples].tolist()))
    heads = [f"{100 * k / (count - 1):.0f} %" for k in range(count)]
    image = trials_sheet(rows, "time", heads, width, panel.height)
    return stacked([draw_heading("Each trial from start to end", _note(views[0], panel), image.width), image])


def _foot(view: PlaybackView, samples: Sequence[int], limits: PlaybackLimits, width: int) -> Image:
    """The error over time, at the right of the way that it has come if it travels."""
    way = draw_way(view, samples[-1], limits, width // 2)
    left = 0 if way is None else way.width
    size, gap = text_height(width), gap_of(width)
    chart = ErrorChart(view, limits.error, width - left - 2 * gap, 0.9 * size).at(*samples)
    foot = plain(width, gap + max(chart.height, 0 if way is None else way.height), PAGE)
    canvas = Canvas(foot)
    if way is not None:
        canvas.paste(way, (0, 0))
    canvas.paste(chart, (left + gap, 0))
    return foot


def _note(view: PlaybackView, panel: Panel) -> str:
    return f"{view.axes}   grid {length_text(panel.step)}"
