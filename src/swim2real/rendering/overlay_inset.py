"""The enlarged view of the fish in a corner of the overlay, and where the labels stand in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image, Resampling

from swim2real.rendering.drawing import Bytes, to_pillow

Array = NDArray[np.float64]

FOLLOW_TIME = 0.15  # s in which it follows the fish: it must not shake with every beat
MOST_ZOOM, LEAST_ZOOM = 3.0, 1.3  # with less it would show nothing new
SHARE = (0.56, 0.45)  # of the picture's width and height, which it takes at most
ROOM, BREADTH = 0.3, 0.5  # of the fish's length: more than the fish takes now, and in any direction: it beats
GAP = 14  # px to the edges of the picture
NEAR = 24  # px from a marker to what hides the track


class Inset:
    """An enlarged view that follows the fish, from a corner where it hides none of it.

    All places are in pixels of the picture that it stands in.

    Attributes:
        zoom: Pixels to a pixel of the picture around it.
        size: Width and height [px].
        corner: Where its top left pixel is [px]; None while every corner would hide some of the fish, or where the fish
            is so large that nothing can be enlarged.
    """

    def __init__(self, points: Array, picture: tuple[int, int]) -> None:
        """Fits a view around the fish as it is now; size and zoom stay.

        Args:
            points: Markers that are seen [px]. Shape (N, 2).
            picture: Width and height of the picture [px].
        """
        self._picture = np.array(picture, dtype=float)
        extent = np.ptp(points, axis=0)
        length = float(np.hypot(*extent))
        extent = np.maximum(extent + ROOM * length, max(BREADTH * length, 16.0))
        self.zoom = float(min(MOST_ZOOM, *(SHARE * self._picture / extent)))
        width, height = (2 * round(side * self.zoom / 2) for side in extent.tolist())
        self.size = (width, height)
        right, bottom = picture[0] - width - GAP, picture[1] - height - GAP
        self._corners = [(right, bottom), (GAP, bottom), (right, GAP), (GAP, GAP)]
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        self._middle, self._time = (self._low + self._high) / 2, 0.0
        self.corner: tuple[int, int] | None = None

    def follow(self, points: Array, time: float) -> None:
        """Moves along with the markers that are seen. Shape (N, 2)."""
        if len(points):
            self._low, self._high = points.min(axis=0), points.max(axis=0)
            share = 1 - np.exp(-max(time - self._time, 0.0) / FOLLOW_TIME)
            self._middle = self._middle + share * ((self._low + self._high) / 2 - self._middle)
        self._time = time
        self.corner = self._best()

    def places(self, points: Array) -> Array:
        """Where places of the picture are in the view [px]. Shape (..., 2)."""
        return (points + 0.5 - self._start()) * self.zoom - 0.5

    def cut(self, image: Bytes) -> Image:
        """The view, out of the picture in any resolution."""
        factor = np.array(image.shape[1::-1]) / self._picture
        low = self._start() * factor
        high = low + np.array(self.size) / self.zoom * factor
        first = np.maximum(np.floor(low).astype(int) - 4, 0)
        last = np.ceil(high).astype(int) + 4
        part = to_pillow(image[first[1] : last[1], first[0] : last[0]])
        left, top, right, bottom = *(low - first), *np.minimum(high - first, part.size)
        box = (float(left), float(top), float(right), float(bottom))
        return part.resize(self.size, Resampling.BILINEAR, box)

    def _start(self) -> Array:
        """The corner of what is shown, measured from the corner of the picture."""
        part = np.array(self.size) / self.zoom
        return np.clip(self._middle + 0.5 - part / 2, 0, self._picture - part)

    def _best(self) -> tuple[int, int] | None:
        """A corner where it hides nothing of the fish: the one it is in, or else the one farthest from the fish."""
        if self.zoom < LEAST_ZOOM:
            return None
        corners, size = np.array(self._corners), np.array(self.size)
        low, high = self._low - NEAR, self._high + NEAR
        free = ((corners >= high) | (corners + size <= low)).any(axis=1)
        if not free.any():
            return None
        if self.corner is not None and free[self._corners.index(self.corner)]:
            return self.corner
        away = np.hypot(*(corners + size / 2 - (low + high) / 2).T)
        return self._corners[int(np.argmax(np.where(free, away, -1.0)))]


def label_places(places: Array, sizes: Sequence[tuple[int, int]], low: Array, high: Array) -> Array:
    """Where labels stand: in rows at the long sides of a box, by turns, each as close to its marker as there is room.

    Args:
        places: Places of the markers, NaN where unknown [px]. Shape (M, 2).
        sizes: Sizes of the labels: width and height [px].
        low: Top left corner of the box [px]. Shape (2,).
        high: Bottom right corner of the box [px]. Shape (2,).

    Returns:
        The middles of the labels [px]; NaN for markers that aren't in the box, and for rows that are too long for it.
        Shape (M, 2).
    """
    axis = 0 if high[0] - low[0] >= high[1] - low[1] else 1  # along the long sides
    halves = np.array(sizes, dtype=float) / 2
    known = np.flatnonzero((places >= low).all(axis=1) & (places <= high).all(axis=1))
    out = np.full(places.shape, np.nan)
    for side in (0, 1):
        row = known[known % 2 == side]
        row = row[np.argsort(places[row, axis], kind="stable")]
        if len(row) == 0:
            continue
        steps = np.concatenate([[0.0], np.cumsum(halves[row[1:], axis] + halves[row[:-1], axis])])
        at = _rising(places[row, axis] - steps) + steps  # labels that touch move as one
        first, last = low[axis] + halves[row[0], axis], high[axis] - halves[row[-1], axis] - steps[-1]
        if first > last:
            continue
        out[row, axis] = np.clip(at, first + steps, last + steps)
        depth = halves[row, 1 - axis]
        out[row, 1 - axis] = low[1 - axis] + depth if side == 0 else high[1 - axis] - depth
    return out


def _rising(values: Array) -> Array:
    """The closest values, in squares, that never fall: neighbors out of order are replaced by their mean."""
    means: list[float] = []
    counts: list[int] = []
    for value in values.tolist():
        means.append(value)
        counts.append(1)
        while len(means) > 1 and means[-2] > means[-1]:
            count = counts[-2] + counts[-1]
            mean = (means[-2] * counts[-2] + means[-1] * counts[-1]) / count
            means[-2:], counts[-2:] = [mean], [count]
    return np.repeat(means, counts)
