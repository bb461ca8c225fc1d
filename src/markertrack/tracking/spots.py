"""Finds marker-colored spots in a picture: round where a marker is still, a streak where it moved during the exposure.

A pixel's coverage is the share of light in it that a marker contributes: how far its color lies on the way from what is
around that marker to the marker's own, in linear light. A blurred marker covers as much as a sharp one, so the coverage
that is connected, summed, counts the markers in a spot, and its centroid is the place in the middle of the exposure.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.tracker import Array, Image, Mask

LEAST_COVERAGE = 0.2  # of a pixel that belongs to a spot
MOST_ASIDE = 0.4  # of the difference of the two colors by which a pixel may be off the way between them
BRIGHTER = 1.6  # coverage up to which a pixel is the marker's, lit more brightly
LEAST_AREA, MOST_AREA = 0.5, 1.6  # of the smallest marker's of a kind, and of the largest
LEAST_FILL = 0.45  # of the coverage that a streak of this length should have
MOST_MARKERS = 12  # in one spot; what is larger is no marker
MOST_STREAK = 10.0  # radii
DETAIL = 5.0  # pixels are joined to blocks while a marker's radius is as many blocks
LEARN_RATE = 0.3  # of the colors around a marker, in each frame
LEAST_RING = 12  # pixels that tell what is around a marker
LIGHT = np.linspace(0, 1, 256) ** 2.2  # linear light of the levels of a picture
GLOSS_NONE, GLOSS_ALL = 0.25, 0.6  # of it, in any direction, at which coverage of a glossy marker begins and is full
RISE = 0.08  # of coverage on the way from a summit that is noise
MOST_RIM, MOST_RIM_ALONE = 0.4, 0.25  # share of a spot's rim beyond which coverage rises again, or its box ends
MOST_CLIMB = 8  # steps of half a radius
ALIKE = 0.85  # cosine between the differences of color of markers of one kind and what is around them
MOST_SHADED = 3.0  # ratio of the sizes of these differences
MOST_UNEQUAL = 1.6  # ratio of the radii of markers of one kind
TOUCHING = 1.25  # of the sum of two markers' radii, within which their spots may be one
_LLOYD_ROUNDS = 10


@dataclass(frozen=True)
class Spots:
    """Spots of a picture.

    Attributes:
        centers: Centroids [px]. Shape (P, 2).
        areas: Coverage of each [px²]. Shape (P,).
        moments: Second central moments xx, xy, yy of its coverage [px²]. Shape (P, 3).
        fills: How evenly each is covered: 1 for a disc or streak, less for what only resembles one. Shape (P,).
        kinds: Kind of marker whose colors it has. Shape (P,).
    """

    centers: Array
    areas: Array
    moments: Array
    fills: Array
    kinds: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.centers)

    def of(self, some: Mask) -> Spots:
        """Some of them. Shape (P,)."""
        return Spots(*(values[some] for values in vars(self).values()))

    def and_(self, *others: Spots) -> Spots:
        """These and others."""
        return Spots(*(np.concatenate([vars(one)[name] for one in (self, *others)]) for name in vars(self)))


class SpotFinder:
    """Finds spots of the markers' colors and sizes.

    Markers of nearly the same colors and size are of one kind: a spot may be any of them.

    Attributes:
        radii: Radius of each marker [px]. Shape (M,).
        markers: Color of each, linear light of red, green and blue. Shape (M, 3).
        around: Color of what is around each. Shape (M, 3).
        glossy: Whether each has many colors, which only differ from those around it. Shape (M,).
        kinds: Number of each one's kind. Shape (M,).
    """

    def __init__(self, image: Image, points: Array, radii: Array, glossy: Mask) -> None:
        """Learns the colors from the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Centers of the markers [px]. Shape (M, 2).
            radii: Their radii [px]. Shape (M,).
            glossy: Whether each has many colors. Shape (M,).
        """
        self.radii, self.glossy = radii.copy(), glossy
        self.markers, self.around = _first_colors(image, points, radii)
        self.kinds = _kinds(self.markers - self.around, radii, glossy)
        self._block = max(1, int(radii.min() / DETAIL))
        height, width = image.shape[0] // self._block, image.shape[1] // self._block
        self._marks = np.zeros((height, width), dtype=np.int32)
        self._searches = 0

    def of(self, markers: NDArray[np.int64]) -> SpotFinder:
        """One for some of the markers."""
        some = copy(self)
        for name in ("radii", "markers", "around", "glossy", "kinds"):
            setattr(some, name, getattr(self, name)[markers])
        some._marks = np.zeros_like(self._marks)
        some._searches = 0
        return some

    def find(self, image: Image, boxes: NDArray[np.int64], alone: bool = False) -> Spots:
        """The spots of each marker's color that lie in its box, or reach into it.

        Args:
            image: RGB. Shape (H, W, 3).
            boxes: Left, top, right, bottom; the last two are outside [px]. Shape (M, 4).
            alone: Whether each spot is one marker, wholly in its box.
        """
        block = self._block
        parts: list[Array] = [np.empty((0, 8))]
        for kind in range(self.kinds.max() + 1):
            of = np.flatnonzero(self.kinds == kind)
            if not len(of):
                continue
            self._searches += 1
            measured = _spots(
                image, self.markers[of], self.around[of], boxes[of] // block, block, self.radii[of] / block,
                bool(self.glossy[of[0]]), alone, self._marks, 3 * self._searches,
            )  # fmt: skip
            parts.append(np.column_stack([measured, np.full(len(measured), kind)]))
        found = np.concatenate(parts)
        centers = found[:, :2] * block + (block - 1) / 2
        kinds = found[:, 7].astype(np.int64)
        return Spots(centers, found[:, 2] * block**2, found[:, 3:6] * block**2, found[:, 6], kinds)

    def apart(self, image: Image, places: Array) -> tuple[NDArray[np.int64], Spots]:
        """The markers that touch others, each measured as a disc of all of them together.

        Args:
            image: RGB. Shape (H, W, 3).
            places: Where the markers are expected, NaN for those that don't count [px]. Shape (M, 2).

        Returns:
            Indices of those that are where they are expected, and their spots. Shape (P,).
        """
        away = np.linalg.norm(places[:, None] - places, axis=2)
        touching = away < TOUCHING * (self.radii[:, None] + self.radii)
        of = np.flatnonzero(touching.sum(axis=1) > 1)
        block = self._block
        at = (places[of] - (block - 1) / 2) / block
        found = _together(image, self.markers[of], self.around[of], at, block, self.radii[of] / block, self.glossy[of])
        whole = (np.abs(np.log2(found[:, 2])) < np.log2(MOST_AREA)) & (found[:, 6] >= LEAST_FILL)
        whole &= np.linalg.norm(found[:, :2] - at, axis=1) < self.radii[of] / block
        found, of = found[whole], of[whole]
        square = (self.radii[of] ** 2)[:, None]
        centers = found[:, :2] * block + (block - 1) / 2
        areas = np.pi * square[:, 0] * found[:, 2]
        return of, Spots(centers, areas, square * found[:, 3:6], found[:, 6], self.kinds[of])

    def learn(self, image: Image, positions: Array, streaks: Array) -> None:
        """Takes in how the light is where the markers are now.

        Args:
            image: RGB. Shape (H, W, 3).
            positions: NaN for markers that aren't seen [px]. Shape (M, 2).
            streaks: How far each moved during the exposure [px]. Shape (M, 2).
        """
        _learn(image, positions, streaks, self.radii, self.markers, self.around)


def _kinds(ways: Array, radii: Array, glossy: Mask) -> NDArray[np.int64]:
    """Numbers of the kinds, given how each marker's color differs from what is around it. Shapes (M, 3), (M,), (M,)."""
    kinds = np.full(len(ways), -1)
    strength = np.linalg.norm(ways, axis=1) + 1e-9
    for m in range(len(ways)):
        if kinds[m] < 0:
            alike = (ways @ ways[m] > ALIKE * strength * strength[m]) & (glossy == glossy[m]) & (kinds < 0)
            for values, most in ((strength, MOST_SHADED), (radii, MOST_UNEQUAL)):
                alike &= np.abs(np.log(values / values[m])) < np.log(most)
            alike[m] = True
            kinds[alike] = kinds.max() + 1
    return kinds


