"""Sheets of pictures of swims, for models that take no films: moments of a beat, and moments of a real film."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Bytes, Canvas, contact_sheet, plain, text_size, to_pillow
from swim2real.rendering.swim_film import film_frames
from swim2real.rendering.swim_frame import draw_courses, draw_heading, shortened
from swim2real.rendering.swim_panel import MUTED, Panel, body_panel
from swim2real.rendering.swim_view import Limits, SwimView, common_limits

if TYPE_CHECKING:
    from PIL.Image import Image

LEAST_WIDTH = 160  # px
TEXT = 13.0  # px, of the heads of rows and columns
ROW_HEAD = 120  # px, that a trial's name takes at most


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
    _check(width)
    limits = limits or common_limits([view])
    times, shares = view.beat(count)
    panel, samples = Panel(limits.body, width), view.nearest(times).tolist()
    images = [np.asarray(body_panel(view, k, panel, TEXT)) for k in samples]
    captions = [f"beat {_share(s, count)}   {view.times[k]:.3f} s" for s, k in zip(shares, samples, strict=True)]
    sheet = to_pillow(contact_sheet(images, captions, columns, width))
    heading = draw_heading(f"{view.name}   {view.frequency:.2f} Hz", sheet.width)
    return _stacked([heading, sheet, draw_courses(view, view.last_course, limits, sheet.width)])


def beat_sheet(views: Sequence[SwimView], count: int, width: int, limits: Limits | None = None) -> Bytes:
    """One beat of each trial: a row is a trial, a column a share of the beat.

    All beats begin where the last real marker is farthest to the left of the fish (up in the picture).

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
    _check(width)
    limits = limits or common_limits(views)
    panel, gap = Panel(limits.body, width), 8
    names = [shortened(view.name, TEXT, ROW_HEAD) for view in views]
    rates = [f"{view.frequency:.2f} Hz" for view in views]
    left = 2 * gap + max(text_size(text, TEXT)[0] for text in names + rates)
    top = round(2 * TEXT)
    image = plain(left + count * (width + gap), top + len(views) * (panel.height + gap), PAGE)
    canvas = Canvas(image)
    canvas.text((gap, top / 2), "beat", MUTED, TEXT, (0, 0.5))
    for column in range(count):
        x = left + column * (width + gap)
        canvas.text((x + width / 2, top / 2), str(Fraction(column, count)), MUTED, TEXT, (0.5, 0.5))
    for row, view in enumerate(views):
        y = top + row * (panel.height + gap)
        canvas.text((gap, y + panel.height / 2), names[row], INK, TEXT, (0, 1))
        canvas.text((gap, y + panel.height / 2), rates[row], INK, TEXT, (0, 0))
        for column, sample in enumerate(view.nearest(view.beat(count)[0]).tolist()):
            picture = body_panel(view, sample, panel, TEXT)
            Canvas(picture).text((5, 3), f"{view.times[sample]:.3f} s", MUTED, 11)
            canvas.paste(picture, (left + column * (width + gap), y))
    return _stacked([draw_heading("One beat of each trial", image.width), image])


def film_sheet(video: str | Path, times: Sequence[float], columns: int, width: int) -> Bytes:
    """Frames of a real film, upright, with time and number burned in.

    Args:
        video: Of the film.
        times: Since its first frame, rising [s]; each shows the nearest frame. Those after the end are left out.
        columns: Pictures in a row.
        width: Of each picture, even [px].

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No time lies within the film, the times don't rise, or a number is not allowed.
        VideoError: The film can't be read.
        MissingExtraError: PyAV or Pillow isn't installed.
    """
    frames = list(film_frames(video, times, width))
    if not frames:
        raise ArgumentError(f"none of the {len(times)} times lies within '{video}'; give times within the film, in s")
    captions = [f"{time:.3f} s" for time, _ in frames]
    return contact_sheet([image for _, image in frames], captions, columns, width)


def _stacked(images: Sequence[Image]) -> Bytes:
    """Pictures of the same width below one another."""
    canvas, y = Canvas(plain(images[0].width, sum(image.height for image in images), PAGE)), 0
    for image in images:
        canvas.paste(image, (0, y))
        y += image.height
    return canvas.pixels()


def _share(share: float, count: int) -> str:
    """A share of the beat as a fraction where it is one."""
    fraction = Fraction(share).limit_denominator(count)
    return str(fraction) if abs(fraction - share) < 1e-9 else f"{share:.2f}"


def _check(width: int) -> None:
    if width < LEAST_WIDTH:
        raise ArgumentError(f"width is {width} px; a picture of a sheet must be at least {LEAST_WIDTH} px wide")
