"""Panels of the pictures of trials: a part of the plane with a grid, real and simulated bodies in it, and labels.

Red and blue are a pair that people with any color blindness tell apart. In gray the shapes do: real markers are rings
on a thin line, simulated ones dots on a thick line. Rings are larger, so a dot that is right sits in its ring.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Canvas, Color, Place, plain, text_size

Array = NDArray[np.float64]
Side = Literal["real", "simulated"]

COLORS: dict[Side, Color] = {"real": (213, 43, 30), "simulated": (0, 84, 190)}
SIDES: tuple[Side, Side] = ("real", "simulated")
GROUND: Color = (255, 255, 255)
GRID: Color = (221, 226, 232)
MUTED: Color = (92, 104, 120)
START: Color = (150, 159, 170)
DIVERGED = "simulation diverged"
LEAST_WIDTH = 320  # px
RADII: dict[Side, float] = {"real": 6.2, "simulated": 3.7}  # px, at the strength 1
LINES: dict[Side, float] = {"real": 1.9, "simulated": 2.8}  # px, at the strength 1


@dataclass(frozen=True)
class Box:
    """A part of the plane [m]."""

    left: float
    bottom: float
    right: float
    top: float

    def __post_init__(self) -> None:
        if not (self.left < self.right and self.bottom < self.top):
            raise ArgumentError(
                f"a box from ({self.left:g}, {self.bottom:g}) to ({self.right:g}, {self.top:g}) m holds nothing; left "
                "must be below right and bottom below top"
            )


@dataclass(frozen=True)
class Panel:
    """A box of the plane as a picture: x to the right and y up, in the same scale.

    Attributes:
        box: What is shown.
        width: Width of the picture [px].
        step: Step of the grid [m].
    """

    box: Box
    width: int
    step: float

    @property
    def scale(self) -> float:
        """Pixels to a meter."""
        return self.width / (self.box.right - self.box.left)

    @property
    def height(self) -> int:
        """Height of the picture [px]."""
        return max(1, round((self.box.top - self.box.bottom) * self.scale))

    @property
    def strength(self) -> float:
        """By which lines and markers of bodies are wider than usual."""
        return float(np.clip(self.width / 600, 0.5, 2.0))

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


def draw_body(canvas: Canvas, places: Array, side: Side, strength: float, lines: Sequence[Sequence[int]]) -> None:
    """A skeleton: markers without a position are left out, and the lines to them.

    Args:
        canvas: The canvas that is drawn on.
        places: Places of the markers [px]. Shape (M, 2).
        side: The side whose color and style it has.
        strength: Factor by which lines and markers are wider than usual.
        lines: Indices of the markers that each line goes through.
    """
    color, radius, width = COLORS[side], RADII[side] * strength, LINES[side] * strength
    for line in lines:
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


def draw_heading(text: str, note: str, width: int) -> Image:
    """The heading of a sheet: a text, the legend, and a note at the right.

    Args:
        text: What it says.
        note: What the axes and the grid are.
        width: Width of the picture [px].
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
        canvas: The canvas that is drawn on.
        name: Name of the trial.
        about: What follows the name.
        time: Time of the moment [s].
        index: Index of the sample.
        size: Size of the text [px].
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
    draw_body(canvas, ends, side, float(np.clip(size / 20, 0.6, 1.0)), [range(len(ends))])
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
