"""What is written in pictures of trials: headings, legends, scale bars, and how large."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Canvas, plain, text_size
from swim2real.rendering.panel import COLORS, MUTED, SIDES, Panel, Side, draw_body

if TYPE_CHECKING:
    from PIL.Image import Image

LEAST_WIDTH = 320  # px


def draw_heading(text: str, note: str, width: int) -> Image:
    """The heading of a sheet: a text, the legend, and a note at the right.

    Args:
        text: What it says.
        note: Of the grid.
        width: Of the picture [px].
    """
    size, gap = text_height(width), gap_of(width)
    image = plain(width, round(2 * size), PAGE)
    canvas, y = Canvas(image), round(2 * size) / 2
    x = width - gap - text_size(note, size)[0]
    canvas.text((x, y), note, MUTED, size, (0, 0.5))
    for side in SIDES[::-1]:
        x -= 3.5 * size + text_size(side, size)[0]
        draw_legend(canvas, (x, y), side, side, size)
    canvas.text((gap, y), shortened(text, size, x - 2 * gap), INK, size, (0, 0.5))
    return image


def draw_moment(canvas: Canvas, name: str, about: str, time: float, index: int, size: float) -> None:
    """The head of a frame: the trial at the left, shortened where it is long, and the moment at the right.

    Args:
        canvas: On which it is drawn.
        name: Of the trial.
        about: What follows the name.
        time: Of the moment [s].
        index: Of the sample.
        size: Of the text [px].
    """
    gap, y = gap_of(canvas.width), round(2 * size) / 2
    state = f"{time:.3f} s   frame {index}"
    canvas.text((canvas.width - gap, y), state, INK, size, (1, 0.5))
    room = canvas.width - 3 * gap - text_size(state, size)[0]
    shown = shortened(name, size, room - text_size(about, size)[0])
    canvas.text((gap, y), shown + about, INK, size, (0, 0.5))


def draw_legends(canvas: Canvas, size: float) -> None:
    """Both legends at the top left [px]."""
    x = 0.6 * size
    for side in SIDES:
        x = draw_legend(canvas, (x, size), side, side, size) + size


def draw_legend(canvas: Canvas, place: tuple[float, float], side: Side, text: str, size: float) -> float:
    """A short piece of body and what it is; the x at which it ends [px]."""
    x, y = place
    ends = np.array([[x, y], [x + 1.1 * size, y], [x + 2.2 * size, y]])
    ends[[0, 2], :] += [[0.35 * size, 0], [-0.35 * size, 0]]
    draw_body(canvas, ends, side, float(np.clip(size / 20, 0.6, 1.0)))
    canvas.text((x + 2.5 * size, y), text, COLORS[side], size, (0, 0.5))
    return x + 2.5 * size + text_size(text, size)[0]


def draw_scale_bar(canvas: Canvas, panel: Panel, text: str, size: float) -> None:
    """A bar as long as a step of the grid, at the bottom left, and what it says [px]."""
    left, bottom, length = round(0.6 * size), panel.height - round(0.7 * size), round(panel.step * panel.scale)
    canvas.fill((left, bottom - 1, left + length + 1, bottom + 1), INK)
    for end in (left, left + length):
        canvas.fill((end, bottom - 5, end + 1, bottom + 5), INK)
    canvas.text((left + length + 0.5 * size, bottom), text, INK, size, (0, 0.5))


def shortened(text: str, size: float, room: float) -> str:
    """A text whose end is cut off if there is no room for it [px]."""
    cut = text
    while len(cut) > 4 and text_size(cut, size)[0] > room:
        cut = cut.removesuffix("...")[:-1] + "..."
    return cut


def text_height(width: int) -> float:
    """Size of the text in a picture [px]."""
    return float(np.clip(round(width / 36), 11, 22))


def gap_of(width: int) -> int:
    """To the edges of a picture [px]."""
    return round(width / 80)


def check_width(width: int) -> None:
    """Refuses widths in which the text has no room."""
    if width < LEAST_WIDTH or width % 2:
        raise ArgumentError(f"width is {width} px; it must be even and at least {LEAST_WIDTH}")
