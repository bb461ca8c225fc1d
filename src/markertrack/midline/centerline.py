"""Centerlines of a shape: from each pair of its tips the curve that keeps to the middle, with widths.

Tips are the ends of the longest way through the shape, and what stands off from it by more than the width there: a fin,
a lobe, another animal that touches. The curve between two tips follows the ridge of the distance from the outline, is
moved to the middle of the contrast across it, and ends at the outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_lsq_spline
from scipy.ndimage import median_filter

from markertrack.midline.grid import Grid
from markertrack.midline.silhouette import Picture, Shape
from markertrack.tracking.tracker import Array, Mask

POINTS = 65  # of a curve
SPANS = 10  # of the splines: a body bends in no more detail
COARSE = 150.0  # px that the swimmer is long where tips are looked for
THINNEST = 4.0  # px that it is wide there
MOST_TIPS = 4
STANDS_OFF = 2.0  # half widths from the curve, from which something that stands off has a tip
FORKED = 2.2  # half widths from an end, within which a ridge may run into a corner
STRAIGHT = 0.6  # of the way that is left out there, which a straight one must have in the shape
BLUNT = 0.7  # half widths from an end, within which nothing lies across
EDGE = 0.3  # of the contrast inside, that the outline has
ROUNDS = 3  # of moving the curve to the middle
REACH = 1.6  # half widths to either side in which the outline is looked for


@dataclass(frozen=True)
class Curve:
    """A curve through a shape, from one end to the other.

    Attributes:
        points: At equal distances [px]. Shape (P, 2).
        widths: Width of the shape across them [px]. Shape (P,).
        length: [px].
        area: Area of the shape [px²].
        cut: Whether the shape touches the edge of the picture.
        apart: Distance of its points from what else stands out, up to some way [px]. Shape (P,).
        shape: Number of the shape among those of its picture.
    """

    points: Array
    widths: Array
    length: float
    area: float
    cut: bool
    apart: Array
    shape: int = 0

    @property
    def turned(self) -> Curve:
        """The same, from the other end."""
        return replace(self, points=self.points[::-1], widths=self.widths[::-1], apart=self.apart[::-1])


def curves(shapes: Sequence[Shape], length: float) -> list[Curve]:
    """Curves between tips of shapes, from either tip; the swimmer's length [px] decides how fine they are looked at."""
    return [replace(one, shape=k) for k, shape in enumerate(shapes) for one in _of_shape(shape, length)]


def _of_shape(shape: Shape, length: float) -> list[Curve]:
    share = min(1.0, max(COARSE / length, THINNEST * length / shape.area))
    mask = shape.mask
    if share < 1:
        size = tuple(max(4, round(share * n)) for n in mask.shape[::-1])
        mask = np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)) > 0.4
        mask = np.pad(_largest(mask)[1:-1, 1:-1], 1)
    if mask.sum() < 8:
        return []
    scale = np.array(shape.mask.shape[::-1]) / np.array(mask.shape[::-1])
    depth = np.asarray(cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5), dtype=float)
    grid = Grid(mask)
    half = depth[mask]
    found: list[Curve] = []
    for path in _ridges(grid, half):
        curve = _refined(shape, (grid.places[path] + 0.5) * scale - 0.5, half[path] * float(scale.mean()))
        if curve is not None:
            found += [curve, curve.turned]
    return found


def _largest(mask: Mask) -> Mask:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()) if count > 1 else mask


def _ridges(grid: Grid, half: Array) -> list[NDArray[np.int64]]:
    """Numbers of pixels along the ridge between every two tips."""
    core = int(half.argmax())
    first = int(np.where(np.isfinite(away := grid.away([core])), away, -1).argmax())
    second = int(np.where(np.isfinite(away := grid.away([first])), away, -1).argmax())
    costs = (half.max() / half) ** 2.0
    tips = [first, second]
    found = {(first, second): grid.paths(first, [second], costs)[0]}
    middle = found[first, second]
    while len(tips) < MOST_TIPS:
        away = np.where(np.isfinite(away := grid.away(middle)), away, 0.0)
        tip = int(away.argmax())
        foot = middle[np.hypot(*(grid.places[middle] - grid.places[tip]).T).argmin()]
        if away[tip] < STANDS_OFF * max(half[foot], 2.0):
            break
        ways = grid.paths(tip, tips, costs)
        found |= {(other, tip): way[::-1] for other, way in zip(tips, ways, strict=True)}
        tips.append(tip)
        middle = np.unique(np.concatenate([middle, *ways]))
    return [found[pair] for pair in combinations(tips, 2)]


def _refined(shape: Shape, path: Array, half: Array) -> Curve | None:
    """The curve near a path (N, 2) through a shape, half as wide as (N,) says."""
    travel = _travel(path)
    ends = [float(half[part].max()) for part in (travel < travel[-1] / 8, travel > travel[-1] * 7 / 8)]
    shares, inner, points = np.full(2, FORKED), np.ones(len(path), dtype=bool), path
    for _ in range(3):  # less where an end bends, so that a straight way leaves the shape at its side
        inner = _inner(travel, ends, shares)
        if inner.sum() < 8:
            return None
        points = _even(_spline(path[inner]))
        ways = [
            np.hypot(*(_extended(shape, one, end, 3 * end + 2) - one[-1]))
            for one, end in zip((points[::-1], points), ends, strict=True)
        ]
        cut_off = np.array([travel[inner][0], travel[-1] - travel[inner][-1]])
        shares = np.where(ways > STRAIGHT * cut_off, shares, shares / 2)
    half = np.interp(np.linspace(0, 1, POINTS), np.linspace(0, 1, int(inner.sum())), half[inner])
    for _ in range(ROUNDS):
        points = _to_the_ends(shape, points, ends)
        middles, half, seen = _across(shape, points, half)
        inner = _inner(_travel(points), ends, np.full(2, BLUNT))
        points = _even(_spline(middles[inner], np.where(seen[inner], 1.0, 0.05)))
    points = _to_the_ends(shape, points, ends)
    half = _across(shape, points, half)[1]
    length, apart = float(_travel(points)[-1]), _sampled(shape.apart, points[None])[0]
    return Curve(points + shape.corner, 2 * half, length, shape.area, shape.cut, apart)


