"""One moment of a simulated swim beside the real one: bodies above, courses below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Bytes, Canvas, plain, text_size
from swim2real.rendering.swim_panel import (
    COLORS,
    GRID_STEP,
    MUTED,
    SIDES,
    Panel,
    Side,
    body_panel,
    course_panel,
    distance,
    draw_body,
)
from swim2real.rendering.swim_view import Limits, SwimView

if TYPE_CHECKING:
    from PIL.Image import Image

LEAST_WIDTH = 320  # px
GRID_NOTE = f"grid {GRID_STEP:g} m"


def draw_frame(view: SwimView, index: int, limits: Limits, width: int) -> Bytes:
    """Draws one sample of a swim.

    Above, in the body frame, the simulated body in blue over the real one in red, with the way of the last marker in
    the last beat. Below are the courses (`draw_courses`).

    Args:
        view: The swim.
        index: Of the sample.
        limits: What is shown; `common_limits` of all trials makes them comparable.
        width: Of the picture, even [px].

    Returns:
        The picture, RGB, of even sizes. Shape (H, width, 3).

    Raises:
        ArgumentError: There is no such sample, or the width is odd or too small.
        MissingExtraError: Pillow isn't installed.
    """
    check_width(width)
    if not 0 <= index < view.times.size:
        raise ArgumentError(f"index is {index}; view '{view.name}' has samples 0 to {view.times.size - 1}")
    size, gap = text_height(width), _gap(width)
    head, panel = round(2 * size), Panel(limits.body, width - 2 * gap)
    below = draw_courses(view, index, limits, width)
    height = head + panel.height + below.height
    canvas = Canvas(plain(width, height + height % 2, PAGE))
    state = f"{view.times[index]:.3f} s   frame {index}"
    canvas.text((width - gap, head / 2), state, INK, size, (1, 0.5))
    room = width - 3 * gap - text_size(state, size)[0]
    frequency = f"   {view.frequency:.2f} Hz"
    name = shortened(view.name, size, room - text_size(frequency, size)[0])
    canvas.text((gap, head / 2), name + frequency, INK, size, (0, 0.5))
    canvas.paste(draw_body_panel(view, index, panel, size), (gap, head))
    canvas.paste(below, (0, head + panel.height))
    return canvas.pixels()


def draw_body_panel(view: SwimView, index: int, panel: Panel, size: float) -> Image:
    """The bodies over one another, with marker names, a legend and a scale bar.

    Args:
        view: The swim.
        index: Of the sample.
        panel: Where it is drawn.
        size: Of the text [px].
    """
    image = body_panel(view, index, panel, size)
    canvas, x = Canvas(image), 0.6 * size
    for side in SIDES:
        x = _legend(canvas, (x, size), side, side, size) + size
    canvas.text((panel.width - 0.6 * size, size), "head at the left", MUTED, 0.8 * size, (1, 0.5))
    left, bottom, length = round(0.6 * size), panel.height - round(0.7 * size), round(GRID_STEP * panel.scale)
    canvas.fill((left, bottom - 1, left + length + 1, bottom + 1), INK)
    for end in (left, left + length):
        canvas.fill((end, bottom - 5, end + 1, bottom + 5), INK)
    canvas.text((left + length + 0.5 * size, bottom), f"{GRID_STEP:g} m", INK, size, (0, 0.5))
    return image


def draw_courses(view: SwimView, index: int, limits: Limits, width: int) -> Image:
    """The real course at the left and the simulated one at the right, in the world and in one scale.

    The head's way so far is drawn, and lines across at both sides: how far either head has come. A lead is thus seen at
    once. The thin gray line is where they began.

    Args:
        view: The swim.
        index: Of the sample.
        limits: What is shown.
        width: Of the picture [px].
    """
    size, gap = text_height(width), _gap(width)
    panel = Panel(limits.course, (width - 3 * gap) // 2)
    head = round(2 * size)
    image = plain(width, head + panel.height + gap, PAGE)
    canvas, end = Canvas(image), 0.0
    for side, left in zip(SIDES, (gap, width - gap - panel.width), strict=True):
        far = distance(view, index, side)
        text = f"{side}: {far:.2f} m".replace("-0.00", "0.00") if np.isfinite(far) else side
        end = _legend(canvas, (left, head / 2), side, text, size)
        canvas.paste(course_panel(view, index, side, panel, size), (left, head))
    if end + size < width - gap - text_size(GRID_NOTE, size)[0]:
        canvas.text((width - gap, head / 2), GRID_NOTE, MUTED, size, (1, 0.5))
    return image


def draw_heading(text: str, width: int) -> Image:
    """The heading of a sheet: a text, and the legend at the right.

    Args:
        text: What it says.
        width: Of the picture [px].
    """
    size, gap = text_height(width), _gap(width)
    image = plain(width, round(2 * size), PAGE)
    canvas, y = Canvas(image), round(2 * size) / 2
    x = width - gap - text_size(GRID_NOTE, size)[0]
    canvas.text((x, y), GRID_NOTE, MUTED, size, (0, 0.5))
    for side in SIDES[::-1]:
        x -= 3.5 * size + text_size(side, size)[0]
        _legend(canvas, (x, y), side, side, size)
    canvas.text((gap, y), shortened(text, size, x - 2 * gap), INK, size, (0, 0.5))
    return image


def shortened(text: str, size: float, room: float) -> str:
    """A text whose end is cut off if there is no room for it [px]."""
    cut = text
    while len(cut) > 4 and text_size(cut, size)[0] > room:
        cut = cut.removesuffix("...")[:-1] + "..."
    return cut


def text_height(width: int) -> float:
    """Size of the text in a picture [px]."""
    return float(np.clip(round(width / 36), 11, 22))


def check_width(width: int) -> None:
    """Refuses widths in which the text has no room."""
    if width < LEAST_WIDTH or width % 2:
        raise ArgumentError(f"width is {width} px; it must be even and at least {LEAST_WIDTH}")


def _gap(width: int) -> int:
    return round(width / 80)


def _legend(canvas: Canvas, place: tuple[float, float], side: Side, text: str, size: float) -> float:
    """A short piece of body and what it is; the x at which it ends [px]."""
    x, y = place
    ends = np.array([[x, y], [x + 1.1 * size, y], [x + 2.2 * size, y]])
    ends[[0, 2], :] += [[0.35 * size, 0], [-0.35 * size, 0]]
    draw_body(canvas, ends, side, float(np.clip(size / 20, 0.6, 1.0)))
    canvas.text((x + 2.5 * size, y), text, COLORS[side], size, (0, 0.5))
    return x + 2.5 * size + text_size(text, size)[0]
