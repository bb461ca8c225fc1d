"""What each marker looks like: its own colors, area and shape, learned where it was picked and followed as they change.

A marker is compared with itself only: markers may differ from one another, be out of round, have a hub or a highlight.
One that its color doesn't tell from what is around it is known by its picture (`patches`).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.labeling import find_blobs
from markertrack.tracking.patches import Patches
from markertrack.tracking.radii import LEAST_DETAIL, own_radii
from markertrack.tracking.spots import MOST_UNEQUAL, SHARP, SpotFinder, Spots, are_whole, streak_lengths
from markertrack.tracking.tags import dictionary_at
from markertrack.tracking.tracker import AGREE, DETAIL, EVEN, EXACT, RATE, Image, check_points, contradict, inside
from swimbase.arrays import Array, Mask
from swimbase.errors import TrackingError

CLICK_SHARE = 0.7  # of the radius by which a point may be beside the spot's center
LONGEST = 3.0  # ratio of the axes of a marker
BESIDE = 5.0  # radii within which a spot that wasn't clicked is named
NEARBY = 8.0  # radii, besides its step, within which a marker is looked for by its picture
MOST_STREAK = 1.3  # of a marker's step, with a shutter that is always open and a speed that changes
ROOMS = 1.5, 2.7  # radii around a point, to each side, that its spot may fill
LEAST_SOLIDITY = 0.9  # of a marker's spot: less has a part of something else
RING_SHARE = 0.15  # of a radius that a ring is beside the point, and of its variance
ROUNDS = 2  # of measuring colors and radius anew


class Looks:
    """Looks of all markers.

    Attributes:
        points: Centers in the first frame [px]. Shape (M, 2).
        plain: Whether each is told by its color. Shape (M,).
    """

    def __init__(self, image: Image, points: Array, equal: bool = False) -> None:
        """Learns from the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Near the markers' centers [px]. Shape (M, 2).
            equal: Whether those that are alike are equally large.

        Raises:
            TrackingError: A point isn't in the frame; there are tags, or spots beside the points; or a picture of what
                is there has no detail.
        """
        check_points(image, points)
        self.points, edges = points.copy(), own_radii(image, points)
        radii, own = edges, _Own.none(points)
        for unsure in AGREE[1], *(0.0,) * ROUNDS:
            finder = SpotFinder(image, self.points, radii, unsure)
            measured = [_own(finder, image, points, radii, room, unsure == 0) for room in ROOMS]
            own = measured[0]
            for other in measured[1:]:
                own = own.where(other.solidity > np.maximum(own.solidity, LEAST_SOLIDITY), other)
            touching, theirs = _touching(finder, image, points)
            self.plain = touching | (own.solidity > LEAST_SOLIDITY) & ~_contradicted(own, measured)
            own = own.where(touching, theirs)
            self.points = np.where(self.plain[:, None], own.centers, points)
            radii = np.where(self.plain, np.sqrt(own.areas / np.pi), edges)
            like = finder.coverage.alike() & self.plain
            for marker in np.flatnonzero((~self.plain | equal) & like.any(axis=1)):  # it probably is as large as those
                radii[marker] = np.median(radii[like[marker]])
        self._finder = SpotFinder(image, self.points, radii)
        if not self.plain.all():
            _check_the_rest(image, self.points, radii, ~self.plain)
            radii[~self.plain] = np.median(radii[self.plain]) if self.plain.any() else DETAIL
            self._finder.radii, self._finder.kinds[~self.plain] = radii, -1
        self._areas = np.pi * radii**2
        self._first = self._areas.copy()
        disc = np.column_stack([radii**2 / 4, np.zeros(len(points)), radii**2 / 4])
        self._moments = np.where(self.plain[:, None], own.moments, disc)
        self._patches = Patches(image, self.points, radii, _contrasts(image, self.points, radii, self.plain))

    def of(self, markers: NDArray[np.int64]) -> Looks:
        """The looks of some of the markers, which are followed apart from the others from now on."""
        some = copy(self)
        some.points, some.plain = self.points[markers], self.plain[markers]
        some._areas, some._moments, some._first = self._areas[markers], self._moments[markers], self._first[markers]
        some._finder, some._patches = self._finder.of(markers), self._patches.of(markers)
        return some

    @property
    def radii(self) -> Array:
        """Radius of each marker as it is now [px]. Shape (M,)."""
        return np.sqrt(self._areas / np.pi)

    def _resize(self) -> None:
        """Has spots looked for by the radii of now."""
        self._finder.radii = np.where(self.plain, self.radii, self._finder.radii)

    def find(
        self, image: Image, boxes: NDArray[np.int64], ways: Array | float = 0.0, places: Array | None = None
    ) -> Spots:
        """The spots of the markers' colors in or at their boxes.

        Args:
            image: RGB. Shape (H, W, 3).
            boxes: Left, top, right, bottom [px]. Shape (M, 4).
            ways: How far each may move in a frame [px]. Shape (M,).
            places: Where the markers are expected, if those that touch are to be told apart by it [px]. Shape (M, 2).
        """
        spots = self._finder.find(image, np.where(self.plain[:, None], boxes, 0), MOST_STREAK * ways)
        if places is None or np.isfinite(places[:, 0]).sum() < 2:
            return spots
        _, apart = self._finder.apart(image, np.where(self.plain[:, None], places, np.nan))
        away = np.linalg.norm(spots.centers[:, None] - apart.centers, axis=2)
        return spots.of((away > np.sqrt(apart.areas / np.pi)).all(axis=1)).and_(apart)

    def find_picture(self, image: Image, marker: int, place: Array, reach: float) -> tuple[Array, float, bool]:
        """Where it looks most like a marker near a place (2,) [px], how much it does, and whether only there."""
        found = self._patches.find(image, marker, place, reach) if inside(place, image) else []
        if not found:
            return place, 0.0, False
        best = max(found, key=lambda peak: peak.score)
        return np.array([best.x, best.y]), best.score, len(found) == 1

    def grow(self, factors: Array) -> None:
        """Takes in by how much the markers have grown. Shape (M,)."""
        self._areas = self._areas * factors**2
        self._patches.grow(factors)
        self._moments = self._moments * (factors**2)[:, None]
        self._resize()

    def grow_together(self, markers: NDArray[np.int64]) -> None:
        """Has some markers (K,) grown since the first frame by as much as most of them have."""
        shares = self._areas / self._first
        factors = np.ones(len(shares))
        factors[markers] = np.sqrt(np.median(shares[markers]) / shares[markers])
        self.grow(factors)

    def pick_again(self, image: Image, marker: int, place: Array) -> Array | None:
        """The center (2,) of the spot of about a marker's size at a place (2,), whatever its color is now.

        The marker has the spot's look from then on. None if there is no such spot.
        """
        radius = self.radii[marker : marker + 1]
        finder = SpotFinder(image, place[None], radius)
        own = _own(finder, image, place[None], radius, ROOMS[0])
        share = own.areas[0] / self._areas[marker]
        same = are_whole(share) and not contradict(own.centers[0], place, radius[0])
        if own.solidity[0] < LEAST_SOLIDITY or not same:
            return None
        ours = self._finder
        if not self.plain[marker]:
            self.plain[marker], ours.kinds[marker] = True, ours.kinds.max() + 1
        ours.coverage.take(marker, finder.coverage)
        self._areas[marker] *= 1 + RATE * (share - 1)
        self._moments[marker] += RATE * (own.moments[0] - self._moments[marker])
        return own.centers[0]

    def likeness(self, spots: Spots, last: Array, steps: Array) -> Array:
        """How much each spot looks like each marker, from 0 to 1, and -1 where it is of another kind.

        Args:
            spots: Spots of a picture.
            last: Where each marker was last [px]. Shape (M, 2).
            steps: How far it moved then in a frame [px]. Shape (M,).

        Returns:
            Likeness. Shape (M, P).
        """
        if not len(spots):
            return np.empty((len(self._areas), 0))
        sizes = np.abs(np.log2(np.maximum(spots.areas / self._areas[:, None], 1e-3)))
        moved = np.linalg.norm(spots.centers - last[:, None], axis=2)
        explained = MOST_STREAK * np.maximum(moved, steps[:, None]) + self.radii[:, None]
        excess = streak_lengths(spots.moments - self._moments[:, None]) - explained
        looks = np.clip(1.5 - sizes, 0.0, 1.0) * np.minimum(spots.fills, 1.0)
        looks *= np.exp(-np.maximum(excess, 0.0) / self.radii[:, None])
        narrow = np.maximum(_across(spots.moments) / _across(self._moments)[:, None], 1e-3)
        looks *= np.clip(1.5 + np.log2(np.minimum(narrow, 1.0)), 0.0, 1.0)  # motion doesn't make it narrower
        return np.where(spots.kinds == self._finder.kinds[:, None], looks, -1.0)

    def share(self, spots: Spots, markers: NDArray[np.int64], chosen: NDArray[np.int64]) -> Array:
        """Areas of the markers' spots as shares of what is usual for each. Shape (K,)."""
        return spots.areas[chosen] / self._areas[markers]

    def spread(self, spots: Spots, markers: NDArray[np.int64], chosen: NDArray[np.int64]) -> Array:
        """By how much the markers' second moments exceed their own at rest [px²]. Shape (K, 3)."""
        return spots.moments[chosen] - self._moments[markers]

    def learn_picture(self, image: Image, marker: int, place: Array) -> None:
        """Takes in the picture of a marker that looks different now, at its place (2,)."""
        self._patches.renew(image, marker, place, float(self.radii[marker]))

    def learn(
        self, image: Image, spots: Spots, markers: NDArray[np.int64], chosen: NDArray[np.int64], blur: Array
    ) -> None:
        """Takes in how markers look that were seen without a doubt.

        Args:
            image: RGB. Shape (H, W, 3).
            spots: Spots of the picture.
            markers: Indices of the markers. Shape (K,).
            chosen: Index of each one's spot. Shape (K,).
            blur: How far each moved during the exposure [px]. Shape (K, 2).
        """
        positions, ways = np.full_like(self.points, np.nan), np.zeros_like(self.points)
        positions[markers], ways[markers] = spots.centers[chosen], blur
        change = RATE * (spots.areas[chosen] / self._areas[markers] - 1)
        self._areas[markers] *= 1 + change
        self._moments[markers] *= 1 + change[:, None]
        self._resize()
        self._finder.learn(image, positions, ways)
        for marker, spot in zip(markers.tolist(), chosen.tolist(), strict=True):
            if np.hypot(*ways[marker]) < SHARP * self.radii[marker]:
                self._moments[marker] += RATE * (spots.moments[spot] - self._moments[marker])
                self._patches.learn(image, marker, spots.centers[spot])