def _to_the_ends(shape: Shape, points: Array, ends: list[float]) -> Array:
    """A curve (P, 2) that goes on straight to where it leaves the shape. Shape (P, 2)."""
    tips = [_extended(shape, one, end, 3 * end + 2) for one, end in zip((points[::-1], points), ends, strict=True)]
    return _even(np.concatenate([tips[:1], points, tips[1:]]))


def _inner(travel: Array, ends: list[float], shares: Array) -> Mask:
    """Places along a curve that aren't within shares of the half widths at its ends, a fifth of it at most."""
    begin, end = np.minimum(shares * ends, travel[-1] / 5)
    return (travel >= begin) & (travel <= travel[-1] - end)


def _travel(points: Array) -> Array:
    """Length along a line up to each of its points (N, 2). Shape (N,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def _across(shape: Shape, points: Array, half: Array) -> tuple[Array, Array, Mask]:
    """Middles of the contrast across a curve (P, 2), half widths (P,), and whether both outlines were found (P,)."""
    normals = _normals(points)
    reach = REACH * float(half.max()) + 2.0
    steps = np.linspace(0.0, reach, max(8, round(2 * reach)) + 1)
    least = _outline(shape, points, normals * half[:, None])
    sides: list[Array] = []
    for sign in (-1.0, 1.0):
        values = _sampled(shape.contrast, points[:, None] + sign * steps[:, None] * normals[:, None]) / least[:, None]
        low = values < 1.0
        k = np.where(low.any(axis=1), low.argmax(axis=1), len(steps) - 1)
        row = np.arange(len(points))
        above, below = values[row, np.maximum(k - 1, 0)], values[row, k]
        part = np.clip((above - 1) / np.maximum(above - below, 1e-6), 0, 1)
        sides.append(np.where(k > 0, steps[np.maximum(k - 1, 0)] + part * steps[1], np.nan))
    left, right = sides
    seen = np.isfinite(left) & np.isfinite(right)
    width = np.where(seen, (left + right) / 2, half)
    usual = median_filter(width, 9, mode="nearest")
    seen &= width < 1.5 * usual + 1.0
    off = np.where(seen, (right - left) / 2, 0.0)
    return points + off[:, None] * normals, np.where(seen, width, usual), seen


def _extended(shape: Shape, points: Array, half: float, reach: float) -> Array:
    """Where a curve (P, 2) that goes on straight leaves the shape. Shape (2,)."""
    part = points[-max(4, POINTS // 10) :]
    way = part[-1] - part[0]
    at = points[-1] + np.arange(0.0, reach, 0.25)[:, None] * way / max(float(np.hypot(*way)), 1e-9)
    low = _sampled(shape.contrast, at[None])[0] < _outline(shape, points, half * _normals(points))[-1]
    return at[max(int(low.argmax()) - 1, 0) if low.any() else -1]


def _outline(shape: Shape, points: Array, across: Array) -> Array:
    """Contrast of the outline beside a curve (P, 2): a share of the most that lies across it (P, 2), or 1. (P,)."""
    inside = _sampled(shape.contrast, points[:, None] + np.linspace(-1, 1, 9)[:, None] * across[:, None]).max(axis=1)
    return np.maximum(1.0, EDGE * median_filter(inside, 9, mode="nearest"))


def _normals(points: Array) -> Array:
    tangents = np.gradient(points, axis=0)
    return tangents[:, ::-1] * [-1.0, 1.0] / np.maximum(np.linalg.norm(tangents, axis=1), 1e-9)[:, None]


def _sampled(picture: Picture, at: Array) -> Array:
    """Values of a picture at places (K, N, 2), 0 outside. Shape (K, N)."""
    border = cv2.BORDER_CONSTANT
    x, y = np.moveaxis(at.astype(np.float32), -1, 0)
    values = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=border, borderValue=0)
    return np.asarray(values, dtype=float)


def _spline(points: Array, weights: Array | None = None) -> Array:
    """A smooth curve near points (N, 2), at as many places as it has detail for."""
    travel = np.concatenate([[0.0], np.cumsum(np.maximum(np.hypot(*np.diff(points, axis=0).T), 1e-6))])
    spans = max(1, min(SPANS, len(points) // 4))
    knots = np.concatenate([[travel[0]] * 3, np.linspace(travel[0], travel[-1], spans + 1), [travel[-1]] * 3])
    spline = make_lsq_spline(travel, points, knots, 3, weights)
    return np.asarray(spline(np.linspace(0, travel[-1], 4 * POINTS)))


def _even(points: Array) -> Array:
    """Points at equal distances along a line through others (N, 2). Shape (P, 2)."""
    travel = _travel(points)
    at = np.linspace(0, travel[-1], POINTS)
    return np.stack([np.interp(at, travel, points[:, k]) for k in (0, 1)], axis=1)
