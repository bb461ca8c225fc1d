"""A map of a robot's markers at rest: names, the lines that join them, the camera's axes and a scale bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, Bytes, Canvas, Color, Place, plain, text_size

Array = NDArray[np.float64]
Rectangle = tuple[float, float, float, float]

GROUND: Color = (255, 255, 255)
DOT: Color = (0, 84, 190)
LINE: Color = (150, 159, 170)
MUTED: Color = (92, 104, 120)
LEAST_SPAN = 0.01  # m, of a map of markers in one spot
_LEAST_SHARE, _MOST_SHARE = 0.3, 0.8  # the map's height, as a share of its width
_BORDER = 0.12  # of the width, around the markers
_RADIUS = 0.006  # of the width
_TEXT = 0.018  # of the width


def marker_map(
    positions: Array, names: Sequence[str], links: Sequence[tuple[int, int]], axes: tuple[str, str], title: str,
    width: int = 1000,
) -> Bytes:  # fmt: skip
    """Draws markers as a camera sees them.

    Args:
        positions: In the plane [m]. Shape (M, 2).
        names: Names of the M markers.
        links: Pairs of markers that a line joins.
        axes: Names of what is to the right and up.
        title: A line above.
        width: Width of the picture [px].

    Returns:
        RGB. Shape (H, W, 3).

    Raises:
        ArgumentError: Positions are missing or not finite, or the picture is too small.
    """
    points = np.array(positions, dtype=float)
    if points.shape != (len(names), 2) or not names or not np.isfinite(points).all():
        raise ArgumentError(f"{len(names)} names for positions of shape {points.shape}; give each marker a finite one")
    if width < 200:
        raise ArgumentError(f"width is {width} px; it must be 200 or more")
    low, span = points.min(axis=0), np.maximum(np.ptp(points, axis=0), LEAST_SPAN)
    border = _BORDER * width
    height = float(np.clip(span[1] / span[0] * (width - 2 * border) + 2.5 * border,
                           _LEAST_SHARE * width, _MOST_SHARE * width))  # fmt: skip
    scale = float(min((width - 2 * border) / span[0], (height - 2.5 * border) / span[1]))
    middle = low + np.ptp(points, axis=0) / 2
    places = np.array([width / 2, height / 2]) + (points - middle) * [scale, -scale]
    size, canvas = _TEXT * width, Canvas(plain(width, round(height), GROUND))
    for first, second in links:
        canvas.polyline([_place(places[first]), _place(places[second])], LINE, 0.3 * _RADIUS * width)
    for place in places:
        canvas.dot(_place(place), _RADIUS * width, DOT)
    canvas.text((size, size), title, INK, size)
    taken = [_scale_bar(canvas, scale, size), _axes(canvas, axes, size)]
    lines = [_around(point, 1.0) for first, second in links for point in _between(places[first], places[second])]
    _name(canvas, places, names, taken, lines, size)
    return canvas.pixels()


def nice_length(most: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that isn't longer than this [m]."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1, 2, 5) if step * power <= most))


def _scale_bar(canvas: Canvas, scale: float, size: float) -> Rectangle:
    """A bar at the lower left, and what it covers [px]."""
    length = nice_length(0.25 * canvas.width / scale)
    end, y = size + length * scale, canvas.height - size
    canvas.polyline([(size, y - 0.4 * size), (size, y), (end, y), (end, y - 0.4 * size)], INK, 0.12 * size)
    text = f"{length:g} m" if length >= 1 else f"{1e3 * length:g} mm"
    canvas.text(((size + end) / 2, y - 0.5 * size), text, INK, size, (0.5, 1.0))
    return (0.0, y - 2.5 * size, end + size, float(canvas.height))


def _axes(canvas: Canvas, names: tuple[str, str], size: float) -> Rectangle:
    """Two arrows at the lower right, and what they cover [px]."""
    x, y, length, head = canvas.width - 5.5 * size, canvas.height - 1.5 * size, 2.8 * size, 0.35 * size
    for (dx, dy), name in zip(((1, 0), (0, -1)), names, strict=True):
        tip = (x + length * dx, y + length * dy)
        canvas.polyline([(x, y), tip], MUTED, 0.12 * size)
        wings = [(tip[0] - head * (dx + side * dy), tip[1] - head * (dy + side * dx)) for side in (-1, 1)]
        canvas.polyline([wings[0], tip, wings[1]], MUTED, 0.12 * size)
        canvas.text(
            (tip[0] + 0.7 * size * dx, tip[1] + 0.7 * size * dy), name, MUTED, size, (0.5 - dx / 2, 0.5 - dy / 2)
        )
    return (x - size, y - length - 2 * size, float(canvas.width), float(canvas.height))


def _name(
    canvas: Canvas, places: Array, names: Sequence[str], taken: list[Rectangle], lines: list[Rectangle], size: float
) -> None:
    """Names beside the markers, where there is room; a thin line leads to one that stands apart."""
    taken = taken + [_around(place, _RADIUS * canvas.width) for place in places]
    for place, name in zip(places, names, strict=True):
        box = _room(canvas, place, text_size(name, size)[0] + 0.6 * size, taken, lines, size)
        spot = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
        if np.hypot(*(spot - place)) > 2.5 * size + (box[2] - box[0]) / 2:
            canvas.polyline([_place(place), _place(spot)], LINE, 1.0)
        canvas.text(_place(spot), name, INK, size, (0.5, 0.5))
        taken.append(box)


def _room(
    canvas: Canvas, place: Array, width: float, taken: list[Rectangle], lines: list[Rectangle], size: float
) -> Rectangle:
    """The nearest free place for a text; best one that no line runs through."""
    tries: list[Rectangle] = []
    for distance in (1.3, 2.2, 3.4, 4.6, 6.0):
        for dx, dy in ((0, -1), (0, 1), (1, 0), (-1, 0), (1, -1), (-1, -1), (1, 1), (-1, 1)):
            x = place[0] + dx * (0.7 * (distance - 0.6) * size + width / 2)
            y = place[1] + dy * distance * size
            tries.append((x - width / 2, y - 0.6 * size, x + width / 2, y + 0.6 * size))
    inside = [box for box in tries
              if box[0] >= 0 and box[1] >= 2 * size and box[2] < canvas.width and box[3] < canvas.height]  # fmt: skip
    free = [box for box in inside if not any(_overlap(box, other) for other in taken)]
    clear = [box for box in free if not any(_overlap(box, line) for line in lines)]
    return (clear or free or tries)[0]


def _between(first: Array, second: Array) -> Array:
    """Points on a line, some pixels apart. Shape (N, 2)."""
    count = int(np.hypot(*(second - first)) / 4) + 2
    return first + np.linspace(0, 1, count)[:, None] * (second - first)


def _around(point: Array, reach: float) -> Rectangle:
    return (float(point[0]) - reach, float(point[1]) - reach, float(point[0]) + reach, float(point[1]) + reach)


def _overlap(a: Rectangle, b: Rectangle) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _place(point: Array) -> Place:
    return float(point[0]), float(point[1])
