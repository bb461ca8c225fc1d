"""Finds spots where a marker covers the picture, by flooding downhill from where it covers most, and measures them.

Where coverage rises again another marker begins, or what is beyond the edge of a body. Markers that touch may be one
spot: only where each is expected tells them apart (`together`).
"""

from __future__ import annotations

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.coverage import NOISE, TERMS, covered
from markertrack.tracking.tracker import EVEN, Array, Image

_LLOYD_ROUNDS = 10
MOST_RIM = 0.25  # share of a spot's rim where coverage rises again, or isn't half of what it is inside, or its box ends
OUTSIDE, FREE, SPOT, SEEN = range(4)  # marks of pixels: in no box, in one, in a spot, looked at else

Shares = NDArray[np.float32]


@njit(cache=True, nogil=True)
def spots_of(image: Image, weights: Array, boxes: NDArray[np.int64], radii: Array) -> Array:
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
    radius = np.sqrt((radii * radii).mean())
    step = max(1, int(0.6 * radii.min()))
    out = np.empty((64, 7))
    count = 0
    pixels = np.empty(((marks == FREE).sum(), 2), dtype=np.int32)
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
                if rim > MOST_RIM or inside[:size].sum() < EVEN * np.pi * radii.min() ** 2:
                    continue  # a part of glare, a wall, its texture
                if count == len(out):
                    out = np.concatenate((out, np.empty_like(out)))
                _measured(pixels[:size], inside[:size], radius, out[count])
                count += out[count, 6] >= EVEN
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
    """Number of the covered pixels that are downhill of a summit, and what share of the rim isn't a marker's.

    Where coverage rises again another marker begins, or what is beyond the edge of a body. A marker's rim is down to
    half of the summit's; elsewhere it rises, isn't down yet, or no box is.
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
            if marks[i, j] == SEEN and shares[i, j] < EVEN * inside[0]:
                free += 1
            else:
                higher += 1
    return size, higher / max(higher + free, 1)


@njit(cache=True, nogil=True)
def _measured(pixels: NDArray[np.int32], weights: Array, radius: float, out: Array) -> None:
    """Fills in center, area, second central moments and fill of a spot: a disc, or a streak of one. Shape (7,)."""
    total = weights.sum()
    x, y = (weights * pixels[:, 0]).sum() / total, (weights * pixels[:, 1]).sum() / total
    dx, dy = pixels[:, 0] - x, pixels[:, 1] - y
    xx, xy, yy = (weights * dx * dx).sum(), (weights * dx * dy).sum(), (weights * dy * dy).sum()
    xx, xy, yy = xx / total, xy / total, yy / total
    length = np.sqrt(24 * np.sqrt(((xx - yy) / 2) ** 2 + xy * xy))
    expected = np.pi * radius / (np.pi * radius + 2 * length)
    fill = (weights * weights).sum() / total / expected
    out[0], out[1], out[2], out[3], out[4], out[5], out[6] = x, y, total, xx, xy, yy, fill


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
