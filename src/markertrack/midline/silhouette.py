"""Silhouette of a swimmer: what in a picture differs from the ground as the swimmer at two clicked ends does.

The clicks tell the swimmer's color against the ground around it. Pictures are projected on that difference, so that a
swimmer of any color is bright. The ground is what is dark over the film; where the swimmer covers the same place in
nearly all pictures, as one does that holds station or rests, it is taken from around it. The faintest part of the way
from click to click decides which level still is swimmer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from markertrack.midline.grid import Grid
from markertrack.tracking.tracker import Array, Image, Mask
from swimbase.errors import TrackingError

Picture = NDArray[np.float32]

DARKEST = 10  # percentile of a place's levels over the film that are the ground's
COARSE = 32  # px that the swimmer is long in the picture in which the ground is mended
BESIDE = 0.25  # lengths to either side of the clicked line in which the swimmer's color is looked for
LEAST_NOISE = 0.5  # levels
NOISES = 4.0  # standard deviations of the ground's noise, below which nothing is swimmer
FAINT = 10  # percentile of contrast on the way between the clicks that is the swimmer's faintest part
VISIBLE = 0.8  # of that way that must stand out
TONE, TWO_TONES = 0.6, 0.15  # contrast, and area, of a part of the contrary tone, as shares of the swimmer's
LEAST_AREA, MOST_AREA = 0.2, 3.0  # of the clicked swimmer's, within which a shape is looked at
PART = 0.05  # of the swimmer's area, from which something else may be a part of it
GLINT = 0.02  # of a shape's area, up to which a hole is none
AROUND = 0.12  # lengths around a shape in which it is seen what else stands out
SIGMA = 1.0  # px, by which pictures are smoothed


@dataclass(frozen=True)
class Shape:
    """A connected part of a picture that may be the swimmer.

    Attributes:
        mask: Its pixels, in a window with a border that is empty. Shape (h, w).
        contrast: Contrast there, 1 at the swimmer's faintest part. Shape (h, w).
        corner: Place of the window's first pixel [px]. Shape (2,).
        area: Number of its pixels [px²].
        cut: Whether it touches the edge of the picture.
        apart: Distance of each pixel from what else stands out, up to some way [px]. Shape (h, w).
    """

    mask: Mask
    contrast: Picture
    apart: Picture
    corner: Array
    area: float
    cut: bool


class Silhouette:
    """Finds shapes that look like the swimmer.

    Attributes:
        length: Length of the way through the swimmer from click to click [px].
        area: Area of the clicked swimmer [px²].
        level: Contrast at and above which a pixel is swimmer.
    """

    def __init__(self, samples: Sequence[Image], clicked: Image, ends: Array) -> None:
        """Learns the ground and the swimmer.

        Args:
            samples: Pictures from all over the film, RGB. Shapes (H, W, 3).
            clicked: The one with the clicks. Shape (H, W, 3).
            ends: Head and tail [px]. Shape (2, 2).

        Raises:
            TrackingError: Nothing, or only a part of the way between the clicks, stands out.
        """
        self._color, far = _color(clicked, ends), float(np.hypot(*(ends[1] - ends[0])))
        levels = np.array([np.clip(self._bright(one), -128, 127).round().astype(np.int8) for one in samples])
        rank = round(DARKEST / 100 * (len(levels) - 1))
        ground = np.partition(levels, rank, axis=0)[rank].astype(np.float32)
        self._ground = _smooth(_without_swimmer(ground, self._bright(clicked), ends, far))
        noises = [float(np.median(np.abs(self._contrast(one)))) for one in samples[:: max(1, len(samples) // 8)]]
        noise = max(1.4826 * float(np.median(noises)), LEAST_NOISE)
        contrast = self._contrast(clicked)
        path = _way(contrast, ends, noise)
        along = contrast[path[:, 1], path[:, 0]]
        seen = along > NOISES * noise
        if not seen.mean() >= VISIBLE:
            raise TrackingError(
                f"between the clicked head and tail the swimmer stands out of the ground in {100 * seen.mean():.0f} % "
                f"of its length; a midline takes at least {100 * VISIBLE:.0f} %, a swimmer of one tone on an even "
                "ground: click its ends in another frame, or put markers on it and track these"
            )
        usual = float(np.median(along[seen]))
        tone = _smooth(self._bright(clicked))
        tone = tone[_beside(tone.shape, ends, BESIDE)] / np.percentile(tone[path[:, 1], path[:, 0]], 90)
        own, contrary = (np.count_nonzero(sign * tone > TONE) for sign in (1, -1))
        if contrary > TWO_TONES * own:
            raise TrackingError(
                f"the swimmer has two tones: for 100 px that are {_darker(self._color[0])} than the ground "
                f"{100 * contrary / own:.0f} are the contrary, and a midline needs one tone: put markers on it, or "
                "track those that it has"
            )
        self.level = max(0.5 * float(np.percentile(along[seen], FAINT)), NOISES * noise)
        self.length = float(np.hypot(*np.diff(path, axis=0).T).sum())
        self._seed = 0.5 * usual / self.level
        self.area, self._gap = 0.0, 0
        whole = [shape for shape in self.shapes(clicked) if _holds(shape, path)]
        if not whole:
            raise TrackingError(
                "no shape in the clicked frame holds the way from head to tail; click its ends in a frame in which it "
                "is seen whole"
            )
        self.area = max(shape.area for shape in whole)
        self._gap = round(0.5 * self.area / self.length)

    def shapes(self, image: Image) -> list[Shape]:
        """Connected parts of a picture (H, W, 3) that stand out as the swimmer does and aren't far smaller."""
        contrast = self._contrast(image)
        around = max(round(0.5 * self.area / self.length) + 2, round(AROUND * self.length))
        count, labels, stats, _ = cv2.connectedComponentsWithStats((contrast > self.level).astype(np.uint8))
        seen = stats[:, cv2.CC_STAT_AREA] >= PART * self.area
        seen &= np.isin(np.arange(count), labels[contrast > self._seed * self.level])
        labels, contrast = np.pad(labels, around).astype(np.int64), np.pad(contrast, around)
        found: list[Shape] = []
        for k in range(1, count):
            left, top, wide, high, area = stats[k].tolist()
            if not max(LEAST_AREA * self.area, self.length) <= area <= MOST_AREA * (self.area or np.inf):
                continue
            window = np.s_[top : top + high + 2 * around, left : left + wide + 2 * around]
            own, above = labels[window] == k, contrast[window] / np.float32(self.level)
            if above[own].max() < self._seed:
                continue
            size = image.shape
            cut = left == 0 or top == 0 or left + wide == size[1] or top + high == size[0]
            whole = _closed(own, self._gap)
            bridged = cv2.morphologyEx(above, cv2.MORPH_CLOSE, np.ones((2 * self._gap + 1,) * 2, np.uint8))
            above = np.where(whole & (above < 1), np.maximum(bridged, np.float32(1.01)), above)
            others = seen[labels[window]] & ~whole & (labels[window] > 0)
            apart = np.asarray(cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5), np.float32)
            corner = np.array([left, top], dtype=float) - around
            found.append(Shape(whole, above, apart, corner, float(area), cut))
        return found

    def _contrast(self, image: Image) -> Picture:
        """Brightness over the ground, without what all of the picture has of it, as flicker does."""
        contrast = _smooth(self._bright(image)) - self._ground
        return contrast - np.float32(np.median(contrast[::4, ::4]))

    def _bright(self, image: Image) -> Picture:
        weights, ground = self._color
        return np.asarray(cv2.transform(image.astype(np.float32), weights[None]), np.float32) - ground


