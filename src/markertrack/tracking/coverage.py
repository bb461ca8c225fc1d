"""Which share of a pixel a marker covers: a cubic polynomial of its color.

It is fitted by least squares to the marker's disc, to what surrounds it, and to mixtures of both as motion blurs them.
So it is right for light and dark surroundings at once, for markers of several colors, and for mixed colors at an edge.
What it is a polynomial of is learned slowly, and at once how much the surroundings have of it: light changes both.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.tracker import EVEN, RATE, Array, Image, Mask

SURROUNDINGS = 2.0  # radii around a marker that its color is told apart from
LIGHT = ((np.arange(256) + 0.5) / 256) ** 2.2  # of the levels of a picture
MIXTURES = 4  # shares of a blurred marker in what is around it
EDGE, EDGE_WEIGHT = 1.5, 0.2  # px beside the edge of a disc, which isn't known that well, and what they count
SAMPLES = 1000  # pixels that tell what a marker or its surroundings are like
RIDGE = 1e-5  # of the squares of the terms, by which a fit is held
NOISE = 0.1, 0.5  # least and largest of coverage
DEVIATIONS = 2.5  # of coverage beside a marker that are noise
LEAST = 0.2  # coverage of a marker above that of what is around it, by which it is scaled
TERMS = 20  # of a cubic polynomial of red, green and blue
ON, OFF, DISC, CORE = slice(TERMS), slice(TERMS, 2 * TERMS), 2 * TERMS, 2 * TERMS + 1  # columns of `moments`


class Coverage:
    """Coverage by each marker of what has a color: 1 of its own, 0 of what is around it.

    Attributes:
        weights: Of the terms of the polynomials, and the coverage that what is around easily has. Shape (M, 21).
        clear: Whether each is rather told from what is around it than not. Shape (M,).
    """

    def __init__(self, image: Image, points: Array, radii: Array, unsure: float) -> None:
        """Learns from a picture.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Centers of the markers [px]. Shape (M, 2).
            radii: Their radii [px]. Shape (M,).
            unsure: By how much both may be off [px].
        """
        count = len(points)
        self._known = moments(image, points, radii, np.arange(count), unsure)
        self._around = self._known[:, :, OFF.start].copy()  # mean terms of what is around each now
        self.weights, self.clear = np.empty((count, TERMS + 1)), np.empty(count, dtype=bool)
        self._fit(np.arange(count))

    def of(self, markers: NDArray[np.int64]) -> Coverage:
        """That by some markers."""
        some = copy(self)
        for name in ("_known", "_around", "weights", "clear"):
            setattr(some, name, getattr(self, name)[markers])
        return some

    def take(self, marker: int, other: Coverage) -> None:
        """Takes another coverage, by one marker, for one of these."""
        self._known[marker], self._around[marker] = other._known[0], other._around[0]
        self._fit(np.array([marker]))

    def learn(self, image: Image, positions: Array, radii: Array, markers: NDArray[np.int64]) -> None:
        """Takes in what some markers (K,) look like now, by positions (M, 2), NaN of lost ones, and radii (M,) [px]."""
        now = moments(image, positions, radii, markers, 0.0)
        self._known[markers] += RATE * (now - self._known[markers])
        self._around[markers] = now[:, :, OFF.start]
        self._fit(markers)

    def alike(self) -> Mask:
        """Which markers cover rather more than less of one another. Shape (M, M)."""
        covers = self._known[:, :, CORE] @ self.weights[:, :TERMS].T
        return np.minimum(covers, covers.T) > EVEN

    def _fit(self, markers: NDArray[np.int64]) -> None:
        known = self._known[markers]
        weights = polynomials(known)
        weights[:, 0] -= (weights * self._around[markers]).sum(axis=1)  # the first term is 1
        own = (weights * known[:, :, CORE]).sum(axis=1)  # less than 1 where other things have its colors
        weights /= np.maximum(own, LEAST)[:, None]
        squares = np.einsum("mi,mij,mj->m", weights, known[:, :, OFF], weights)
        noise = np.clip(DEVIATIONS * np.sqrt(np.maximum(squares, 0.0)), *NOISE)
        self.weights[markers], self.clear[markers] = np.column_stack([weights, noise]), own > EVEN


def polynomials(known: Array) -> Array:
    """Weights of the terms by which coverage is fitted best to what is known of markers: `moments`. Shape (K, 20)."""
    matrix = known[:, :, ON] + known[:, :, OFF]
    held = RIDGE * (np.einsum("mii->mi", matrix) + 1e-9)
    return np.linalg.solve(matrix + held[:, :, None] * np.eye(TERMS), known[:, :, DISC, None])[..., 0]


@njit(cache=True, nogil=True)
def _terms(red: float, green: float, blue: float, out: Array) -> None:
    """Fills in the terms of a color from 0 to 1. Shape (20,)."""
    n, r = 0, 1.0
    for i in range(4):
        g = r
        for j in range(4 - i):
            b = g
            for _ in range(4 - i - j):
                out[n] = b
                n += 1
                b *= blue
            g *= green
        r *= red


@njit(cache=True, nogil=True)
def covered(image: Image, i: int, j: int, w: Array) -> float:
    """Coverage of a pixel, from 0 to 1, by weights (21,)."""
    r, g, b = (image[i, j, 0] + 0.5) / 256, (image[i, j, 1] + 0.5) / 256, (image[i, j, 2] + 0.5) / 256
    none = w[0] + b * (w[1] + b * (w[2] + b * w[3])) + g * (w[4] + b * (w[5] + b * w[6]))
    none += g * g * (w[7] + b * w[8] + g * w[9])
    one = w[10] + b * (w[11] + b * w[12]) + g * (w[13] + b * w[14] + g * w[15])
    two = w[16] + b * w[17] + g * w[18]
    return min(max(none + r * (one + r * (two + r * w[19])), 0.0), 1.0)


@njit(cache=True, nogil=True)
def moments(image: Image, points: Array, radii: Array, markers: NDArray[np.int64], unsure: float) -> Array:
    """What a fit needs: mean products of the terms on and off some markers, and with a disc; mean terms on them.

    Where points may be off, only pixels count that are on or off a marker all the same.

    Args:
        image: RGB. Shape (H, W, 3).
        points: Centers of all markers, NaN for those that aren't seen [px]. Shape (M, 2).
        radii: Their radii [px]. Shape (M,).
        markers: Indices of those that are looked at. Shape (K,).
        unsure: By how much points and radii may be off [px].

    Returns:
        Columns `ON`, `OFF`, `DISC`, `CORE`. Shape (K, 20, 42).
    """
    out = np.zeros((len(markers), TERMS, 2 * TERMS + 2))
    room = 4 * SAMPLES + int(8 * (SURROUNDINGS * radii.max() + 2 * unsure + 1))  # and those on the edge
    terms, weights, shares = np.empty((3, room, TERMS)), np.empty((3, room)), np.empty((3, room))
    own, mixed, count = np.empty(3), np.empty(3), np.empty(3, dtype=np.int64)
    for k in range(len(markers)):
        m = markers[k]
        x, y = points[m]
        radius = radii[m]
        around = SURROUNDINGS * radius + 2 * unsure + 1
        near = np.flatnonzero(np.sqrt((points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2) < 2 * around + radii)
        inner, outer = max(radius - unsure, 0.4 * radius), radius + unsure
        count[:], own[:], total = 0, 0.0, 0.0
        for part in range(2):  # on it and beside it
            far = radius + 0.5 if part == 0 else around
            step = max(1, int(np.sqrt(np.pi * far * far / SAMPLES)))
            for i in range(max(int(y - far), 0), min(int(y + far) + 2, image.shape[0]), step):
                for j in range(max(int(x - far), 0), min(int(x + far) + 2, image.shape[1]), step):
                    away = np.sqrt((j - x) ** 2 + (i - y) ** 2)
                    share = min(max(radius - away + 0.5, 0.0), 1.0)
                    if away > far or (share > 0.5) != (part == 0) or (unsure > 0 and inner < away < outer):
                        continue
                    mine = True
                    for n in near:
                        other = np.sqrt((j - points[n, 0]) ** 2 + (i - points[n, 1]) ** 2)
                        if n != m and (other < away or other < radii[n] + unsure + 1):
                            mine = False
                    if not mine:
                        continue
                    weight, color = EDGE_WEIGHT if abs(away - radius) < EDGE else 1.0, image[i, j]
                    red, green, blue = (color[0] + 0.5) / 256, (color[1] + 0.5) / 256, (color[2] + 0.5) / 256
                    _terms(red, green, blue, terms[part, count[part]])
                    weights[part, count[part]], shares[part, count[part]] = weight, share
                    count[part] += 1
                    if part == 0:
                        total += weight
                        for c in range(3):
                            own[c] += weight * LIGHT[color[c]]
                    elif weight == 1.0 and total > 0:  # as it would be where the marker is blurred
                        share = (1 + count[2] % MIXTURES) / (MIXTURES + 1)
                        for c in range(3):
                            mixed[c] = (share * own[c] / total + (1 - share) * LIGHT[color[c]]) ** (1 / 2.2)
                        _terms(mixed[0], mixed[1], mixed[2], terms[2, count[2]])
                        weights[2, count[2]], shares[2, count[2]] = 1.0, share
                        count[2] += 1
        for part in range(3):
            seen, disc, counts = terms[part, : count[part]], shares[part, : count[part]], weights[part, : count[part]]
            weighed = np.ascontiguousarray((seen * (counts / max(counts.sum(), 1e-9)).reshape(-1, 1)).T)
            first = TERMS if part == 1 else 0
            out[k, :, first : first + TERMS] += weighed @ seen
            out[k, :, DISC] += weighed @ disc
            if part == 0:
                out[k, :, CORE] = (disc**2 / max((disc**2).sum(), 1e-9)) @ seen
    return out
