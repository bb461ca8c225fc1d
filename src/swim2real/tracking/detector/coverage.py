"""Where markers cover the image: compiled loops over pixels. Coverage is looked up by color, see `appearance`."""

from __future__ import annotations

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from swim2real.tracking.tracker import Array, Image

BITS = 6  # of each color that the table keeps
Table = NDArray[np.float32]
_LEAST_COVERAGE = 0.15  # below it a pixel is noise


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
        table: Of coverage.
        points: Where to begin [px]. Shape (N, 2).
        reaches: Distance from each within which pixels count [px]. Shape (N,).
        others: Points that share the pixels among them [px]. Shape (K, 2).
        radius: Of a disc [px].

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
