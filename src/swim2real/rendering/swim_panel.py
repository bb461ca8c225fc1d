"""Panels of the pictures of swims: both bodies over one another in the body frame, and the course of one of them.

Red and blue are a pair that people with any color blindness tell apart. In gray the shapes do: real markers are rings
on a thin line, simulated ones dots on a thick line. Rings are larger, so a dot that is right sits in its ring.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from swim2real.rendering.drawing import Canvas, Color, Place, plain, text_size
from swim2real.rendering.swim_view import Box, SwimView, heads

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
    """

    box: Box
    width: int

    @property
    def scale(self) -> float:
        """Pixels to a meter."""
        return self.width / (self.box.right - self.box.left)

    @property
    def height(self) -> int:
        """Of the picture [px]."""
        return max(1, round((self.box.top - self.box.bottom) * self.scale))

    def places(self, points: Array) -> Array:
        """Where points of the plane are in the picture [px]. Shape (..., 2)."""
        return np.stack([points[..., 0] - self.box.left, self.box.top - points[..., 1]], axis=-1) * self.scale - 0.5

    def empty(self) -> Image:
        """The picture with nothing but a grid."""
        image = plain(self.width, self.height, GROUND)
        canvas = Canvas(image)
        for x in _steps(self.box.left, self.box.right):
            column = round((x - self.box.left) * self.scale - 0.5)
            canvas.fill((column, 0, column + 1, self.height), GRID)
        for y in _steps(self.box.bottom, self.box.top):
            row = round((self.box.top - y) * self.scale - 0.5)
            canvas.fill((0, row, self.width, row + 1), GRID)
        return image


def body_panel(view: SwimView, index: int, panel: Panel, size: float = 0.0) -> Image:
    """Both bodies over one another in the body frame, with the way of the last marker in the last beat.

    Args:
        view: The swim.
        index: Of the sample.
        panel: Where it is drawn.
        size: Of the text [px]; 0 for none but what is needed.
    """
    image = panel.empty()
    canvas, strength = Canvas(image), panel_strength(panel.width)
    bodies = {side: panel.places(getattr(view, side)) for side in SIDES}
    for side in SIDES:
        trail = bodies[side][view.last_beat(index), -1]
        canvas.polyline(_points(trail), COLORS[side], 1.2 * LINES[side] * strength, opacity=0.45, fade=True)
    for side in SIDES:
        draw_body(canvas, bodies[side][index], side, strength)
    if size:
        _name_markers(canvas, view, [bodies[side] for side in SIDES], index, max(0.8 * size, 11.0))
        lost = [name for name, there in zip(view.marker_names, view.seen[index], strict=True) if not there]
        if lost:
            text = f"real lost: {', '.join(lost)}"
            if len(lost) == len(view.marker_names) or text_size(text, size)[0] > 0.8 * panel.width:
                text = f"real lost: {len(lost)} of {len(view.marker_names)}"
            canvas.text((panel.width - 0.5 * size, panel.height - 0.4 * size), text, COLORS["real"], size, (1, 1))
    if view.diverged:
        _say_diverged(canvas, panel.height - 2.3 * size, max(size, 12.0))
    return image


def course_panel(view: SwimView, index: int, side: Side, panel: Panel, size: float = 0.0) -> Image:
    """One body in the world with its head's way so far, and two lines across: how far both heads have come.

    Args:
        view: The swim.
        index: Of the sample.
        side: Which body.
        panel: Where it is drawn.
        size: Of the text [px]; 0 for none but what is needed.
    """
    image = panel.empty()
    canvas, strength = Canvas(image), float(np.clip(panel.width / 600, 0.5, 1.2))
    start = round(panel.places(np.zeros(2))[0])
    canvas.fill((start, 0, start + 1, panel.height), START)
    for other in SIDES:
        reached = panel.places(_course_heads(view, other)[index])[0]
        if np.isfinite(reached):
            dashes = [(float(reached), float(y)) for k in range(0, panel.height, 6) for y in (k, k + 3, np.nan)]
            solid = [(float(reached), 0.0), (float(reached), float(panel.height))]
            canvas.polyline(dashes if other == "real" else solid, COLORS[other], 1.4, opacity=0.75)
    course = panel.places(getattr(view, f"course_{side}"))
    way = panel.places(_course_heads(view, side)[: index + 1])
    canvas.polyline(_points(way), COLORS[side], 2.0, opacity=0.55)
    draw_body(canvas, course[index], side, strength)
    if side == "simulated" and view.diverged:
        _say_diverged(canvas, panel.height / 2, max(size, 12.0))
    return image


