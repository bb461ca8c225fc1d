"""A second opinion where a marker's color doesn't tell it from what is around it: correlation with its own picture.

Each marker keeps the picture of itself and its rim from the first frame, which may turn and grow, and one from when it
was last seen without a doubt. OpenCV's normalized correlation with them has its peaks where something looks like it.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.tracker import DETAIL, FAINT, Array, Image

RIM = 1.6  # radii of a marker's picture
STEP_TURN, STEP_SIZE = np.deg2rad(8), 1.06  # by which a picture is tried turned, and larger or smaller
SIZES = 0.4, 2.5  # of the first picture, at most
SURELY = 0.85  # correlation from which on it is the marker, and isn't tried turned or resized
MOST_PEAKS = 3  # that are kept
MOST_WEIGHT = 0.1  # of the distance from where a marker is expected: taken off the score at the end of the reach

Picture = NDArray[np.float32]


class _Peak(NamedTuple):
    """A place that looks like a marker [px], and how much it does, at most 1."""

    x: float
    y: float
    score: float


@dataclass
class _Patch:
    """Pictures of one marker, in which its color is 1 and what was around it 0.

    Attributes:
        axis: What a color is multiplied with.
        factor: Pixels of a frame that are one of the picture.
        radius: Of the marker in the picture [px].
        first: From the first frame, wide enough to be turned. Shape (W, W).
        recent: From when it was last seen without a doubt. Shape (N, N).
        turn: By which the first one is turned now [rad].
        size: By which it has grown.
    """

    axis: Picture
    factor: int
    radius: float
    first: Picture = field(default_factory=lambda: np.zeros((1, 1), np.float32))
    recent: Picture = field(default_factory=lambda: np.zeros((1, 1), np.float32))
    turn: float = 0.0
    size: float = 1.0


class Patches:
    """Pictures of all markers."""

    def __init__(self, image: Image, points: Array, radii: Array, colors: Array) -> None:
        """Takes the pictures of the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Centers of the markers [px]. Shape (M, 2).
            radii: Their radii [px]. Shape (M,).
            colors: How the color of each differs from what is around it. Shape (M, 3).
        """
        axes = [_axis(color) for color in colors]
        self._patches = [_patch(image, *one) for one in zip(points, radii.tolist(), axes, strict=True)]

    def of(self, markers: NDArray[np.int64]) -> Patches:
        """Those of some markers."""
        some = copy(self)
        some._patches = [replace(self._patches[marker]) for marker in markers]
        return some

    def find(self, image: Image, marker: int, place: Array, reach: float) -> list[_Peak]:
        """Places near one that look like a marker, the most likely first.

        Args:
            image: RGB. Shape (H, W, 3).
            marker: Index of the marker.
            place: Where it is expected [px]. Shape (2,).
            reach: How far from there it may be [px].
        """
        patch = self._patches[marker]
        around = _reach(patch) + int(np.ceil(reach / patch.factor)) + 1
        window = _window(image, patch, place, around)
        scores = _scores(window, patch.recent, patch)
        scores, turn, size = self._turned(window, patch, scores)
        patch.turn, patch.size = turn, size
        return _peaks(scores, window, place, patch)

    def learn(self, image: Image, marker: int, place: Array) -> None:
        """Takes the picture of a marker that was seen without a doubt."""
        patch = self._patches[marker]
        patch.recent = _window(image, patch, place, _reach(patch))

    def renew(self, image: Image, marker: int, place: Array, radius: float) -> None:
        """Takes the picture of a marker that has changed as if it were the first frame's."""
        self._patches[marker] = _patch(image, place, radius, self._patches[marker].axis)

    def grow(self, factors: Array) -> None:
        """Takes in by how much the markers have grown. Shape (M,)."""
        for patch, factor in zip(self._patches, factors.tolist(), strict=True):
            patch.size = float(np.clip(patch.size * factor, *SIZES))

    @staticmethod
    def _turned(window: Picture, patch: _Patch, recent: Picture) -> tuple[Picture, float, float]:
        """The better of the scores of the recent picture and of the first one as it may be turned and resized now."""
        turn, size = patch.turn, patch.size
        best = _scores(window, _warped(patch, turn, size), patch)
        if max(best.max(), recent.max()) < SURELY:
            for by, times in ((STEP_TURN, 1.0), (-STEP_TURN, 1.0), (0.0, STEP_SIZE), (0.0, 1 / STEP_SIZE)):
                other = patch.turn + by, float(np.clip(patch.size * times, *SIZES))
                scores = _scores(window, _warped(patch, *other), patch)
                if scores.max() > best.max():
                    best, (turn, size) = scores, other
        return np.maximum(best, recent), turn, size


