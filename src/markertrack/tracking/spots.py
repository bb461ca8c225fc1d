"""Finds marker-colored spots in a picture: round where a marker is still, a streak where it moved during the exposure.

A blurred marker covers as much as a sharp one, so the coverage (`coverage`) that is connected, summed, counts the
markers in a spot, and its centroid is the place in the middle of the exposure.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.coverage import NOISE, TERMS, Coverage, covered
from markertrack.tracking.tracker import Array, Image, Mask

Shares = NDArray[np.float32]

LEAST_AREA, MOST_AREA = 0.5, 1.6  # of the smallest marker's of a kind, and of the largest
LEAST_FILL = 0.45  # of the coverage that a streak of this length should have
MOST_MARKERS = 12  # in one spot; what is larger is no marker
MOST_STREAK = 10.0  # radii
DETAIL = 5.0  # pixels are joined to blocks while a marker's radius is as many blocks
MOST_RIM = 0.25  # share of a spot's rim where coverage rises again, or isn't half of what it is inside, or its box ends
MOST_CLIMB = 8  # steps of half a radius
SHARP = 0.25  # radii of a streak, up to which a marker is taken for sharp
MOST_UNEQUAL = 1.6  # ratio of the radii of markers of one kind
TOUCHING = 1.25  # of the sum of two markers' radii, within which their spots may be one
PEAK = 0.5  # of what is covered most of a spot or streak: its border
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
        coverage: By each marker.
        kinds: Number of each one's kind. Shape (M,).
    """

    def __init__(self, image: Image, points: Array, radii: Array, unsure: float = 0.0) -> None:
        """Learns the colors from the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Centers of the markers [px]. Shape (M, 2).
            radii: Their radii [px]. Shape (M,).
            unsure: By how much both may be off [px].
        """
        self.radii, self.coverage = radii.copy(), Coverage(image, points, radii, unsure)
        self.kinds = _kinds(self.coverage, radii)
        self._block = max(1, int(radii.min() / DETAIL))

    def of(self, markers: NDArray[np.int64]) -> SpotFinder:
        """One for some of the markers."""
        some = copy(self)
        some.radii, some.coverage, some.kinds = self.radii[markers], self.coverage.of(markers), self.kinds[markers]
        return some

    def find(self, image: Image, boxes: NDArray[np.int64], ways: Array | float = 0.0, alone: bool = False) -> Spots:
        """The spots of each marker's color that lie in its box, or reach into it.

        Args:
            image: RGB. Shape (H, W, 3).
            boxes: Left, top, right, bottom; the last two are outside [px]. Shape (M, 4).
            ways: How far each may move during the exposure, which makes it fainter [px]. Shape (M,).
            alone: Whether each spot is one marker, wholly in its box.
        """
        peaks = np.pi * self.radii / (np.pi * self.radii + 2 * ways)
        noises = self.coverage.weights[:, TERMS]
        fainter = np.clip(PEAK * peaks, NOISE[0], noises)
        parts: list[Array] = [np.empty((0, 8))]
        for kind in range(self.kinds.max() + 1):
            of = np.flatnonzero(self.kinds == kind)
            if not len(of):
                continue
            found = self._measured(image, of, boxes, noises, alone)
            faint = of[fainter[of] < noises[of]]
            if len(faint):
                found = self._whole(found, self._measured(image, faint, boxes, fainter, alone), of)
            parts.append(np.column_stack([found, np.full(len(found), kind)]))
        found = np.concatenate(parts)
        return Spots(found[:, :2], found[:, 2], found[:, 3:6], found[:, 6], found[:, 7].astype(np.int64))

    def _measured(
        self, image: Image, of: NDArray[np.int64], boxes: NDArray[np.int64], noises: Array, alone: bool
    ) -> Array:
        """Center, area, moments and fill of each spot of some markers (K,) that is above noise. Shape (P, 7)."""
        weights = self.coverage.weights[of]
        weights[:, TERMS] = noises[of]
        boxes, block = boxes[of] // self._block, self._block
        corner, part = self._part(image, boxes[(boxes[:, :2] < boxes[:, 2:]).all(axis=1)])
        found = _spots(part, weights, boxes - np.tile(corner, 2), self.radii[of] / block, alone)
        found[:, :2] += corner
        return found * [block, block, *4 * (block**2,), 1] + [*2 * ((block - 1) / 2,), 0, 0, 0, 0, 0]

    def _part(self, image: Image, boxes: NDArray[np.int64]) -> tuple[NDArray[np.int64], Image]:
        """The part of a picture with boxes (K, 4), and what is next to them, and where its corner is, in blocks."""
        if not len(boxes):
            return np.zeros(2, dtype=np.int64), image[:0]
        size, block = np.array(image.shape[1::-1]) // self._block, self._block
        (left, top), (right, bottom) = (
            (boxes[:, :2].min(axis=0) - 1).clip(0, size),
            (boxes[:, 2:].max(axis=0) + 1).clip(0, size),
        )
        part = image[top * block : bottom * block, left * block : right * block]
        if block > 1 and part.size:
            part = np.asarray(cv2.resize(part, (right - left, bottom - top), interpolation=cv2.INTER_AREA))
        return np.array([left, top]), part

    def _whole(self, found: Array, faint: Array, of: NDArray[np.int64]) -> Array:
        """Spots of one kind, without what is faint or with it: as they are more like a whole marker. Shape (P, 7)."""
        both = np.concatenate([found, faint])
        sizes = np.abs(np.log2(both[:, 2] / (np.pi * np.mean(self.radii[of] ** 2))))
        like = np.minimum(both[:, 6], 1.0) * (2 - sizes)
        same = np.linalg.norm(both[:, None, :2] - both[:, :2], axis=2) < self.radii[of].min()
        first = np.arange(len(both)) < len(found)
        better = (like > like[:, None]) | (like == like[:, None]) & first
        return both[~(same & better & (first != first[:, None])).any(axis=1)]

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
        block, radii = self._block, self.radii[of] / self._block
        at = (places[of] - (block - 1) / 2) / block
        corner, part = self._part(
            image, np.hstack([at - 2 * radii[:, None] - 2, at + 2 * radii[:, None] + 2]).astype(np.int64)
        )
        found = _together(part, self.coverage.weights[of], at - corner, radii)
        found[:, :2] += corner
        whole = (np.abs(np.log2(found[:, 2])) < np.log2(MOST_AREA)) & (found[:, 6] >= LEAST_FILL)
        whole &= np.linalg.norm(found[:, :2] - at, axis=1) < radii
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
        sharp = np.isfinite(positions[:, 0]) & (np.hypot(*streaks.T) < SHARP * self.radii)
        self.coverage.learn(image, positions, self.radii, np.flatnonzero(sharp))