def squares(places: Array, reaches: Array | float) -> NDArray[np.int64]:
    """Squares around places: left, top, right, bottom [px]. Shape (N, 4)."""
    reach = np.broadcast_to(np.asarray(reaches), len(places))[:, None]
    return np.concatenate([np.floor(places - reach), np.ceil(places + reach) + 1], axis=1).astype(np.int64)


def _across(moments: Array) -> Array:
    """The smaller principal variances. Shapes (N, 3), (N,)."""
    xx, xy, yy = moments.T
    return np.maximum((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy), 0.05)


@dataclass(frozen=True)
class _Own:
    """The spots at the markers' points.

    Attributes:
        centers: Centers [px]. Shape (M, 2).
        areas: Areas [px²]. Shape (M,).
        moments: Second central moments [px²]. Shape (M, 3).
        solidity: 1 for an ellipse that is covered evenly, less for anything else, 0 for none. Shape (M,).
    """

    centers: Array
    areas: Array
    moments: Array
    solidity: Array

    @staticmethod
    def none(points: Array) -> _Own:
        return _Own(points.copy(), np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros(len(points)))

    def where(self, other: Mask, others: _Own) -> _Own:
        """These, and the others for some markers."""
        pairs = ((vars(self)[name], vars(others)[name]) for name in vars(self))
        return _Own(*(np.where(other if a.ndim == 1 else other[:, None], b, a) for a, b in pairs))


