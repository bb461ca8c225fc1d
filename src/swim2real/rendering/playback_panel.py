"""Panels of the pictures of recordings: the playback's markers and links over the real ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim2real.rendering.drawing import Canvas, text_size
from swim2real.rendering.panel import (
    COLORS,
    LINES,
    MUTED,
    RADII,
    SIDES,
    Panel,
    Side,
    draw_body,
    name_lost,
    points,
    say_diverged,
)
from swim2real.rendering.playback_view import PlaybackView

if TYPE_CHECKING:
    from PIL.Image import Image

Array = NDArray[np.float64]

_STRAIGHT = 0.15  # of the mean of two directions: below it they are opposite ones


def strength_of(panel: Panel) -> float:
    """By which lines and markers are wider than usual: a robot may have few of them."""
    return float(np.clip(panel.width / 440, 0.7, 2.0))


def plane_panel(view: PlaybackView, index: int, panel: Panel, size: float = 0.0) -> Image:
    """Both over one another in the plane of comparison, each marker with its way just before.

    Args:
        view: The recording.
        index: Of the sample.
        panel: Where it is drawn.
        size: Of the text [px]; 0 for none but what is needed.
    """
    places = {"real": panel.places(view.real), "simulated": panel.places(view.simulated)}
    image = _drawn(view, index, panel, {side: places[side] for side in SIDES}, view.trail(index))
    canvas = Canvas(image)
    if size:
        _name_markers(canvas, view, [places[side][index] for side in SIDES], panel, max(0.8 * size, 11.0))
        lost = [name for name, there in zip(view.marker_names, view.seen[index], strict=True) if not there]
        name_lost(canvas, lost, len(view.marker_names), size)
    if view.diverged:
        say_diverged(canvas, panel.height - 2.3 * size, max(size, 12.0))
    return image


def way_panel(view: PlaybackView, index: int, panel: Panel) -> Image:
    """Both as seen from their own first poses, with the way of the first marker so far.

    Args:
        view: A recording of a robot that travels.
        index: Of the sample.
        panel: Where it is drawn.
    """
    courses: dict[Side, Array | None] = {"real": view.course_real, "simulated": view.course_simulated}
    places: dict[Side, Array] = {side: panel.places(course) for side, course in courses.items() if course is not None}
    return _drawn(view, index, panel, places, slice(0, index + 1), [0])


def _drawn(
    view: PlaybackView, index: int, panel: Panel, places: Mapping[Side, Array], trail: slice,
    trailed: Sequence[int] | None = None,
) -> Image:  # fmt: skip
    """Bodies with the ways of some markers, or of all. Places of shape (T, M, 2)."""
    image = panel.empty()
    canvas, strength = Canvas(image), strength_of(panel)
    for side, ways in places.items():
        for marker in range(ways.shape[1]) if trailed is None else trailed:
            way = points(ways[trail, marker])
            canvas.polyline(way, COLORS[side], LINES[side] * strength, opacity=0.5, fade=True)
    for side, ways in places.items():
        draw_body(canvas, ways[index], side, strength, view.lines)
    return image


def _name_markers(canvas: Canvas, view: PlaybackView, bodies: Sequence[Array], panel: Panel, size: float) -> None:
    """Names beside the markers, outside of both bodies; those that would lie on an earlier one are left out."""
    known = [body[np.isfinite(body).all(axis=1)].mean(axis=0) for body in bodies if np.isfinite(body).any()]
    taken: list[tuple[float, float, float, float]] = []
    for m, name in enumerate(view.marker_names):
        here = [body[m] for body in bodies if np.isfinite(body[m]).all()]
        if not here:
            continue
        middle, out = np.mean(here, axis=0), _outward(view, m, bodies, np.mean(known, axis=0))
        width, height = text_size(name, size)[0], 0.9 * size
        reach = max(float((place - middle) @ out) for place in here) + 1.4 * RADII["real"] * strength_of(panel)
        x, y = (middle + (reach + float(np.abs(out) @ (width, height)) / 2) * out).tolist()
        x = min(max(x, width / 2 + 2), canvas.width - width / 2 - 2)
        y = min(max(y, height / 2 + 2), canvas.height - height / 2 - 2)
        box = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        if not any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
            taken.append(box)
            canvas.text((x, y), name, MUTED, size, (0.5, 0.5))


def _outward(view: PlaybackView, marker: int, bodies: Sequence[Array], center: Array) -> Array:
    """A direction that leads away from the links of a marker: beyond an end, else to one side. Shape (2,)."""
    near = sorted({a + b - marker for a, b in view.links if marker in (a, b)})
    ways = [body[other] - body[marker] for body in bodies for other in near if np.isfinite(body[[marker, other]]).all()]
    if not ways:
        here = [body[marker] for body in bodies if np.isfinite(body[marker]).all()]
        out = np.mean(here, axis=0) - center
    elif len(near) == 1:
        out = -np.mean(ways, axis=0)
    else:  # outside of the bend, or across a straight line
        out = -np.mean([way / np.hypot(*way) for way in ways], axis=0)
        if np.hypot(*out) < _STRAIGHT:
            out = np.array([ways[0][1], -ways[0][0]])
    length = float(np.hypot(*out))
    return out / length if length > 1e-9 else np.array([0.0, -1.0])
