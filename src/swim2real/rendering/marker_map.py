"""A map of a robot's markers at rest: names, the lines that join them, the camera's axes and a scale bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markertrack.drawing import INK, Bytes, Canvas, Color, plain, text_size
from swim2real.rendering.trial_frame import GROUND, MUTED
from swim2real.rendering.trial_view import length_text, rounded_up
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

DOT: Color = (0, 84, 190)
LINE: Color = (150, 159, 170)
_LEAD: Color = (205, 211, 218)
_LEAST_SPAN = 0.01  # m, of a map of markers in one spot
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
    low, span = points.min(axis=0), np.maximum(np.ptp(points, axis=0), _LEAST_SPAN)
    border = _BORDER * width
    height = float(np.clip(span[1] / span[0] * (width - 2 * border) + 2.5 * border,
                           _LEAST_SHARE * width, _MOST_SHARE * width))  # fmt: skip
    scale = float(min((width - 2 * border) / span[0], (height - 2.5 * border) / span[1]))
    middle = low + np.ptp(points, axis=0) / 2
    places = np.array([width / 2, height / 2]) + (points - middle) * [scale, -scale]
    size, canvas = _TEXT * width, Canvas(plain(width, round(height), GROUND))
    spots = _names_at(places, names, size, np.array([width, height]))
    for place, spot in zip(places.tolist(), spots.tolist(), strict=True):
        canvas.polyline([tuple(place), tuple(spot)], _LEAD, 1.0)
    for first, second in links:
        canvas.polyline([tuple(places[m].tolist()) for m in (first, second)], LINE, 0.3 * _RADIUS * width)
    for place, spot, name in zip(places.tolist(), spots.tolist(), names, strict=True):
        canvas.dot(tuple(place), _RADIUS * width, DOT)
        canvas.text(tuple(spot), name, INK, size, (0.5, 0.5), GROUND)
    canvas.text((size, size), title, INK, size)
    _draw_scale_bar(canvas, scale, size)
    _draw_axes(canvas, axes, size)
    return canvas.pixels()


def _names_at(places: Array, names: Sequence[str], size: float, picture: Array) -> Array:
    """Middles of the names, each as near to its marker as it hides no marker and no other name. Shape (M, 2)."""
    sides = np.array([(0, -1), (0, 1), (1, 0), (-1, 0), (1, -1), (-1, -1), (1, 1), (-1, 1)])
    taken = [(place, np.full(2, _RADIUS * picture[0])) for place in places]
    spots: list[Array] = []
    for place, name in zip(places, names, strict=True):
        half = np.array([text_size(name, size)[0] / 2 + 0.3 * size, 0.6 * size])
        tries = [place + side * (half + gap * size) for gap in (0.6, 1.6, 2.8, 4.0, 5.4) for side in sides]
        free = [
            spot for spot in tries
            if (spot >= half).all() and (spot <= picture - half).all()
            and not any((np.abs(spot - other) < half + reach).all() for other, reach in taken)
        ]  # fmt: skip
        spots.append((free or tries)[0])
        taken.append((spots[-1], half))
    return np.array(spots)


def _draw_scale_bar(canvas: Canvas, scale: float, size: float) -> None:
    """A bar at the lower left."""
    length = rounded_up(0.1 * canvas.width / scale)
    end, y = size + length * scale, canvas.height - size
    canvas.polyline([(size, y - 0.4 * size), (size, y), (end, y), (end, y - 0.4 * size)], INK, 0.12 * size)
    canvas.text(((size + end) / 2, y - 0.5 * size), length_text(length), INK, size, (0.5, 1.0))


def _draw_axes(canvas: Canvas, names: tuple[str, str], size: float) -> None:
    """Two arrows at the lower right."""
    x, y, length, head = canvas.width - 5.5 * size, canvas.height - 1.5 * size, 2.8 * size, 0.35 * size
    for (dx, dy), name in zip(((1, 0), (0, -1)), names, strict=True):
        tip = (x + length * dx, y + length * dy)
        canvas.polyline([(x, y), tip], MUTED, 0.12 * size)
        wings = [(tip[0] - head * (dx + side * dy), tip[1] - head * (dy + side * dx)) for side in (-1, 1)]
        canvas.polyline([wings[0], tip, wings[1]], MUTED, 0.12 * size)
        beside = (tip[0] + 0.7 * size * dx, tip[1] + 0.7 * size * dy)
        canvas.text(beside, name, MUTED, size, (0.5 - dx / 2, 0.5 - dy / 2))