def _contradicted(own: _Own, measured: list[_Own]) -> Mask:
    """Which spots lie elsewhere than by another way of measuring them: their border isn't clear. Shape (M,)."""
    out = np.zeros(len(own.areas), dtype=bool)
    for other in measured:
        radii = np.sqrt(np.minimum(own.areas, other.areas) / np.pi)
        out |= (other.solidity > 0) & contradict(own.centers, other.centers, radii)
    return out


def _own(finder: SpotFinder, image: Image, points: Array, radii: Array, room: float, settled: bool = True) -> _Own:
    """The spots at the points, as far as they lie within some radii of them."""
    spots = finder.find(image, squares(points, room * radii + 1.0))
    if not len(spots):
        return _Own.none(points)
    away = np.linalg.norm(points[:, None] - spots.centers, axis=2)
    away[finder.kinds[:, None] != spots.kinds] = np.inf
    own = away.argmin(axis=1)
    area, moments = spots.areas[own], spots.moments[own]
    xx, xy, yy = moments.T
    half, mean = np.hypot((xx - yy) / 2, xy), (xx + yy) / 2
    share = area / (np.pi * radii**2)
    good = finder.coverage.clear & (away.min(axis=1) < CLICK_SHARE * radii + 1.0)
    if settled:
        good &= share < MOST_UNEQUAL**2
    good &= mean + half < LONGEST**2 * _across(moments)
    good &= np.bincount(own[good], minlength=len(spots))[own] <= 1
    spread = 4 * np.pi * (np.sqrt(np.maximum(mean**2 - half**2, 0)) - EXACT[0] ** 2) / area
    solidity = 1 / np.maximum(spread, 1.0)
    # a ring, or a disc with a hub: round about the point
    ring = (away.min(axis=1) < RING_SHARE * radii + 1.0) & (half < RING_SHARE * mean) & (solidity > EVEN)
    return _Own(spots.centers[own], area, moments, np.where(good, np.where(ring, 1.0, solidity), 0.0))


