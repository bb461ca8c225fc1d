"""How the head swings over time, real and simulated: a chart each of its heading and of its place to the side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image

from swim2real.rendering.drawing import INK, PAGE, Canvas, plain
from swim2real.rendering.panel import COLORS, GRID, GROUND, MUTED, SIDES, points

Array = NDArray[np.float64]

_HEIGHT = 4.0  # of a chart, in sizes of its text


class Swing(NamedTuple):
    """One way in which the head swings, in the unit that its scale is told in.

    Attributes:
        name: What swings.
        unit: Unit of the values.
        real: Real values, NaN where unknown. Shape (T,).
        simulated: Simulated values. Shape (T,).
    """

    name: str
    unit: str
    real: Array
    simulated: Array

    @property
    def size(self) -> float:
        """The largest known value, to either side; 0 where nothing is known."""
        return float(np.nanmax(np.abs([self.real, self.simulated]), initial=0.0))


def swing_chart(swing: Swing, times: Array, top: float, width: int, size: float) -> Image:
    """Both curves over time, left or counterclockwise up.

    Args:
        swing: What swings.
        times: Rising [s]. Shape (T,).
        top: Value at the upper edge; its negative is at the lower one.
        width: Width of the picture [px].
        size: Size of the text [px].
    """
    head, height = round(1.4 * size), round(_HEIGHT * size)
    image = plain(width, height, PAGE)
    canvas = Canvas(image)
    canvas.fill((0, head, width, height), GROUND)
    middle = (head + height) / 2
    canvas.fill((0, round(middle), width, round(middle) + 1), GRID)
    x = (times - times[0]) / (times[-1] - times[0]) * (width - 1)
    for side in SIDES:
        level = np.clip(getattr(swing, side) / top, -1.0, 1.0)
        canvas.polyline(points(np.stack([x, middle - level * (height - head) / 2], axis=1)), COLORS[side], 1.6)
    canvas.text((0, head / 2), swing.name, INK, 0.9 * size, (0, 0.5))
    canvas.text((width, head / 2), f"edges ±{top:g} {swing.unit}", MUTED, 0.8 * size, (1, 0.5))
    return image