def _first_colors(image: Image, points: Array, radii: Array) -> tuple[Array, Array]:
    """Median color inside of each marker, a hub or highlight left out, and of the ring around it without others."""
    markers, around = np.zeros((2, len(points), 3))
    reach = int(1.9 * radii.max() + 3)
    for m, ((x, y), radius) in enumerate(zip(points.tolist(), radii.tolist(), strict=True)):
        top, left = max(int(y) - reach, 0), max(int(x) - reach, 0)
        part = LIGHT[image[top : max(int(y) + reach + 1, 0), left : max(int(x) + reach + 1, 0)]]
        rows, columns = np.ogrid[top : top + part.shape[0], left : left + part.shape[1]]
        away = np.sqrt((columns - x) ** 2 + (rows - y) ** 2)
        inside = away <= max(0.7 * radius, 0.8)
        ring = ~inside & (away >= 1.3 * radius + 1) & (away <= 1.9 * radius + 2)
        for (ox, oy), other in zip(points, radii, strict=True):
            ring &= (columns - ox) ** 2 + (rows - oy) ** 2 >= (1.3 * other + 1) ** 2
        for colors, where in ((markers, inside), (around, ring)):
            if where.any():
                colors[m] = np.median(part[where], axis=0)
    return markers, around


@njit(cache=True, nogil=True)
def _learn(image: Image, positions: Array, streaks: Array, radii: Array, markers: Array, around: Array) -> None:
    height, width = image.shape[0], image.shape[1]
    for m in range(len(positions)):
        x, y = positions[m]
        radius = radii[m]
        if not (np.isfinite(x) and np.isfinite(y)):
            continue
        sx, sy = streaks[m] / 2
        length = max(np.sqrt(sx * sx + sy * sy), 1e-9)
        reach = int(1.9 * radius + 3 + length)
        way = markers[m] - around[m]
        square = max((way * way).sum(), 1e-9)
        total, count = np.zeros(3), 0
        inside, number = np.zeros(3), 0
        for i in range(max(int(y) - reach, 0), min(int(y) + reach + 1, height)):
            for j in range(max(int(x) - reach, 0), min(int(x) + reach + 1, width)):
                along = ((j - x) * sx + (i - y) * sy) / length
                along = min(max(along, -length), length)
                away = np.sqrt((j - x - along * sx / length) ** 2 + (i - y - along * sy / length) ** 2)
                if away > 1.9 * radius + 2:
                    continue
                covered = aside = 0.0
                for k in range(3):
                    covered += (LIGHT[image[i, j, k]] - around[m, k]) * way[k]
                covered /= square
                for k in range(3):
                    aside += (LIGHT[image[i, j, k]] - around[m, k] - covered * way[k]) ** 2
                if aside > MOST_ASIDE**2 * square:
                    continue
                if away <= max(0.7 * radius, 0.8) and covered > 0.5:  # not its hub, and no highlight on it
                    for k in range(3):
                        inside[k] += LIGHT[image[i, j, k]]
                    number += 1
                elif away >= 1.3 * radius + 1 and abs(covered) < LEAST_COVERAGE:
                    for k in range(3):
                        total[k] += LIGHT[image[i, j, k]]
                    count += 1
        if count >= LEAST_RING:
            around[m] += LEARN_RATE * (total / count - around[m])
        if number and length < 0.25 * radius:
            markers[m] += LEARN_RATE * (inside / number - markers[m])