def _touching(finder: SpotFinder, image: Image, points: Array) -> tuple[Mask, _Own]:
    """Which markers touch others (M,), and what is theirs of the common spot."""
    of, spots = finder.apart(image, points)
    beside = np.linalg.norm(spots.centers - points[of], axis=1)
    good = finder.coverage.clear[of] & (beside < CLICK_SHARE * finder.radii[of] + 1.0)
    of, spots = of[good], spots.of(good)
    theirs = _Own.none(points)
    theirs.centers[of], theirs.areas[of], theirs.moments[of] = spots.centers, spots.areas, spots.moments
    theirs.solidity[of] = 1.0
    return theirs.solidity > 0, theirs


def _contrasts(image: Image, points: Array, radii: Array, plain: Mask) -> Array:
    """How the levels inside of plain markers differ from those around; of others all of the light. Shape (M, 3)."""
    out = np.full((len(points), 3), 85.0)
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]] if plain.any() else (np.zeros(0), np.zeros(0))
    for m in np.flatnonzero(plain):
        left, top, right, bottom = squares(points[m : m + 1], 2 * radii[m])[0].clip(0)
        part = np.s_[top:bottom, left:right]
        away = np.hypot(columns[part] - points[m, 0], rows[part] - points[m, 1]) / radii[m]
        window = image[part].astype(float)
        if (away > 1.2).any() and (away < 0.8).any():
            out[m] = np.median(window[away < 0.8], axis=0) - np.median(window[away > 1.2], axis=0)
    return out


def _check_the_rest(image: Image, points: Array, radii: Array, odd: Mask) -> None:
    """Markers that no spot was found for may be tags, or known by their pictures; or the points lie beside them."""
    tags = dictionary_at(image, points[odd])
    if tags is not None:
        raise TrackingError(
            f"{odd.sum()} of {len(points)} points lie on tags of {tags}; read them with: --tracker aruco --tags {tags}"
        )
    if odd.sum() <= len(points) // 3:
        return
    blobs = find_blobs(image)
    listed = ", ".join(f"({x:.0f}, {y:.0f})" for x, y in points[odd][:3])
    start = f"no marker stands out at {odd.sum()} of {len(points)} points, such as {listed}"
    advice = "pick the points on the markers' centers in the first frame (`swim2real pick`)"
    if len(blobs):
        away = np.linalg.norm(points[odd][:, None] - blobs.points, axis=2)
        nearest = away.argmin(axis=1)
        near = away.min(axis=1)
        part = near + blobs.radii[nearest] < radii[odd]  # a glint on the marker
        beside = ~part & (near > CLICK_SHARE * blobs.radii[nearest]) & (near < BESIDE * blobs.radii[nearest] + 3)
        if beside.sum() > len(beside) // 2:
            first = int(beside.argmax())
            (x, y), far, blob = points[odd][first], near[first], nearest[first]
            raise TrackingError(
                f"{start}; the nearest round spot to ({x:.0f}, {y:.0f}) has a radius of {blobs.radii[blob]:.0f} px and "
                f"is {far:.0f} px away, at ({blobs.points[blob, 0]:.0f}, {blobs.points[blob, 1]:.0f}); {advice}"
            )
    flat = [_detail(image, point) < LEAST_DETAIL for point in points[odd]]
    if sum(flat) > len(flat) // 3:
        raise TrackingError(f"{start}: the picture is even there; {advice}")


def _detail(image: Image, point: Array) -> float:
    left, top, right, bottom = squares(point[None], DETAIL)[0].clip(0)
    return float(image[top:bottom, left:right].astype(float).mean(axis=2).std())