def _color(image: Image, ends: Array) -> tuple[Picture, np.float32]:
    """Weights of red, green and blue that make the swimmer bright (3,), and what they give of the ground around it."""
    beside = _beside(image.shape[:2], ends, BESIDE)
    around = _beside(image.shape[:2], ends, 2 * BESIDE)
    ground = np.median(image[around], axis=0)
    off = image[beside].astype(float) - ground
    axis = np.linalg.svd(off.T @ off)[0][:, 0]
    axis *= np.sign(((off @ axis) ** 3).sum()) or 1.0
    weights = (axis / np.abs(axis).sum()).astype(np.float32)
    return weights, np.float32(weights @ ground)


def _darker(weights: Picture) -> str:
    return "darker" if weights.sum() < 0 else "brighter"


def _beside(shape: tuple[int, ...], ends: Array, share: float) -> Mask:
    """Pixels within a share of the distance of the line between two ends."""
    mask, far = np.zeros(shape, dtype=np.uint8), float(np.hypot(*(ends[1] - ends[0])))
    (x0, y0), (x1, y1) = np.round(ends).astype(int).tolist()
    cv2.line(mask, (x0, y0), (x1, y1), 1, max(3, round(2 * share * far)))
    return mask > 0


def _without_swimmer(ground: Picture, clicked: Picture, ends: Array, far: float) -> Picture:
    """The ground, where it holds the swimmer as it is in the clicked picture taken from around."""
    _, stands = _coarse(clicked, far)
    opened, held = _coarse(ground, far)
    beside = np.asarray(cv2.resize(_beside(ground.shape, ends, BESIDE).astype(np.uint8), held.shape[::-1])) > 0
    level = 0.5 * float(np.percentile(stands[beside], 90))
    swimmer = np.asarray(cv2.dilate(((stands > level) & beside).astype(np.uint8), np.ones((3, 3), np.uint8)))
    if held[swimmer > 0].max(initial=0.0) < level:
        return ground
    _, labels = cv2.connectedComponents((held > 0.5 * level).astype(np.uint8), connectivity=8)
    own = np.unique(labels[(swimmer > 0) & (labels > 0)])
    hole = np.asarray(cv2.dilate(np.isin(labels, own).astype(np.uint8), np.ones((5, 5), np.uint8)))
    wide = tuple(ground.shape[::-1])
    inside = np.asarray(cv2.resize(hole, wide, interpolation=cv2.INTER_NEAREST)) > 0
    filled = np.asarray(cv2.resize(opened, wide, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    return np.where(inside, np.minimum(filled, ground), ground)


def _coarse(picture: Picture, far: float) -> tuple[Picture, Picture]:
    """A small picture without what is bright and narrower than half a length [px], and what that is."""
    share = min(1.0, COARSE / far)
    size = tuple(max(8, round(share * n)) for n in picture.shape[::-1])
    side = round(0.5 * share * far) | 1
    small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    opened = np.asarray(cv2.morphologyEx(small, cv2.MORPH_OPEN, kernel), dtype=np.float32)
    above = small - opened
    usual = np.float32(np.median(above))  # by noise
    return opened + usual, above - usual


def _way(contrast: Picture, ends: Array, noise: float) -> NDArray[np.int64]:
    """The way between two ends that stays brightest, in whole px. Shape (N, 2)."""
    near = _beside(contrast.shape, ends, 1.0)
    grid = Grid(near)
    return grid.path(ends[0], ends[1], np.maximum(contrast[near], noise) ** -2.0)


def _holds(shape: Shape, path: NDArray[np.int64]) -> bool:
    """Whether most of a way (N, 2) lies in a shape."""
    x, y = (path - shape.corner.astype(int)).T
    height, width = shape.mask.shape
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    return bool(shape.mask[y[inside], x[inside]].sum() > 0.5 * len(path))


def _closed(mask: Mask, gap: int) -> Mask:
    """A shape without glints, and without gaps narrower than twice so many px: between eyes, or lobes of a tail."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * gap + 1, 2 * gap + 1))
    mask = np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel)) > 0
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    small = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] < GLINT * mask.sum()]
    return mask | np.isin(labels, small)


def _smooth(picture: Picture) -> Picture:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), SIGMA), dtype=np.float32)
