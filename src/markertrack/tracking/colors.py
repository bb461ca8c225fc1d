"""Where in a picture the colors of a marker are that nothing else in it has, whatever is behind the marker.

A color tells a marker as far as the marker explains how often the picture has it: by the share of its pixels that would
be the marker's, were it wholly there (Swain, Ballard: Color indexing, IJCV 1991).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from markertrack.tracking.tracker import Array, Image

LEVELS = 16  # of red, green and blue each, that are told apart
NOISE = 1.0  # of these, of a camera
RATE = 0.1  # of the colors of a marker that is seen without a doubt, in each frame
LEAST = 0.2  # share from which a pixel may be the marker's
EVEN = 0.5  # likelihood of colors to be the marker's, from which they are rather than not
PART = 0.6  # of a marker's area that must be there: of two that are alike each has a half
KNOWN = 1.5  # radii around a marker that is known, in which its pixels are

Colors = NDArray[np.float32]


class OwnColors:
    """How many pixels of each color the markers have."""

    def __init__(self, image: Image, points: Array, radii: Array) -> None:
        """Takes the markers' pixels in a picture, whose centers are points (M, 2) and radii (M,) [px]."""
        discs = zip(points, radii.tolist(), strict=True)
        self._own = [_counted(_disc(image, point, radius)) for point, radius in discs]
        self._last: tuple[Image, Colors] = image, _counted(image)

    def learn(self, image: Image, marker: int, place: Array, radius: float) -> None:
        """Takes in the colors that a marker has now, at its place (2,)."""
        now = _counted(_disc(image, place, radius))
        self._own[marker] += np.float32(RATE) * (now - self._own[marker])

    def alike(self, image: Image, marker: int, place: Array, radius: float) -> float:
        """How likely the pixels at a place (2,) are a marker's and not any of the picture's, on average."""
        levels = _disc(image, place, radius) // (256 // LEVELS)
        if not len(levels):
            return 0.0
        everywhere = self._everywhere(image)
        own = self._own[marker]
        own, everywhere = own / max(own.sum(), 1e-9), everywhere / everywhere.sum()
        likely = own / np.maximum(own + everywhere, 1e-12)
        return float(likely[levels[:, 0], levels[:, 1], levels[:, 2]].mean())

    def find(self, image: Image, marker: int, place: Array, reach: float, radius: float, others: Array) -> Array | None:
        """The center (2,) of what alone has a marker's colors within reach of a place (2,); None if nothing has.

        Args:
            image: RGB. Shape (H, W, 3).
            marker: Its index.
            place: Where it is looked for [px]. Shape (2,).
            reach: How far from there [px].
            radius: Of the marker [px].
            others: Places of markers that are known, whose pixels don't count [px]. Shape (K, 2).
        """
        everywhere = self._everywhere(image)
        for other in others:
            everywhere = everywhere - _counted(_disc(image, other, KNOWN * radius))
        shares = np.minimum(self._own[marker] / np.maximum(everywhere, 1.0), 1.0)
        left, top = np.maximum(np.floor(place - reach), 0).astype(int).tolist()
        right, bottom = (np.ceil(place + reach).astype(int) + 1).tolist()
        part = image[top:bottom, left:right]
        if not part.size:
            return None
        levels = part // (256 // LEVELS)
        weights = shares[levels[..., 0], levels[..., 1], levels[..., 2]]
        for x, y in others - (left, top):
            cv2.circle(weights, (round(x), round(y)), round(KNOWN * radius), 0.0, -1)
        count, labels = cv2.connectedComponents((weights > LEAST).astype(np.uint8), connectivity=8)
        covered = np.bincount(labels.ravel(), weights.ravel().astype(float), minlength=count)
        covered[0] = 0.0
        best = int(covered.argmax())
        if covered[best] < PART * np.pi * radius**2:
            return None
        rows, columns = np.nonzero(labels == best)
        own = weights[rows, columns].astype(float)
        return np.array([left + own @ columns / own.sum(), top + own @ rows / own.sum()])

    def _everywhere(self, image: Image) -> Colors:
        """Number of the picture's pixels of each color. Shape (L, L, L)."""
        if self._last[0] is not image:
            self._last = image, _counted(image)
        return self._last[1]


def _disc(image: Image, point: Array, radius: float) -> Image:
    """Pixels of a disc. Shape (N, 3)."""
    left, top = np.maximum(np.floor(point - radius), 0).astype(int).tolist()
    right, bottom = (np.ceil(point + radius).astype(int) + 1).tolist()
    part = image[top:bottom, left:right]
    rows, columns = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
    return part[np.hypot(columns - point[0], rows - point[1]) <= radius]


def _counted(pixels: Image) -> Colors:
    """Number of pixels (..., 3) of each color, spread as noise does. Shape (L, L, L)."""
    counts = cv2.calcHist([pixels.reshape(-1, 1, 3)], [0, 1, 2], None, [LEVELS] * 3, [0, 256] * 3)
    return np.asarray(gaussian_filter(counts, NOISE, mode="nearest"), dtype=np.float32)