@njit(cache=True, nogil=True)
def _coverage(image: Image, row: int, column: int, block: int, around: Array, way: Array, glossy: bool) -> float:
    """Coverage of a block of pixels; 0 where its color isn't one between the two.

    A glossy marker covers what differs from its surroundings, in whatever way.
    """
    red = green = blue = 0.0  # an array would be allocated for each pixel, which takes longer than all the rest
    for i in range(row * block, (row + 1) * block):
        for j in range(column * block, (column + 1) * block):
            red += LIGHT[image[i, j, 0]]
            green += LIGHT[image[i, j, 1]]
            blue += LIGHT[image[i, j, 2]]
    red = red / (block * block) - around[0]
    green = green / (block * block) - around[1]
    blue = blue / (block * block) - around[2]
    square = max(way[0] * way[0] + way[1] * way[1] + way[2] * way[2], 1e-9)
    if glossy:
        off = np.sqrt((red * red + green * green + blue * blue) / square)
        return min(max((off - GLOSS_NONE) / (GLOSS_ALL - GLOSS_NONE), 0.0), 1.0)
    covered = (red * way[0] + green * way[1] + blue * way[2]) / square
    if covered < LEAST_COVERAGE:
        return 0.0
    bright = min(covered, BRIGHTER)
    aside = (red - bright * way[0]) ** 2 + (green - bright * way[1]) ** 2 + (blue - bright * way[2]) ** 2
    covered = min(covered, 1.0)
    return covered if aside < MOST_ASIDE**2 * square else 0.0