def _kinds(coverage: Coverage, radii: Array) -> NDArray[np.int64]:
    """Numbers of the kinds of markers, given what they cover and their radii (M,)."""
    kinds, alike = np.full(len(radii), -1), coverage.alike()
    for m in range(len(radii)):
        if kinds[m] < 0:
            same = alike[m] & (np.abs(np.log(radii / radii[m])) < np.log(MOST_UNEQUAL)) & (kinds < 0)
            same[m] = True
            kinds[same] = kinds.max() + 1
    return kinds


@njit(cache=True, nogil=True)
def _spots(image: Image, weights: Array, boxes: NDArray[np.int64], radii: Array, alone: bool) -> Array:
    """Center, area, moments and fill of every spot of one kind. Shape (P, 7)."""
    height, width = image.shape[0], image.shape[1]
    shares = np.full((height, width), -1.0, dtype=np.float32)  # in no box: -1
    marks = np.zeros((height, width), dtype=np.int8)
    for box in range(len(boxes)):
        left, top, right, bottom = boxes[box]
        own = weights[box]
        for i in range(max(top, 0), min(bottom, height)):
            for j in range(max(left, 0), min(right, width)):
                if shares[i, j] < 0.0:
                    shares[i, j] = covered(image, i, j, own)
    least, most = np.pi * radii.min() ** 2, np.pi * radii.max() ** 2
    disc = np.pi * (radii * radii).mean()
    radius = np.sqrt(disc / np.pi)
    step = max(1, int(0.6 * radii.min()))
    out = np.empty((64, 7))
    count = 0
    pixels = np.empty((int(MOST_MARKERS * (most + 2 * radii.max() * MOST_STREAK * radii.max())), 2), dtype=np.int32)
    inside, lowest = np.empty(len(pixels)), np.empty(len(pixels))
    for box in range(len(boxes)):
        left, top, right, bottom = boxes[box]
        noise = weights[box, TERMS]
        for i in range(max(top, 0), min(bottom, height), step):
            for j in range(max(left, 0), min(right, width), step):
                if marks[i, j] or shares[i, j] < noise:
                    continue
                row, column = _summit(shares, marks, i, j, radius)
                size, rim = _flooded(shares, marks, noise, row, column, pixels, inside, lowest)
                if size == len(pixels) or rim > MOST_RIM:  # more than markers: glare, a wall, its texture
                    continue
                total = inside[:size].sum()
                if total < LEAST_AREA * least:
                    continue
                number = max(1, int(total / disc + 0.5)) if total > MOST_AREA * most and not alone else 1
                if number > MOST_MARKERS:
                    continue
                while count + number > len(out):
                    out = np.concatenate((out, np.empty_like(out)))
                _measured(pixels[:size], inside[:size], number, radius, out[count : count + number])
                for n in range(count, count + number):
                    if out[n, 6] >= LEAST_FILL and out[n, 2] >= LEAST_AREA * least:
                        out[count] = out[n]
                        count += 1
    return out[:count]


