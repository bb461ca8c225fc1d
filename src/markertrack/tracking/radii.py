"""The radius of each marker: where the color changes most from the ring inside to the ring outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.tracker import FAINT, Array, Image, Mask

SECTORS = 8  # directions from a point: a marker ends in all of them, what it is on doesn't
LEAST_DETAIL = 8.0  # levels of a camera, above its noise
MUCH = 1.3  # ratio of the radii of two edges of which only one may be a marker's
UNEQUAL = 0.7  # by which the logarithm of a marker's radius easily differs from the usual one's
LONE_GAP = 80.0  # px to the next marker that is assumed where there is none: it tells how large one may be
_RADII = 1.12 ** np.arange(32) * 1.5


def own_radii(image: Image, points: Array) -> Array:
    """Radius of each marker, likelier near the usual one [px]. Shape (M,).

    The strongest edge may be that of what a marker is on: if most directions have a clear one much further inside, it
    is that.
    """
    radii, changes = _changes(image, points)
    sizes, ways = changes[:, 0], changes[:, 1:]
    if len(points) == 1:
        return np.array([_radius_of(radii, sizes)])
    unusual = np.log(radii / _radius_of(radii, sizes)) / UNEQUAL
    strongest = radii[np.argmax(sizes * np.exp(-(unusual**2) / 2), axis=1)]
    weak = np.quantile(ways.max(axis=2), 0.25, axis=1)  # where it is on something wide, no other edge outshines its own
    clear = _peaks(ways) & (ways > np.maximum(FAINT * weak, LEAST_DETAIL)[:, None, None])
    aside = np.abs(np.log(radii / _radius_of(radii, np.quantile(ways, 0.25, axis=1))))
    edges = np.where(clear.any(axis=2), radii[np.where(clear, aside, np.inf).argmin(axis=2)], np.inf)
    inner = np.median(edges, axis=1)
    return np.where(inner < strongest / MUCH, inner, strongest)


def _radius_of(radii: Array, changes: Array) -> float:
    change = np.median(changes, axis=0)
    if len(changes) == 1:  # it may be on something round: its own edge is the inner one
        return float(radii[int(np.argmax(_peaks(change) & (change > FAINT * change.max())))])
    return float(radii[int(np.argmax(change))])


def _peaks(changes: Array) -> Mask:
    """Where changes over the radii, the last axis, have a maximum. Shapes (..., R) twice."""
    return (changes >= np.roll(changes, 1, axis=-1)) & (changes >= np.roll(changes, -1, axis=-1))


def _changes(image: Image, points: Array) -> tuple[Array, Array]:
    """Radii of circles around points, and change of color at them, as a whole and in each direction.

    Shapes (R,), (M, 1 + SECTORS, R).
    """
    largest = 0.6 * _typical_gap(points)  # two may seem to overlap, but not most
    radii = _RADII[max(largest, 2.0) >= _RADII]
    reach = int(np.ceil(1.5 * radii[-1])) + 1
    changes = np.zeros((len(points), 1 + SECTORS, len(radii)))
    for m, point in enumerate(points):
        window, grid = _cut(image, point, reach)
        away = _own_distance(grid, point, points)
        angles = np.arctan2(*np.moveaxis(grid - point, -1, 0)[::-1])
        sectors = (SECTORS * (angles / (2 * np.pi) + 0.5)).astype(int) % SECTORS
        for k, radius in enumerate(radii):
            thick = max(1.5, 0.2 * radius)
            inside, ring = (away <= radius) & (away > radius - thick), (away > radius) & (away <= radius + thick)
            change = _mean_colors(window, sectors, inside) - _mean_colors(window, sectors, ring)
            changes[m, :, k] = np.linalg.norm(change, axis=1)
    return np.asarray(radii, dtype=float), np.nan_to_num(changes)


def _mean_colors(window: Image, sectors: NDArray[np.int64], where: Mask) -> Array:
    """Mean color of some pixels, and of those in each direction, NaN where there are none. Shape (1 + SECTORS, 3)."""
    one_hot = np.eye(SECTORS)[sectors[where]]
    sums = np.column_stack([np.ones(len(one_hot)), one_hot]).T @ np.column_stack([window[where], np.ones(len(one_hot))])
    return np.where(sums[:, 3:] > 0, sums[:, :3] / np.maximum(sums[:, 3:], 1), np.nan)


def _cut(image: Image, point: Array, reach: int) -> tuple[Image, NDArray[np.int64]]:
    """The square around a point as far as it lies in the frame, and its pixels' places (x, y). Shape (H, W, 2)."""
    x, y = np.round(point).astype(int)
    left, top = max(int(x) - reach, 0), max(int(y) - reach, 0)
    window = image[top : max(int(y) + reach + 1, 0), left : max(int(x) + reach + 1, 0)]
    rows, columns = np.mgrid[: window.shape[0], : window.shape[1]]
    return window, np.stack([columns + left, rows + top], axis=-1)


def _own_distance(grid: NDArray[np.int64], point: Array, points: Array) -> Array:
    """Distance of pixels from a point, infinite where another of the points is nearer. Shape (H, W)."""
    away = np.linalg.norm(grid - point, axis=2)
    out = away.copy()
    near = np.linalg.norm(points - point, axis=1) < 2 * away.max(initial=0.0)  # no other one can be nearer
    for other in points[near]:
        out[np.linalg.norm(grid - other, axis=2) < away] = np.inf
    return out


def _typical_gap(points: Array) -> float:
    """Median distance of a marker to the nearest other one [px]."""
    if len(points) == 1:
        return LONE_GAP
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    np.fill_diagonal(distances, np.inf)
    return float(np.median(distances.min(axis=1)))