@njit(cache=True, nogil=True)
def _spots(
    image: Image, markers: Array, around: Array, boxes: NDArray[np.int64], block: int, radii: Array,
    glossy: bool, alone: bool, marks: NDArray[np.int32], todo: int,
) -> Array:  # fmt: skip
    """Center, area, moments and fill of every spot of one kind, in blocks. Shape (P, 7).

    What lies in a box is marked as to do; a pixel that was looked at with the next number if it is in a spot, else with
    the one after that.
    """
    height, width = marks.shape
    for box in range(len(boxes)):
        left, top, right, bottom = boxes[box]
        for i in range(max(top, 0), min(bottom, height)):
            for j in range(max(left, 0), min(right, width)):
                marks[i, j] = todo
    least, most = np.pi * radii.min() ** 2, np.pi * radii.max() ** 2
    disc = np.pi * (radii * radii).mean()
    radius = np.sqrt(disc / np.pi)
    step = max(1, int(0.6 * radii.min()))
    out = np.empty((64, 7))
    count = 0
    pixels = np.empty((int(MOST_MARKERS * (most + 2 * radii.max() * MOST_STREAK * radii.max())), 2), dtype=np.int32)
    weights, lowest = np.empty(len(pixels)), np.empty(len(pixels))
    for box in range(len(boxes)):
        left, top, right, bottom = boxes[box]
        way = markers[box] - around[box]
        for i in range(max(top, 0), min(bottom, height), step):
            for j in range(max(left, 0), min(right, width), step):
                if marks[i, j] != todo or _coverage(image, i, j, block, around[box], way, glossy) == 0.0:
                    continue
                row, column = _summit(image, block, around[box], way, glossy, i, j, radius, marks, todo)
                if marks[row, column] != todo:
                    continue
                size, rim = _flooded(
                    image, block, around[box], way, glossy, row, column, marks, todo, pixels, weights, lowest
                )
                if size == len(pixels) or rim > (
                    MOST_RIM_ALONE if alone else MOST_RIM
                ):  # more than markers: glare, a wall, its texture
                    continue
                total = weights[:size].sum()
                if total < LEAST_AREA * least:
                    continue
                number = max(1, int(total / disc + 0.5)) if total > MOST_AREA * most and not alone else 1
                if number > MOST_MARKERS:
                    continue
                while count + number > len(out):
                    out = np.concatenate((out, np.empty_like(out)))
                _measured(pixels[:size], weights[:size], number, radius, out[count : count + number])
                for n in range(count, count + number):
                    if out[n, 6] >= LEAST_FILL and out[n, 2] >= LEAST_AREA * least:
                        out[count] = out[n]
                        count += 1
    return out[:count]


@njit(cache=True, nogil=True)
def _summit(
    image: Image, block: int, around: Array, way: Array, glossy: bool, row: int, column: int, radius: float,
    marks: NDArray[np.int32], todo: int,
) -> tuple[int, int]:  # fmt: skip
    """Where coverage is largest, uphill of a pixel."""
    height, width = marks.shape
    reach = max(1, int(0.5 * radius))
    best = _coverage(image, row, column, block, around, way, glossy)
    for _ in range(MOST_CLIMB):
        at_row, at_column = row, column
        for i in range(max(at_row - reach, 0), min(at_row + reach + 1, height)):
            for j in range(max(at_column - reach, 0), min(at_column + reach + 1, width)):
                if marks[i, j] == todo:
                    weight = _coverage(image, i, j, block, around, way, glossy)
                    if weight > best:
                        best, row, column = weight, i, j
        if (row, column) == (at_row, at_column):
            break
    return row, column


