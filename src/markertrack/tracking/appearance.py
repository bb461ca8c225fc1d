"""What a marker looks like: its color against all that surrounds it, and its radius, learned from the first frame.

Each pixel is given its coverage (`coverage`), the same for all markers, by a table of colors.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.coverage import coverages, moments, polynomials
from markertrack.tracking.matching import gaps_of
from markertrack.tracking.tracker import AGREE, Array, Image, Mask
from swimbase.errors import TrackingError

BITS = 6  # of each color that the table of coverage keeps
SURROUNDINGS = 3.0  # radii around a marker that its color is told apart from
KEEP_FIRST = 0.5  # share of the first frame in what is known, for good
INNER_EDGE = 0.4  # of the largest change of color, from which an edge further inside is a marker's
SECTORS = 8  # directions from a point: a marker ends in all of them, what it is on doesn't
LEAST_DETAIL = 8.0  # levels of a camera, above its noise
MUCH = 1.3  # ratio of the radii of two edges of which only one may be a marker's
UNEQUAL = 0.7  # by which the logarithm of a marker's radius easily differs from the usual one's
LONE_GAP = 80.0  # px to the next marker that is assumed where there is none: it tells how large one may be
LEAST_CONTRAST = 0.35  # coverage of a marker's inside above its surroundings
_LEAST_COVERAGE = 0.15  # below it a pixel is noise
_RADII = 1.12 ** np.arange(32) * 1.5
ROUNDS = 4  # of fitting discs anew, as what they are fitted by changes with them

Table = NDArray[np.float32]


def radius_at(image: Image, points: Array) -> float:
    """Radius of the markers: where the color changes most from the ring inside to the ring outside [px].

    Args:
        image: RGB. Shape (H, W, 3).
        points: Near the markers' centers [px]. Shape (M, 2).
    """
    radii, changes = _changes(image, points)
    return _radius_of(radii, changes[:, 0])


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
    clear = _peaks(ways) & (ways > np.maximum(INNER_EDGE * weak, LEAST_DETAIL)[:, None, None])
    aside = np.abs(np.log(radii / _radius_of(radii, np.quantile(ways, 0.25, axis=1))))
    edges = np.where(clear.any(axis=2), radii[np.where(clear, aside, np.inf).argmin(axis=2)], np.inf)
    inner = np.median(edges, axis=1)
    return np.where(inner < strongest / MUCH, inner, strongest)


def _radius_of(radii: Array, changes: Array) -> float:
    change = np.median(changes, axis=0)
    if len(changes) == 1:  # it may be on something round: its own edge is the inner one
        return float(radii[int(np.argmax(_peaks(change) & (change > INNER_EDGE * change.max())))])
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


def _edge_radius(image: Image, table: Table, points: Array, radius: float) -> float:
    """Where coverage falls to half way between inside and outside, around all markers together [px]."""
    edges = np.arange(0.3, 1.8, 0.1) * radius
    total, count = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1)
    for point in points:
        window, grid = _cut(image, point, int(np.ceil(edges[-1])) + 1)
        if window.size == 0:
            continue
        away = _own_distance(grid, point, points)
        mine = np.isfinite(away)
        coverage = covered(np.ascontiguousarray(window), table, 1)
        total += np.histogram(away[mine], edges, weights=coverage[mine])[0]
        count += np.histogram(away[mine], edges)[0]
    profile = total / np.maximum(count, 1)
    half = (profile[:3].max() + profile.min()) / 2
    below = np.flatnonzero(profile < half)
    if not len(below) or below[0] == 0:
        return radius
    k = int(below[0])
    middles = (edges[1:] + edges[:-1]) / 2
    share = (profile[k - 1] - half) / (profile[k - 1] - profile[k])
    return float(middles[k - 1] + share * (middles[k] - middles[k - 1]))


def _typical_gap(points: Array) -> float:
    return float(np.median(gaps_of(points))) if len(points) > 1 else LONE_GAP


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


class Appearance:
    """Coverage of every color, as a table.

    Attributes:
        points: Centers of the markers in the first frame [px]. Shape (M, 2).
        radius: Radius of the markers [px].
        shares: How much of its disc each marker covers, about 1. Shape (M,).
        contrast: How much each looks like a marker, see `contrasts`. Shape (M,).
        table: Coverage from 0 to 1 by the leading bits of red, green and blue. Shape (2^(3 BITS),).
    """

    def __init__(self, image: Image, points: Array) -> None:
        """Learns from the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Near the markers' centers, off by less than about a radius [px]. Shape (M, 2).

        Raises:
            TrackingError: What is at the points doesn't differ from what is around them.
        """
        self._fitted(image, points, radius_at(image, points))
        bad = np.flatnonzero(self.contrast < LEAST_CONTRAST)
        if len(bad) > len(points) // 3:
            listed = ", ".join(f"({x:.0f}, {y:.0f})" for x, y in points[bad[:3]])
            raise TrackingError(
                f"no marker stands out at {len(bad)} of {len(points)} points, such as {listed}; pick the points on the "
                f"markers' centers in the first frame (`swim2real pick`)"
            )

    def _fitted(self, image: Image, points: Array, radius: float) -> None:
        """Color, radius and centers, in turns until they agree."""
        self.points, self.radius = points.copy(), radius
        for sure in np.repeat([True, False], ROUNDS):
            self._first = self._seen(image, self.points, AGREE[1] if sure else 0.0)
            self._rebuild(self._first)
            # as far as the points may be off, but not nearer to another marker
            reaches = np.full(len(points), 1.3 * self.radius + 2.0)
            moved, shares = discs(image, self.table, self.points, reaches, self.points, self.radius)
            self.points = np.where(np.isfinite(moved), moved, self.points)
            if sure:
                self.radius = radius_at(image, self.points)
            else:
                by_area = self.radius * float(np.clip(np.sqrt(np.median(shares)), 0.8, 1.25))
                # colors at the body's edge may look like a marker's: then the area is too large
                self.radius = min(by_area, _edge_radius(image, self.table, self.points, self.radius))
            self.shares = shares
        self.contrast = contrasts(image, self.table, self.points, np.full(len(points), self.radius))

    def learn(self, image: Image, points: Array) -> None:
        """Takes in how the markers look now, as the light changes.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Positions of the markers that were found with certainty [px]. Shape (K, 2).
        """
        self._rebuild(self._seen(image, points, 0.0))

    def _seen(self, image: Image, points: Array, unsure: float) -> Array:
        every, radii = np.arange(len(points)), np.full(len(points), self.radius)
        return moments(image, points, radii, every, SURROUNDINGS, unsure).mean(axis=0, keepdims=True)

    def _rebuild(self, now: Array) -> None:
        weights = polynomials(KEEP_FIRST * self._first + (1 - KEEP_FIRST) * now)
        self.table = coverages(_palette(), weights[0]).ravel()


@cache
def _palette() -> Image:
    """Every color of the table, as a picture. Shape (1, 2^(3 BITS), 3)."""
    levels = np.arange(2 ** (8 - BITS - 1), 256, 2 ** (8 - BITS), dtype=np.uint8)
    return np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(1, -1, 3)


@njit(cache=True, nogil=True, inline="always")
def _at(image: Image, i: int, j: int, table: Table) -> np.float32:
    shift = 8 - BITS
    r, g, b = np.int64(image[i, j, 0] >> shift), np.int64(image[i, j, 1] >> shift), np.int64(image[i, j, 2] >> shift)
    return table[(r << (2 * BITS)) | (g << BITS) | b]


@njit(cache=True, nogil=True)
def covered(image: Image, table: Table, step: int) -> Table:
    """Coverage of a window, averaged over blocks of step × step pixels. Shape (H // step, W // step)."""
    height, width = image.shape[0] // step, image.shape[1] // step
    out = np.zeros((height, width), dtype=np.float32)
    share = np.float32(1.0 / (step * step))
    for i in range(height * step):
        for j in range(width * step):
            out[i // step, j // step] += share * _at(image, i, j, table)
    return out


@njit(cache=True, nogil=True)
def discs(
    image: Image, table: Table, points: Array, reaches: Array, others: Array, radius: float
) -> tuple[Array, Array]:
    """Centers of the discs near the points, and how much of each is seen.

    Each pixel counts for the nearest of the others only. What this cuts off a disc that another one touches is cut off
    the disc that it is compared with, too.

    Args:
        image: RGB. Shape (H, W, 3).
        table: Table of coverage.
        points: Where to begin [px]. Shape (N, 2).
        reaches: Distance from each within which pixels count [px]. Shape (N,).
        others: Points that share the pixels among them [px]. Shape (K, 2).
        radius: Radius of the disc [px].

    Returns:
        Centers [px], NaN where nothing is covered, shape (N, 2), and what is covered as a share of the disc, (N,).
    """
    out, shares = points.copy(), np.zeros(len(points))
    height, width = image.shape[0], image.shape[1]
    near = np.empty((len(others), 2))
    for n in range(len(points)):
        reach = reaches[n]
        for _ in range(6):
            cx, cy = out[n, 0], out[n, 1]
            if not (np.isfinite(cx) and np.isfinite(cy)):
                break
            # the markers that are close enough to take pixels away
            count = 0
            for k in range(len(others)):
                dx, dy = others[k, 0] - cx, others[k, 1] - cy
                away = dx * dx + dy * dy
                start = (others[k, 0] - points[n, 0]) ** 2 + (others[k, 1] - points[n, 1]) ** 2
                if start > 4.0 and away < 4 * (reach + 1) ** 2:
                    near[count] = others[k]
                    count += 1
            total = sx = sy = 0.0
            whole = wx = wy = 0.0
            for i in range(max(int(np.floor(cy - reach)), 0), min(int(np.ceil(cy + reach)), height - 1) + 1):
                for j in range(max(int(np.floor(cx - reach)), 0), min(int(np.ceil(cx + reach)), width - 1) + 1):
                    away = np.sqrt((j - cx) ** 2 + (i - cy) ** 2)
                    if away > reach + 0.5:
                        continue
                    mine = True
                    for k in range(count):
                        if (j - near[k, 0]) ** 2 + (i - near[k, 1]) ** 2 < away * away:
                            mine = False
                            break
                    if not mine:
                        continue
                    ideal = min(max(radius + 0.5 - away, 0.0), 1.0)
                    whole += ideal
                    wx += ideal * j
                    wy += ideal * i
                    w = _at(image, i, j, table)
                    if w >= _LEAST_COVERAGE:
                        w *= min(1.0, reach + 0.5 - away)
                        total += w
                        sx += w * j
                        sy += w * i
            if total < 1e-3 or whole < 1e-3:
                out[n] = np.nan
                break
            dx, dy = sx / total - wx / whole, sy / total - wy / whole
            out[n, 0], out[n, 1], shares[n] = cx + dx, cy + dy, total / whole
            if dx * dx + dy * dy < 1e-5:
                break
    return out, shares


@njit(cache=True, nogil=True)
def contrasts(image: Image, table: Table, points: Array, radii: Array) -> Array:
    """How much each point looks like a round marker, from 0 to 1.

    The mean coverage inside, less the coverage just outside on the two sides of a diameter, whichever is larger; the
    median over diameters. The edge of a patch of glare has one bright side on all of them, a neighbor on one or two.
    """
    height, width = image.shape[0], image.shape[1]
    out = np.zeros(len(points))
    sides = np.empty(8)
    for n in range(len(points)):
        x, y = points[n]
        radius = radii[n]
        if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
            continue
        inside = count = 0.0
        for i in range(max(int(y - radius), 0), min(int(y + radius) + 1, height - 1) + 1):
            for j in range(max(int(x - radius), 0), min(int(x + radius) + 1, width - 1) + 1):
                if (j - x) ** 2 + (i - y) ** 2 <= (0.75 * radius) ** 2:
                    inside += _at(image, i, j, table)
                    count += 1
        inside /= max(count, 1.0)
        for k in range(8):
            angle = np.pi * k / 8
            larger = 0.0
            for sign in (-1.0, 1.0):
                mean = samples = 0.0
                for away in (radius + 1.0, radius + 2.0, 1.3 * radius + 2.0):
                    j = int(np.round(x + sign * away * np.cos(angle)))
                    i = int(np.round(y + sign * away * np.sin(angle)))
                    if 0 <= i < height and 0 <= j < width:
                        mean += _at(image, i, j, table)
                        samples += 1
                larger = max(larger, mean / max(samples, 1.0))
            sides[k] = larger
        out[n] = max(inside - np.median(sides), 0.0)
    return out
