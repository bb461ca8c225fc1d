"""Finds marker-colored spots in a picture: round where a marker is still, a streak where it moved during the exposure.

A blurred marker covers as much as a sharp one, so the coverage (`coverage`) that is connected, summed, counts the
markers in a spot, and its centroid is the place in the middle of the exposure.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.coverage import NOISE, TERMS, Coverage
from markertrack.tracking.flooding import spots_of, together
from markertrack.tracking.tracker import AGREE, EVEN, Array, Image, Mask

DETAIL = 5.0  # pixels are joined to blocks while a marker's radius is as many blocks
SHARP = 0.25  # radii of a streak, up to which a marker is taken for sharp
MOST_UNEQUAL = 1.6  # ratio of the radii of markers of one kind
WHOLE = 1.4  # ratio of areas up to which a spot is neither partly hidden nor more than one


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

    def find(self, image: Image, boxes: NDArray[np.int64], ways: Array | float = 0.0) -> Spots:
        """The spots of each marker's color that lie in its box, or reach into it.

        Args:
            image: RGB. Shape (H, W, 3).
            boxes: Left, top, right, bottom; the last two are outside [px]. Shape (M, 4).
            ways: How far each may move during the exposure, which makes it fainter [px]. Shape (M,).
        """
        peaks = np.pi * self.radii / (np.pi * self.radii + 2 * ways)
        noises = self.coverage.weights[:, TERMS]
        fainter = np.clip(EVEN * peaks, NOISE[0], noises)
        parts: list[Array] = [np.empty((0, 8))]
        for kind in range(self.kinds.max() + 1):
            of = np.flatnonzero(self.kinds == kind)
            if not len(of):
                continue
            found = self._measured(image, of, boxes, noises)
            faint = of[fainter[of] < noises[of]]
            if len(faint):
                found = self._whole(found, self._measured(image, faint, boxes, fainter), of)
            parts.append(np.column_stack([found, np.full(len(found), kind)]))
        found = np.concatenate(parts)
        return Spots(found[:, :2], found[:, 2], found[:, 3:6], found[:, 6], found[:, 7].astype(np.int64))

    def _measured(self, image: Image, of: NDArray[np.int64], boxes: NDArray[np.int64], noises: Array) -> Array:
        """Center, area, moments and fill of each spot of some markers (K,) that is above noise. Shape (P, 7)."""
        weights = self.coverage.weights[of]
        weights[:, TERMS] = noises[of]
        boxes, block = boxes[of] // self._block, self._block
        corner, part = self._part(image, boxes[(boxes[:, :2] < boxes[:, 2:]).all(axis=1)])
        found = spots_of(part, weights, boxes - np.tile(corner, 2), self.radii[of] / block)
        found[:, :2] += corner
        return found * [block, block, *4 * (block**2,), 1] + [*2 * ((block - 1) / 2,), 0, 0, 0, 0, 0]

    def _part(self, image: Image, boxes: NDArray[np.int64]) -> tuple[NDArray[np.int64], Image]:
        """Where the corner of the part of a picture is that boxes (K, 4) are in, with what is next to them; the part.

        All in blocks.
        """
        block, size = self._block, np.array(image.shape[1::-1]) // self._block
        low = (boxes[:, :2].min(axis=0, initial=size.max()) - 1).clip(0, size)
        high = (boxes[:, 2:].max(axis=0, initial=0) + 1).clip(low, size)
        (left, top), (right, bottom) = low * block, high * block
        part = image[top:bottom, left:right]
        if block > 1 and part.size:
            part = np.asarray(cv2.resize(part, (high - low).tolist(), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return low, part

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
        touching = away < self.radii[:, None] + self.radii + AGREE[1]  # or may, as far as it is known
        of = np.flatnonzero(touching.sum(axis=1) > 1)
        block, radii = self._block, self.radii[of] / self._block
        at = (places[of] - (block - 1) / 2) / block
        reach = 2 * radii[:, None] + 2
        corner, part = self._part(image, np.hstack([at - reach, at + reach]).astype(np.int64))
        found = together(part, self.coverage.weights[of], at - corner, radii)
        found[:, :2] += corner
        whole = are_whole(found[:, 2]) & (found[:, 6] >= EVEN)
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


def are_whole(shares: Array) -> Mask:
    """Whether spots are one whole marker, by their areas as shares of its own. Shapes (...) twice."""
    return (shares > 1 / WHOLE) & (shares < WHOLE)


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