@njit(cache=True, nogil=True)
def _flooded(
    image: Image, block: int, around: Array, way: Array, glossy: bool, row: int, column: int, marks: NDArray[np.int32],
    todo: int, pixels: NDArray[np.int32], weights: Array, lowest: Array,
) -> tuple[int, float]:  # fmt: skip
    """Number of the covered pixels that are downhill of a summit, or as many as there is room for.

    Where coverage rises again another marker begins, or what is beyond the edge of a body. The share of the rim where
    it does, or where nobody looked, is given as well.
    """
    height, width = marks.shape
    marks[row, column] = todo + 1
    pixels[0, 0], pixels[0, 1] = column, row
    weights[0] = lowest[0] = _coverage(image, row, column, block, around, way, glossy)
    size, done = 1, 0
    while done < size:
        x, y = pixels[done]
        done += 1
        for k in range(4):
            j, i = x + (k == 0) - (k == 1), y + (k == 2) - (k == 3)
            if not (0 <= i < height and 0 <= j < width) or marks[i, j] != todo:
                continue
            weight = _coverage(image, i, j, block, around, way, glossy)
            if weight > lowest[done - 1] + RISE:
                continue
            marks[i, j] = todo + (1 if weight > 0.0 else 2)
            if weight == 0.0:
                continue
            if size == len(pixels):
                return size, 0.0
            pixels[size, 0], pixels[size, 1] = j, i
            weights[size] = weight
            lowest[size] = min(weight, lowest[done - 1])
            size += 1
    higher = free = 0
    for n in range(size):
        x, y = pixels[n]
        for k in range(4):
            j, i = x + (k == 0) - (k == 1), y + (k == 2) - (k == 3)
            if not (0 <= i < height and 0 <= j < width) or marks[i, j] == todo + 1:
                continue
            if marks[i, j] == todo + 2:
                free += 1
            else:
                higher += 1
    return size, higher / max(higher + free, 1)


@njit(cache=True, nogil=True)
def _measured(pixels: NDArray[np.int32], weights: Array, number: int, radius: float, out: Array) -> None:
    """Splits a spot into as many markers as it has the area of, and measures each."""
    nearest = np.zeros(len(pixels), dtype=np.int64)
    if number > 1:
        x, y, _, xx, xy, yy = _moments(pixels, weights, nearest, 0)
        sx, sy = _streak(xx, xy, yy)
        for n in range(number):  # along its longest extent, then each moves to the middle of what is nearest to it
            share = (n + 0.5) / number - 0.5
            out[n, 0], out[n, 1] = x + share * sx, y + share * sy
        for _ in range(_LLOYD_ROUNDS):
            for p in range(len(pixels)):
                best = np.inf
                for n in range(number):
                    away = (pixels[p, 0] - out[n, 0]) ** 2 + (pixels[p, 1] - out[n, 1]) ** 2
                    if away < best:
                        best, nearest[p] = away, n
            for n in range(number):
                x, y, total, _, _, _ = _moments(pixels, weights, nearest, n)
                if total > 0:
                    out[n, 0], out[n, 1] = x, y
    disc = np.pi * radius * radius
    for n in range(number):
        x, y, total, xx, xy, yy = _moments(pixels, weights, nearest, n)
        sx, sy = _streak(xx, xy, yy)
        length = np.sqrt(sx * sx + sy * sy)
        square = 0.0
        for p in range(len(pixels)):
            if nearest[p] == n:
                square += weights[p] * weights[p]
        expected = disc / (disc + 2 * radius * length)
        fill = square / max(total, 1e-9) / expected
        out[n, 0], out[n, 1], out[n, 2], out[n, 3], out[n, 4], out[n, 5], out[n, 6] = x, y, total, xx, xy, yy, fill


