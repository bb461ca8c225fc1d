"""Sheets of pictures of swims: moments of a beat."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from swim2real.rendering.drawing import Bytes, contact_sheet, to_pillow
from swim2real.rendering.labels import draw_heading
from swim2real.rendering.panel import Panel
from swim2real.rendering.sheet import TEXT, Row, check_tile, stacked, trials_sheet
from swim2real.rendering.swim_frame import GRID_NOTE, draw_courses
from swim2real.rendering.swim_panel import body_panel
from swim2real.rendering.swim_view import Limits, SwimView, common_limits


def clip_sheet(view: SwimView, count: int, columns: int, width: int, limits: Limits | None = None) -> Bytes:
    """One beat from the middle of a trial in several moments, and below them both courses over the whole time.

    Args:
        view: The swim.
        count: Moments, evenly spread over the beat.
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
    limits = limits or common_limits([view])
    times, shares = view.beat(count)
    panel, samples = Panel(limits.body, width), view.nearest(times).tolist()
    images = [np.asarray(body_panel(view, k, panel, TEXT)) for k in samples]
    captions = [f"beat {_share(s, count)}   {view.times[k]:.3f} s" for s, k in zip(shares, samples, strict=True)]
    sheet = to_pillow(contact_sheet(images, captions, columns, width))
    heading = draw_heading(f"{view.name}   {view.frequency:.2f} Hz", GRID_NOTE, sheet.width)
    return stacked([heading, sheet, draw_courses(view, view.last_course, limits, sheet.width)])


def beat_sheet(views: Sequence[SwimView], count: int, width: int, limits: Limits | None = None) -> Bytes:
    """One beat of each trial: a row is a trial, a column a share of the beat.

    All beats begin where the last real marker is farthest to the left of the swimmer (up in the picture).

    Args:
        views: The swims, in the order of the rows.
        count: Moments, evenly spread over the beat.
        width: Of each picture [px].
        limits: What is shown; None for what these views need together.

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No views, or a number is too small.
        MissingExtraError: Pillow isn't installed.
    """
    check_tile(width)
    limits = limits or common_limits(views)
    panel = Panel(limits.body, width)
    rows: list[Row] = []
    for view in views:
        samples = view.nearest(view.beat(count)[0]).tolist()
        pictures = [body_panel(view, sample, panel, TEXT) for sample in samples]
        rows.append(Row(view.name, f"{view.frequency:.2f} Hz", pictures, view.times[samples].tolist()))
    heads = [str(Fraction(column, count)) for column in range(count)]
    image = trials_sheet(rows, "beat", heads, width, panel.height)
    return stacked([draw_heading("One beat of each trial", GRID_NOTE, image.width), image])


def _share(share: float, count: int) -> str:
    """A share of the beat as a fraction where it is one."""
    fraction = Fraction(share).limit_denominator(count)
    return str(fraction) if abs(fraction - share) < 1e-9 else f"{share:.2f}"
