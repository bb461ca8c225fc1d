"""Panels of the pictures of trials: a part of the plane with a grid, and real and simulated bodies in it.

Red and blue are a pair that people with any color blindness tell apart. In gray the shapes do: real markers are rings
on a thin line, simulated ones dots on a thick line. Rings are larger, so a dot that is right sits in its ring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from swim2real.rendering.drawing import Canvas, Color, Place, plain, text_size
from swim2real.rendering.view import Box

if TYPE_CHECKING:
    from PIL.Image import Image

Array = NDArray[np.float64]
Side = Literal["real", "simulated"]

COLORS: dict[Side, Color] = {"real": (213, 43, 30), "simulated": (0, 84, 190)}
SIDES: tuple[Side, Side] = ("real", "simulated")
GROUND: Color = (255, 255, 255)
GRID: Color = (221, 226, 232)
MUTED: Color = (92, 104, 120)
START: Color = (150, 159, 170)
GRID_STEP = 0.1  # m
DIVERGED = "simulation diverged"
RADII: dict[Side, float] = {"real": 6.2, "simulated": 3.7}  # px, at the strength 1
LINES: dict[Side, float] = {"real": 1.9, "simulated": 2.8}  # px, likewise


@dataclass(frozen=True)
class Panel:
    """A box of the plane as a picture: x to the right and y up, in the same scale.

    Attributes:
        box: What is shown.
        width: Of the picture [px].
        step: Of the grid [m].
    """

    box: Box
    width: int
    step: float = GRID_STEP

    @property
    def scale(self) -> float:
        """Pixels to a meter."""
        return self.width / (self.box.right - self.box.left)

    @property
    def height(self) -> int:
        """Of the picture [px]."""
        return max(1, round((self.box.top - self.box.bottom) * self.scale))

    @property
    def strength(self) -> float:
        """By which lines and markers of bodies are wider than usual."""
        return float(np.clip(self.width / 640, 0.45, 2.0))

    def places(self, points: Array) -> Array:
        """Where points of the plane are in the picture [px]. Shape (..., 2)."""
        return np.stack([points[..., 0] - self.box.left, self.box.top - points[..., 1]], axis=-1) * self.scale - 0.5

    def empty(self) -> Image:
        """The picture with nothing but a grid."""
        image = plain(self.width, self.height, GROUND)
        canvas = Canvas(image)
        for x in self._steps(self.box.left, self.box.right):
            column = round((x - self.box.left) * self.scale - 0.5)
            canvas.fill((column, 0, column + 1, self.height), GRID)
        for y in self._steps(self.box.bottom, self.box.top):
            row = round((self.box.top - y) * self.scale - 0.5)
            canvas.fill((0, row, self.width, row + 1), GRID)
        return image

    def _steps(self, low: float, high: float) -> list[float]:
        """Multiples of the grid's step within limits [m]."""
        first, last = int(np.ceil(low / self.step)), int(np.floor(high / self.step))
        return [k * self.step for k in range(first, last + 1)]


def draw_body(
    canvas: Canvas, places: Array, side: Side, strength: float, lines: Sequence[Sequence[int]] | None = None
) -> None:
    """A skeleton: markers without a position are left out, and the lines to them.

    Args:
        canvas: On which it is drawn.
        places: Of the markers [px]. Shape (M, 2).
        side: Its color and style.
        strength: By which lines and markers are wider than usual.
        lines: Markers that each line goes through; None for one through all of them.
    """
    color, radius, width = COLORS[side], RADII[side] * strength, LINES[side] * strength
    for line in [range(len(places))] if lines is None else lines:
        canvas.polyline(points(places[list(line)]), color, max(width, 1.0), opacity=0.8)
    for place in points(places[np.isfinite(places).all(axis=1)]):
        if side == "real":
            canvas.ring(place, radius, color, max(2.0 * strength, 1.0))
        else:
            canvas.dot(place, radius, color)


def name_lost(canvas: Canvas, lost: Sequence[str], count: int, size: float) -> None:
    """Says at the bottom right which real markers are lost, or how many of them where there is no room."""
    if not lost:
        return
    text = f"real lost: {', '.join(lost)}"
    if len(lost) == count or text_size(text, size)[0] > 0.8 * canvas.width:
        text = f"real lost: {len(lost)} of {count}"
    canvas.text((canvas.width - 0.5 * size, canvas.height - 0.4 * size), text, COLORS["real"], size, (1, 1))


def say_diverged(canvas: Canvas, y: float, size: float) -> None:
    """Says that there is no simulation, at a height [px]."""
    size = min(size, 0.9 * size * canvas.width / text_size(DIVERGED, size)[0])
    canvas.text((canvas.width / 2, y), DIVERGED, GROUND, size, (0.5, 0.5), COLORS["simulated"])


def points(places: Array) -> list[Place]:
    """Places as a canvas takes them. Shape (N, 2)."""
    return [(x, y) for x, y in places.tolist()]
