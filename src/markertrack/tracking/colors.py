"""The colors that a marker has, whatever is behind it: whether what is at a place may be the marker at all."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from markertrack.tracking.spots import DETAIL
from markertrack.tracking.tracker import EVEN, RATE, Array, Image

LEVELS = 16  # of red, green and blue each, that are told apart
NOISE = 1.0  # of these, of a camera

Colors = NDArray[np.float32]


class OwnColors:
    """How often each color is on each marker."""

    def __init__(self, image: Image, points: Array, radii: Array) -> None:
        """Takes the markers' pixels in a picture, whose centers are points (M, 2) and radii (M,) [px]."""
        discs = zip(points, radii.tolist(), strict=True)
        self._own = [_shares(_disc(image, point, radius)) for point, radius in discs]
        self._last: tuple[Image, Colors] | None = None  # the newest picture, and all of its colors

    def learn(self, image: Image, marker: int, place: Array, radius: float) -> None:
        """Takes in the colors that a marker has now, at its place (2,)."""
        self._own[marker] += np.float32(RATE) * (_shares(_disc(image, place, radius)) - self._own[marker])

    def are_at(self, image: Image, marker: int, place: Array, radius: float) -> bool:
        """Whether the pixels at a place (2,) are a marker's rather than any of the picture's, on average."""
        levels = _disc(image, place, radius) // (256 // LEVELS)
        if self._last is None or self._last[0] is not image:
            self._last = image, _shares(image)
        likely = _likely(self._own[marker], self._last[1])
        return bool(len(levels)) and float(likely[levels[:, 0], levels[:, 1], levels[:, 2]].mean()) > EVEN

    def peaks(self, image: Image, marker: int, radius: float, places: Array) -> tuple[Array, Array]:
        """Places where a marker's colors are and around which they aren't; how clearly they are at others, up to 1.

        Args:
            image: RGB. Shape (H, W, 3).
            marker: Its index.
            radius: Its radius [px].
            places: The others, NaN where one isn't known [px]. Shape (K, 2).

        Returns:
            Shapes (P, 2), (K,).
        """
        share = max(1, int(radius / DETAIL))
        small = cv2.resize(image, None, fx=1 / share, fy=1 / share, interpolation=cv2.INTER_AREA)
        size, levels = radius / share, small // (256 // LEVELS)
        likely = _likely(self._own[marker], _shares(image))[levels[..., 0], levels[..., 1], levels[..., 2]]
        reach = int(1.9 * size + 2)
        away = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
        inside, around = away <= size, (away >= 1.3 * size + 1) & (away <= 1.9 * size + 2)
        clear = cv2.filter2D(likely, -1, inside / inside.sum() - around / around.sum(), borderType=cv2.BORDER_REPLICATE)
        side = 4 * int(size) + 1  # markers don't overlap
        rows, columns = np.nonzero((clear == cv2.dilate(clear, np.ones((side, side), np.uint8))) & (clear > EVEN))
        found = share * np.column_stack([columns, rows]).astype(np.float64) + (share - 1) / 2
        at = np.clip(np.nan_to_num(places / share).round().astype(int), 0, np.array(clear.shape[::-1]) - 1)
        return found, np.where(np.isfinite(places[:, 0]), clear[at[:, 1], at[:, 0]], np.nan)


def _disc(image: Image, point: Array, radius: float) -> Image:
    """Pixels of a disc. Shape (N, 3)."""
    left, top = np.maximum(np.floor(point - radius), 0).astype(int).tolist()
    right, bottom = np.maximum(np.ceil(point + radius) + 1, 0).astype(int).tolist()
    part = image[top:bottom, left:right]
    rows, columns = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
    return part[np.hypot(columns - point[0], rows - point[1]) <= radius]


def _shares(pixels: Image) -> Colors:
    """Share of pixels (..., 3) of each color. Shape (L, L, L)."""
    if not pixels.size:
        return np.zeros((LEVELS,) * 3, np.float32)
    counts = cv2.calcHist([pixels.reshape(-1, 1, 3)], [0, 1, 2], None, [LEVELS] * 3, [0, 256] * 3)
    return np.asarray(counts / counts.sum(), dtype=np.float32)


def _likely(own: Colors, every: Colors) -> Colors:
    """How likely each color is a marker's and not any of the picture's, by the shares of both. Shape (L, L, L)."""
    own, every = (gaussian_filter(shares, NOISE, mode="nearest") for shares in (own, every))
    return np.asarray(own / np.maximum(own + every, 1e-12), dtype=np.float32)
