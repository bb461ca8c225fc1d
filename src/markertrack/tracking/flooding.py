"""Finds spots where a marker covers the picture, by flooding downhill from where it covers most, and measures them.

Where coverage rises again another marker begins, or what is beyond the edge of a body. A spot that has the area of
several markers is split among them.
"""

from __future__ import annotations

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.coverage import NOISE, TERMS, covered
from markertrack.tracking.tracker import Array, Image

LEAST_AREA, MOST_AREA = 0.5, 1.6  # of the smallest marker's of a kind, and of the largest
LEAST_FILL = 0.45  # of the coverage that a streak of this length should have
PEAK = 0.5  # of what is covered most of a spot or streak: its border
MOST_MARKERS = 12  # in one spot; what is larger is no marker
MOST_STREAK = 10.0  # radii
MOST_RIM = 0.25  # share of a spot's rim where coverage rises again, or isn't half of what it is inside, or its box ends
_LLOYD_ROUNDS = 10
OUTSIDE, FREE, SPOT, SEEN = range(4)  # marks of pixels: in no box, in one, in a spot, looked at else

Shares = NDArray[np.float32]


@njit(cache=True, nogil=True)
def spots_of(image: Image, weights: Array, boxes: NDArray[np.int64], radii: Array, alone: bool) -> Array:
    """Center, area, moments and fill of every spot of one kind. Shape (P, 7)."""
    height, width = image.shape[0], image.shape[1]
    shares, marks = np.empty((height, width), dtype=np.float32), np.zeros((height, width), dtype=np.int8)  # OUTSIDE
    for box in range(len(boxes)):
        left, top, right, bottom = boxes[box]
        own = weights[box]
        for i in range(max(top, 0), min(bottom, height)):
            for j in range(max(left, 0), min(right, width)):
                if marks[i, j] == OUTSIDE:
                    marks[i, j], shares[i, j] = FREE, covered(image, i, j, own)
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
                if marks[i, j] != FREE or shares[i, j] < noise:
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
                _split(pixels[:size], inside[:size], number, radius, out[count : count + number])
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
    while True:
        at_row, at_column = row, column
        for i in range(max(at_row - reach, 0), min(at_row + reach + 1, height)):
            for j in range(max(at_column - reach, 0), min(at_column + reach + 1, width)):
                if marks[i, j] == FREE and shares[i, j] > best:
                    best, row, column = shares[i, j], i, j
        if (row, column) == (at_row, at_column):
            return row, column


@njit(cache=True, nogil=True)
def _flooded(
    shares: Shares, marks: NDArray[np.int8], noise: float, row: int, column: int, pixels: NDArray[np.int32],
    inside: Array, lowest: Array,
) -> tuple[int, float]:  # fmt: skip
    """Number of the covered pixels that are downhill of a summit, or as many as there is room for.

    Where coverage rises again another marker begins, or what is beyond the edge of a body. The share of the rim where
    it does, or isn't down to half of the summit's, or where no box is, is given as well.
    """
    height, width = marks.shape
    marks[row, column] = SPOT
    pixels[0, 0], pixels[0, 1] = column, row
    inside[0] = lowest[0] = shares[row, column]
    size, done = 1, 0
    while done < size:
        x, y = pixels[done]
        done += 1
        for k in range(4):
            j, i = x + (k == 0) - (k == 1), y + (k == 2) - (k == 3)
            if not (0 <= i < height and 0 <= j < width) or marks[i, j] != FREE:
                continue
            share = shares[i, j] if shares[i, j] >= noise else 0.0
            if share > lowest[done - 1] + NOISE[0]:
                continue
            marks[i, j] = SPOT if share > 0.0 else SEEN
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
            if not (0 <= i < height and 0 <= j < width) or marks[i, j] == SPOT:
                continue
            if marks[i, j] == SEEN and shares[i, j] < PEAK * inside[0]:
                free += 1
            else:
                higher += 1
    return size, higher / max(higher + free, 1)


@njit(cache=True, nogil=True)
def _split(pixels: NDArray[np.int32], weights: Array, number: int, radius: float, out: Array) -> None:
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
def together(image: Image, weights: Array, places: Array, radii: Array) -> Array:
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
