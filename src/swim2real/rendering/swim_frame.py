"""One moment of a simulated swim beside the real one: bodies above, courses below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import PAGE, Bytes, Canvas, plain, text_size
from swim2real.rendering.labels import (
    check_width,
    draw_legend,
    draw_legends,
    draw_moment,
    draw_scale_bar,
    gap_of,
    text_height,
)
from swim2real.rendering.panel import GRID_STEP, MUTED, SIDES, Panel
from swim2real.rendering.swim_panel import body_panel, course_panel, distance
from swim2real.rendering.swim_view import Limits, SwimView

if TYPE_CHECKING:
    from PIL.Image import Image

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
    size, gap = text_height(width), gap_of(width)
    head, panel = round(2 * size), Panel(limits.body, width - 2 * gap)
    below = draw_courses(view, index, limits, width)
    height = head + panel.height + below.height
    canvas = Canvas(plain(width, height + height % 2, PAGE))
    draw_moment(canvas, view.name, f"   {view.frequency:.2f} Hz", view.times[index], index, size)
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
    canvas = Canvas(image)
    draw_legends(canvas, size)
    canvas.text((panel.width - 0.6 * size, size), "head at the left", MUTED, 0.8 * size, (1, 0.5))
    draw_scale_bar(canvas, panel, f"{GRID_STEP:g} m", size)
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
    size, gap = text_height(width), gap_of(width)
    panel = Panel(limits.course, (width - 3 * gap) // 2)
    head = round(2 * size)
    image = plain(width, head + panel.height + gap, PAGE)
    canvas, end = Canvas(image), 0.0
    for side, left in zip(SIDES, (gap, width - gap - panel.width), strict=True):
        far = distance(view, index, side)
        text = f"{side}: {far:.2f} m".replace("-0.00", "0.00") if np.isfinite(far) else side
        end = draw_legend(canvas, (left, head / 2), side, text, size)
        canvas.paste(course_panel(view, index, side, panel, size), (left, head))
    if end + size < width - gap - text_size(GRID_NOTE, size)[0]:
        canvas.text((width - gap, head / 2), GRID_NOTE, MUTED, size, (1, 0.5))
    return image
