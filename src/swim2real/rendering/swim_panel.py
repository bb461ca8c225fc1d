"""Panels of the pictures of swims: both bodies over one another in the body frame, and the course of one of them."""

from __future__ import annotations

import warnings
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
    START,
    Panel,
    Side,
    draw_body,
    name_lost,
    points,
    say_diverged,
)
from swim2real.rendering.swim_view import SwimView, heads

if TYPE_CHECKING:
    from PIL.Image import Image

Array = NDArray[np.float64]


def body_panel(view: SwimView, index: int, panel: Panel, size: float = 0.0) -> Image:
    """Both bodies over one another in the body frame, with the way of the last marker in the last beat.

    Args:
        view: The swim.
        index: Of the sample.
        panel: Where it is drawn.
        size: Of the text [px]; 0 for none but what is needed.
    """
    image = panel.empty()
    canvas, strength = Canvas(image), panel.strength
    bodies = {side: panel.places(getattr(view, side)) for side in SIDES}
    for side in SIDES:
        trail = bodies[side][view.last_beat(index), -1]
        canvas.polyline(points(trail), COLORS[side], 1.2 * LINES[side] * strength, opacity=0.45, fade=True)
    for side in SIDES:
        draw_body(canvas, bodies[side][index], side, strength)
    if size:
        _name_markers(canvas, view, [bodies[side] for side in SIDES], index, panel.strength, max(0.8 * size, 11.0))
        lost = [name for name, there in zip(view.marker_names, view.seen[index], strict=True) if not there]
        name_lost(canvas, lost, len(view.marker_names), size)
    if view.diverged:
        say_diverged(canvas, panel.height - 2.3 * size, max(size, 12.0))
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
    canvas.polyline(points(way), COLORS[side], 2.0, opacity=0.55)
    draw_body(canvas, course[index], side, strength)
    if side == "simulated" and view.diverged:
        say_diverged(canvas, panel.height / 2, max(size, 12.0))
    return image


def distance(view: SwimView, index: int, side: Side) -> float:
    """How far the head has come along the swim [m]; NaN where it isn't known."""
    return -float(_course_heads(view, side)[index, 0])


def _course_heads(view: SwimView, side: Side) -> Array:
    return heads(view.course_real if side == "real" else view.course_simulated)


def _name_markers(
    canvas: Canvas, view: SwimView, bodies: list[Array], index: int, strength: float, size: float
) -> None:
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
        out = np.array([along[1], -along[0]]) * (-1 if m % 2 else 1)  # to the left of the body, or to its right
        reach = float(np.nanmax([(body[index, m] - middles[m]) @ out for body in bodies]))
        reach += 1.3 * RADII["real"] * strength + 0.5 * float(np.abs(out) @ (sizes[m][0], 0.8 * size))
        x, y = (middles[m] + reach * out).tolist()
        y = min(max(y, 0.6 * size), canvas.height - 0.6 * size)
        canvas.text((x, y), view.marker_names[m], MUTED, size, (0.5, 0.5))