def draw_body(canvas: Canvas, places: Array, side: Side, strength: float) -> None:
    """A skeleton: markers without a position are left out, and the lines to them.

    Args:
        canvas: On which it is drawn.
        places: Of the markers [px]. Shape (M, 2).
        side: Its color and style.
        strength: By which lines and markers are wider than usual.
    """
    color, radius, width = COLORS[side], RADII[side] * strength, LINES[side] * strength
    canvas.polyline(_points(places), color, max(width, 1.0), opacity=0.8)
    for place in _points(places[np.isfinite(places).all(axis=1)]):
        if side == "real":
            canvas.ring(place, radius, color, max(2.0 * strength, 1.0))
        else:
            canvas.dot(place, radius, color)


def panel_strength(width: int) -> float:
    """By which lines and markers of a body panel are wider than usual, for its width [px]."""
    return float(np.clip(width / 640, 0.45, 2.0))


def distance(view: SwimView, index: int, side: Side) -> float:
    """How far the head has come along the swim [m]; NaN where it isn't known."""
    return -float(_course_heads(view, side)[index, 0])


def _course_heads(view: SwimView, side: Side) -> Array:
    return heads(view.course_real if side == "real" else view.course_simulated)


def _name_markers(canvas: Canvas, view: SwimView, bodies: list[Array], index: int, size: float) -> None:
    """Names beside the markers, on both sides of the body by turns; only of the ends where there is no room."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a marker that isn't known
        usual = np.nanmedian(np.concatenate(bodies)[..., 0], axis=0)  # so that all frames have the same names
        middles = np.nanmean([body[index] for body in bodies], axis=0)
    sizes = [text_size(name, size) for name in view.marker_names]
    crowded = bool((usual[2:] - usual[:-2] < max(width for width, _ in sizes) + 0.3 * size).any())
    known = np.flatnonzero(np.isfinite(middles).all(axis=1)).tolist()
    for k, m in enumerate(known):
        if crowded and m not in (0, len(sizes) - 1):
            continue
        along = middles[known[min(k + 1, len(known) - 1)]] - middles[known[max(k - 1, 0)]]
        along = along / max(float(np.hypot(*along)), 1e-9)
        out = np.array([along[1], -along[0]]) * (-1 if m % 2 else 1)  # to the left of the fish, or to its right
        reach = float(np.nanmax([(body[index, m] - middles[m]) @ out for body in bodies]))
        reach += 1.3 * RADII["real"] * panel_strength(canvas.width) + 0.5 * float(
            np.abs(out) @ (sizes[m][0], 0.8 * size)
        )
        x, y = (middles[m] + reach * out).tolist()
        y = min(max(y, 0.6 * size), canvas.height - 0.6 * size)
        canvas.text((x, y), view.marker_names[m], MUTED, size, (0.5, 0.5))


def _say_diverged(canvas: Canvas, y: float, size: float) -> None:
    size = min(size, 0.9 * size * canvas.width / text_size(DIVERGED, size)[0])
    canvas.text((canvas.width / 2, y), DIVERGED, GROUND, size, (0.5, 0.5), COLORS["simulated"])


def _steps(low: float, high: float) -> list[float]:
    """Multiples of the grid's step within limits [m]."""
    first, last = int(np.ceil(low / GRID_STEP)), int(np.floor(high / GRID_STEP))
    return [k * GRID_STEP for k in range(first, last + 1)]


def _points(places: Array) -> list[Place]:
    return [(x, y) for x, y in places.tolist()]
