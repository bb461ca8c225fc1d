"""Sheets of pictures of trials, for models that take no films: rows and columns, and moments of a real film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Bytes, Canvas, contact_sheet, plain, text_size
from swim2real.rendering.film import film_frames
from swim2real.rendering.labels import shortened
from swim2real.rendering.panel import MUTED

if TYPE_CHECKING:
    from PIL.Image import Image

LEAST_WIDTH = 160  # px
TEXT = 13.0  # px, of the heads of rows and columns
STAMP = 11.0  # px, of the times in pictures
ROW_HEAD = 120  # px, that a trial's name takes at most
_GAP = 8  # px


@dataclass(frozen=True)
class Row:
    """One trial of a sheet.

    Attributes:
        name: Of the trial.
        about: Below its name.
        pictures: Of its moments, in the order of the columns.
        times: Of the moments [s].
    """

    name: str
    about: str
    pictures: Sequence[Image]
    times: Sequence[float]


def trials_sheet(rows: Sequence[Row], corner: str, heads: Sequence[str], width: int, height: int) -> Image:
    """A row for each trial, a column for each moment.

    Args:
        rows: The trials.
        corner: What the heads of the columns are.
        heads: Of the columns.
        width: Of each picture [px].
        height: Of each picture [px].
    """
    names = [shortened(row.name, TEXT, ROW_HEAD) for row in rows]
    left = 2 * _GAP + max(text_size(text, TEXT)[0] for text in [*names, *(row.about for row in rows)])
    top = round(2 * TEXT)
    image = plain(left + len(heads) * (width + _GAP), top + len(rows) * (height + _GAP), PAGE)
    canvas = Canvas(image)
    canvas.text((_GAP, top / 2), corner, MUTED, TEXT, (0, 0.5))
    for column, head in enumerate(heads):
        x = left + column * (width + _GAP)
        canvas.text((x + width / 2, top / 2), head, MUTED, TEXT, (0.5, 0.5))
    for k, row in enumerate(rows):
        y = top + k * (height + _GAP)
        canvas.text((_GAP, y + height / 2), names[k], INK, TEXT, (0, 1))
        canvas.text((_GAP, y + height / 2), row.about, INK, TEXT, (0, 0))
        for column, (picture, time) in enumerate(zip(row.pictures, row.times, strict=True)):
            Canvas(picture).text((5, 3), f"{time:.3f} s", MUTED, STAMP)
            canvas.paste(picture, (left + column * (width + _GAP), y))
    return image


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


def stacked(images: Sequence[Image]) -> Bytes:
    """Pictures of the same width below one another."""
    canvas, y = Canvas(plain(images[0].width, sum(image.height for image in images), PAGE)), 0
    for image in images:
        canvas.paste(image, (0, y))
        y += image.height
    return canvas.pixels()


def check_tile(width: int) -> None:
    """Refuses widths of pictures in which nothing can be seen."""
    if width < LEAST_WIDTH:
        raise ArgumentError(f"width is {width} px; a picture of a sheet must be at least {LEAST_WIDTH} px wide")