def _patch(image: Image, point: Array, radius: float, axis: Picture) -> _Patch:
    """The pictures of a marker at a point (2,)."""
    factor = max(1, round(radius / DETAIL))
    patch = _Patch(axis, factor, radius / factor)
    patch.first = _window(image, patch, point, 1.5 * _reach(patch))
    patch.recent = _window(image, patch, point, _reach(patch))
    return patch


def _axis(color: Array) -> Picture:
    """The multiple of a color difference, of which the product with it is 1."""
    return (color / max(float(color @ color), 1.0)).astype(np.float32)


def _reach(patch: _Patch) -> int:
    return int(np.ceil(RIM * patch.radius)) + 1


def _window(image: Image, patch: _Patch, place: Array, reach: float) -> Picture:
    """The square around a place in the patch's color and detail. Shape (2 reach + 1, 2 reach + 1)."""
    side = (2 * int(reach) + 1) * patch.factor
    part = cv2.getRectSubPix(image, (side, side), (float(place[0]), float(place[1])))
    one = cv2.transform(part.astype(np.float32), patch.axis[None])
    if patch.factor > 1:
        one = cv2.resize(one, None, fx=1 / patch.factor, fy=1 / patch.factor, interpolation=cv2.INTER_AREA)
    return np.asarray(one, dtype=np.float32)


def _warped(patch: _Patch, turn: float, size: float) -> Picture:
    """The first picture, turned and resized about the marker."""
    middle, side = (len(patch.first) - 1) / 2, 2 * _reach(patch) + 1
    matrix = cv2.getRotationMatrix2D((middle, middle), np.rad2deg(turn), size)
    matrix[:, 2] += (side - 1) / 2 - middle
    warped = cv2.warpAffine(patch.first, matrix, (side, side), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(warped, dtype=np.float32)


def _mask(patch: _Patch) -> Picture:
    """A marker's disc and rim."""
    offsets = np.arange(-_reach(patch), _reach(patch) + 1)
    return np.clip(RIM * patch.radius + 0.5 - np.hypot(offsets, offsets[:, None]), 0, 1).astype(np.float32)


def _scores(window: Picture, picture: Picture, patch: _Patch) -> Picture:
    """Correlation with a marker's picture at all places of a window."""
    scores = cv2.matchTemplate(window, picture, cv2.TM_CCOEFF_NORMED, mask=_mask(patch))
    return np.where(np.isfinite(scores) & (np.abs(scores) <= 1.001), scores, -1.0).astype(np.float32)


def _contrast(picture: Picture, mask: Picture) -> float:
    """Standard deviation within a mask."""
    mean = np.average(picture, weights=mask)
    return float(np.sqrt(np.average((picture - mean) ** 2, weights=mask)))


def _peaks(scores: Picture, window: Picture, place: Array, patch: _Patch) -> list[_Peak]:
    """The highest of all places that are higher than those around them, to a fraction of a pixel."""
    mask, side = _mask(patch), len(patch.recent)
    least = FAINT * _contrast(patch.recent, mask)
    middle = (len(scores) - 1) / 2
    offsets = np.arange(len(scores)) - middle
    near = scores - MOST_WEIGHT * (offsets**2 + (offsets**2)[:, None]) / max(middle, 1.0) ** 2
    found: list[_Peak] = []
    for _ in range(MOST_PEAKS):
        row, column = np.unravel_index(int(np.argmax(near)), near.shape)
        if scores[row, column] < (found[0].score - (1 - SURELY) if found else 0.0):
            break
        inside = 0 < row < len(scores) - 1 and 0 < column < len(scores) - 1
        if inside and _contrast(window[row : row + side, column : column + side], mask) > least:
            x = column + _vertex(scores[row, column - 1 : column + 2]) - middle
            y = row + _vertex(scores[row - 1 : row + 2, column]) - middle
            found.append(_Peak(place[0] + x * patch.factor, place[1] + y * patch.factor, float(scores[row, column])))
        away = np.hypot(offsets - offsets[column], (offsets - offsets[row])[:, None])
        near = np.where(away < patch.radius + 1, -np.inf, near)
    return found


def _vertex(three: Picture) -> float:
    """Where the parabola through three values has its peak, from the middle one."""
    low, middle, high = map(float, three)
    bend = low - 2 * middle + high
    return float(np.clip((low - high) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0