@njit(cache=True, nogil=True)
def _summit(shares: Shares, marks: NDArray[np.int8], row: int, column: int, radius: float) -> tuple[int, int]:
    """Where coverage is largest, uphill of a pixel."""
    height, width = marks.shape
    reach = max(1, int(0.5 * radius))
    best = shares[row, column]
    for _ in range(MOST_CLIMB):
        at_row, at_column = row, column
        for i in range(max(at_row - reach, 0), min(at_row + reach + 1, height)):
            for j in range(max(at_column - reach, 0), min(at_column + reach + 1, width)):
                if not marks[i, j] and shares[i, j] > best:
                    best, row, column = shares[i, j], i, j
        if (row, column) == (at_row, at_column):
            break
    return row, column


@njit(cache=True, nogil=True)
def _flooded(
    shares: Shares, marks: NDArray[np.int8], noise: float, row: int, column: int, pixels: NDArray[np.int32],
    inside: Array, lowest: Array,
) -> tuple[int, float]:  # fmt: skip
    """Number of the covered pixels that are downhill of a summit, or as many as there is room for.

    Where coverage rises again another marker begins, or what is beyond the edge of a body. The share of the rim where
    it does, or isn't down to half of the summit's, or where no box is, is given as well. What is in a spot is marked
    with 1, what was looked at else with 2.
    """
    height, width = marks.shape
    marks[row, column] = 1
    pixels[0, 0], pixels[0, 1] = column, row
    inside[0] = lowest[0] = shares[row, column]
    size, done = 1, 0
    while done < size:
        x, y = pixels[done]
        done += 1
        for k in range(4):
            j, i = x + (k == 0) - (k == 1), y + (k == 2) - (k == 3)
            if not (0 <= i < height and 0 <= j < width) or marks[i, j] or shares[i, j] < 0.0:
                continue
            share = shares[i, j] if shares[i, j] >= noise else 0.0
            if share > lowest[done - 1] + NOISE[0]:
                continue
            marks[i, j] = 1 if share > 0.0 else 2
            if share == 0.0:
                continue
            if size == len(pixels):
                return size, 0.0
            pixels[size, 0], pixels[size, 1] = j, i
            inside[size] = share
            lowest[size] = min(share, lowest[done - 1])
            size += 1
    higher = free = 0
    for n in range(size):
        x, y = pixels[n]
        for k in range(4):
            j, i = x + (k == 0) - (k == 1), y + (k == 2) - (k == 3)
            if not (0 <= i < height and 0 <= j < width) or marks[i, j] == 1:
                continue
            if marks[i, j] == 2 and shares[i, j] < PEAK * inside[0]:
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
def _together(image: Image, weights: Array, places: Array, radii: Array) -> Array:
    """Centers of discs that touch, the share of each that is covered, its moments in squared radii, and fill. (K, 7).

    A pixel counts for the disc that it is nearest to. Each disc moves by how far what is covered of its pixels lies
    from what it would cover of them.
    """
    height, width = image.shape[0], image.shape[1]
    out, at = np.zeros((len(places), 7)), places.copy()
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
                    share = covered(image, i, j, weights[k])
                    share = share if share >= weights[k, TERMS] else 0.0
                    for sums, weight in ((seen, share), (ideal, min(max(0.5 - beyond, 0.0), 1.0))):
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
