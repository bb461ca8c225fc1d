"""Shapes with soft edges: how much of each pixel a disc, a tapered line or a patch of light covers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.rendering.pool_water import Rect

Array = NDArray[np.float64]
Image32 = NDArray[np.float32]

WAVY = (0.06, 0.04)  # of a patch's radius, how far its edge runs in and out
SOFT = 0.12  # of a patch's radius, the width of its edge


def box(points: Array, reach: float, inside: Rect) -> Rect:
    """The pixels within `reach` of any point, as far as they are inside another box. Shape of points: (..., 2) [px]."""
    flat = points.reshape(-1, 2)
    low, high = np.floor(flat.min(axis=0) - reach).astype(int), np.ceil(flat.max(axis=0) + reach).astype(int) + 1
    return Rect(
        max(int(low[0]), inside.x0), max(int(low[1]), inside.y0),
        min(int(high[0]), inside.x1), min(int(high[1]), inside.y1),
    )  # fmt: skip


def grid(rect: Rect) -> tuple[Image32, Image32]:
    """Pixel centers: x, shape (w,), and y, shape (h, 1)."""
    return np.arange(rect.x0, rect.x1, dtype=np.float32), np.arange(rect.y0, rect.y1, dtype=np.float32)[:, None]


def disc(centers: Array, radius: float, rect: Rect) -> Image32:
    """A disc's coverage, averaged over its places while the shutter is open.

    Args:
        centers: Places [px]. Shape (S, 2).
        radius: [px].
        rect: Where.

    Returns:
        From 0 to 1. Shape (h, w).
    """
    x, y = grid(rect)
    cover = np.zeros((y.size, x.size), dtype=np.float32)
    for cx, cy in centers:
        away = np.sqrt((x - np.float32(cx)) ** 2 + (y - np.float32(cy)) ** 2)
        cover += np.clip(np.float32(radius + 0.5) - away, 0.0, 1.0)
    return cover / np.float32(len(centers))


def hull(spine: Array, radii: Array, blur: Array, rect: Rect) -> tuple[Image32, Image32]:
    """A body of changing width around a line.

    Args:
        spine: Points of the line [px]. Shape (N, 2).
        radii: Half width of the body at each [px]. Shape (N,).
        blur: How far each moves while the shutter is open [px]; the edges are that soft. Shape (N,).
        rect: Where.

    Returns:
        Coverage, and how near the spine a pixel is: 1 on it, 0 at the edge and outside. Shapes (h, w).
    """
    cover = np.zeros((rect.y1 - rect.y0, rect.x1 - rect.x0), dtype=np.float32)
    ridge = np.zeros_like(cover)
    for a, b, ra, rb, soft in zip(
        spine[:-1], spine[1:], radii[:-1], radii[1:], 1 + (blur[:-1] + blur[1:]) / 2, strict=True
    ):
        part = box(np.stack([a, b]), max(ra, rb) + soft, rect)
        if part.empty:
            continue
        x, y = grid(part)
        (ax, ay), (dx, dy) = a.astype(np.float32), (b - a).astype(np.float32)
        x, y = x - ax, y - ay
        square = max(float(dx * dx + dy * dy), 1e-12)
        share = np.clip(x * (dx / square) + y * (dy / square), 0.0, 1.0, dtype=np.float32)
        away = np.sqrt((x - share * dx) ** 2 + (y - share * dy) ** 2)
        inner = share * np.float32(rb - ra) + np.float32(ra) - away
        window = part.within(rect)
        np.maximum(ridge[window], inner * np.float32(2 / (ra + rb)), out=ridge[window])
        # a strip that moves by more than its width covers no pixel for the whole exposure
        rise = min(soft, ra + rb)
        covered = np.clip((inner + np.float32(soft / 2)) * np.float32(1 / rise), 0.0, 1.0)
        np.maximum(cover[window], covered * np.float32(rise / soft), out=cover[window])
    return cover, ridge


@dataclass(frozen=True)
class Patch:
    """A patch of light.

    Attributes:
        center: [px]. Shape (2,).
        radius: On average, up and down [px].
        stretch: How many times wider it is than high.
        turn: Phase of the waves along its edge [rad].
        strength: What it covers in its middle, 0 to 1.
    """

    center: Array
    radius: float
    stretch: float
    turn: float
    strength: float

    def box(self, inside: Rect) -> Rect:
        """The pixels that it touches."""
        reach = (1 + sum(WAVY) + SOFT / 2) * self.radius * np.array([self.stretch, 1.0])
        return box(np.stack([self.center - reach, self.center + reach]), 1.0, inside)


def patch_cover(x: Image32 | Array, y: Image32 | Array, light: Patch) -> Image32:
    """How much a patch of light with a wavy edge covers.

    Args:
        x: Of the pixels [px].
        y: Of the pixels [px]; a shape that broadcasts with that of `x`.
        light: The patch.

    Returns:
        From 0 to 1, in the common shape of `x` and `y`.
    """
    dx, dy = ((x - light.center[0]) / light.stretch).astype(np.float32), (y - light.center[1]).astype(np.float32)
    angle = np.arctan2(dy, dx)
    edge = 1 + WAVY[0] * np.sin(2 * angle + light.turn) + WAVY[1] * np.sin(3 * angle - 1.7 * light.turn)
    soft = max(SOFT * light.radius, 1.0)
    cover = np.clip((edge * light.radius - np.hypot(dx, dy)) / soft + 0.5, 0.0, 1.0)
    return (light.strength * cover).astype(np.float32)


def patch_radius(reach: float) -> float:
    """The radius of a patch that covers all within `reach` of its center."""
    return reach / (1 - sum(WAVY) - SOFT / 2) + 0.5


def paint(image: Image32, rect: Rect, cover: Image32, part: Rect, color: Sequence[float]) -> None:
    """Lays a color over a part of an image, as much as `cover` says.

    Args:
        image: Shape (3, h, w), changed in place.
        rect: What of the frame the image shows.
        cover: Shape of `part`.
        part: Where, within `rect`.
        color: RGB.
    """
    for channel, value in zip(image, color, strict=True):
        below = channel[part.within(rect)]
        below += cover * (np.float32(value) - below)