@njit(cache=True, nogil=True)
def _together(
    image: Image, markers: Array, around: Array, places: Array, block: int, radii: Array, glossy: Mask
) -> Array:  # fmt: skip
    """Centers of discs that touch, the share of each that is covered, its moments in squared radii, and fill. (K, 7).

    A pixel counts for the disc that it is nearest to. Each disc moves by how far what is covered of its pixels lies
    from what it would cover of them.
    """
    height, width = image.shape[0] // block, image.shape[1] // block
    out, at, ways = np.zeros((len(places), 7)), places.copy(), markers - around
    seen, ideal = np.zeros((2, len(places), 7))
    for _ in range(_LLOYD_ROUNDS):
        seen[:], ideal[:] = 0.0, 0.0
        for k in range(len(at)):
            reach = radii[k] + 1.5
            for i in range(max(int(at[k, 1] - reach), 0), min(int(at[k, 1] + reach) + 2, height)):
                for j in range(max(int(at[k, 0] - reach), 0), min(int(at[k, 0] + reach) + 2, width)):
                    dx, dy = j - at[k, 0], i - at[k, 1]
                    beyond = np.sqrt(dx * dx + dy * dy) - radii[k]
                    mine = beyond < 1.5
                    for n in range(len(at)):
                        if n != k and np.sqrt((j - at[n, 0]) ** 2 + (i - at[n, 1]) ** 2) - radii[n] < beyond:
                            mine = False
                    if not mine:
                        continue
                    covered = _coverage(image, i, j, block, around[k], ways[k], glossy[k])
                    for sums, weight in ((seen, covered), (ideal, min(max(0.5 - beyond, 0.0), 1.0))):
                        sums[k, 0] += weight * dx
                        sums[k, 1] += weight * dy
                        sums[k, 2] += weight
                        sums[k, 3] += weight * dx * dx
                        sums[k, 4] += weight * dx * dy
                        sums[k, 5] += weight * dy * dy
                        sums[k, 6] += weight * weight
        for k in range(len(at)):
            for c in range(2):
                at[k, c] += seen[k, c] / max(seen[k, 2], 1.0) - ideal[k, c] / max(ideal[k, 2], 1.0)
    for k in range(len(at)):
        total, whole = max(seen[k, 2], 1e-9), max(ideal[k, 2], 1e-9)
        out[k, 0], out[k, 1], out[k, 2], out[k, 6] = at[k, 0], at[k, 1], total / whole, seen[k, 6] / total
        for c in range(3, 6):
            out[k, c] = (seen[k, c] / total - ideal[k, c] / whole) / radii[k] ** 2 + (0.0 if c == 4 else 0.25)
    return out


@njit(cache=True, nogil=True)
def _moments(
    pixels: NDArray[np.int32], weights: Array, nearest: NDArray[np.int64], n: int
) -> tuple[float, float, float, float, float, float]:
    """Centroid, sum and second central moments of the pixels that are nearest to one place."""
    total = x = y = 0.0
    for p in range(len(pixels)):
        if nearest[p] == n:
            total += weights[p]
            x += weights[p] * pixels[p, 0]
            y += weights[p] * pixels[p, 1]
    if total <= 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y = x / total, y / total
    xx = xy = yy = 0.0
    for p in range(len(pixels)):
        if nearest[p] == n:
            dx, dy = pixels[p, 0] - x, pixels[p, 1] - y
            xx += weights[p] * dx * dx
            xy += weights[p] * dx * dy
            yy += weights[p] * dy * dy
    return x, y, total, xx / total, xy / total, yy / total


@njit(cache=True, nogil=True)
def _streak(xx: float, xy: float, yy: float) -> tuple[float, float]:
    """The even streak whose two principal variances differ by as much; a disc's are equal."""
    length = np.sqrt(24 * np.sqrt(((xx - yy) / 2) ** 2 + xy * xy))
    angle = np.arctan2(xy, (xx - yy) / 2) / 2
    return length * np.cos(angle), length * np.sin(angle)


def streak_lengths(moments: Array) -> Array:
    """Lengths of even streaks with such differences of the principal variances [px]. Shapes (..., 3), (...)."""
    return np.sqrt(24 * np.hypot((moments[..., 0] - moments[..., 2]) / 2, moments[..., 1]))


def streaks(moments: Array) -> Array:
    """How far markers moved during the exposure, or the opposite way, by what their moments exceed their own by [px].

    Args:
        moments: Second central moments xx, xy, yy, less those of the marker at rest [px²]. Shape (K, 3).

    Returns:
        Way [px]. Shape (K, 2).
    """
    angles = np.arctan2(moments[:, 1], (moments[:, 0] - moments[:, 2]) / 2) / 2
    return streak_lengths(moments)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
