"""Tracks markers on rigid bodies: pendulums, arms, plates, rows of equal dots.

In each frame: predict how each body moves, find spots of marker color around it (`spots`), label the markers of all
bodies together (`rigid`), and doubt a body whose labels could as well be others. A body that is lost is searched for
farther away in each frame. One that was doubted is doubted until its labels are certain from where it may have gone
since.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from swim2real.errors import TrackingError
from swim2real.tracking.appearance import Appearance
from swim2real.tracking.rigid import Expected, Labeling, label, pairs_of, rigid_fit
from swim2real.tracking.spots import SpotFinder, Spots
from swim2real.tracking.tracker import Array, Image

LEAD = 4.0  # by which labels must be better than any others to be sure: two fifths of a missing marker
DOUBT = 0.45  # confidence of a marker that may be another one: `quality` counts it as lost
WHOLE = (0.72, 1.4)  # area of a spot, as a share of a marker's, that is neither partly hidden nor more than one
FEW = 0.4  # of the markers of a body that was lost, with fewer of which it isn't found again
STIFF = 0.1  # rad by which a body may turn in a frame without notice
FAR = 4.0  # times how far a body may easily be from where it is expected: a push, or a mistake
FORGET = 0.7  # of a surprise, in each frame
FAINT = 4.0  # radii of a streak, of which the ends are too faint to be seen
AGAIN_FRAMES = 3  # that a body must be followed for after it was lost
ADAPT_TIME, ADAPT_WAY = 1.0, 200.0  # s and px over which a body's shape in the picture changes: perspective, lens
SHAPE_SHARE = 0.1  # of a length by which it may differ from the first frame's
_BEND = 0.9  # of the last change of velocity that is expected again
_FADE = 0.5  # of the velocity that is left in each frame in which a body isn't seen


class _Body:
    """The markers of one rigid body.

    Attributes:
        markers: Their indices. Shape (M,).
        fixed: Whether the body can't move.
        shape: Their places on the body, in the picture [px]. Shape (M, 2).
        doubt: How far from the chosen labels others may lie that weren't refuted; 0 where these are certain [px].
    """

    def __init__(self, markers: NDArray[np.int64], fixed: bool, places: Array, time: float) -> None:
        self.markers, self.fixed = markers, fixed
        self.shape, self._first_shape = places.copy(), places.copy()
        self.pairs = pairs_of(places)
        self.doubt = 0.0
        self.swing = 0.0  # how far it may have turned while nobody knows how [rad]
        self.unseen = 0  # frames since it was seen last
        self.followed = AGAIN_FRAMES  # frames since it was found
        self.surprise = 0.0  # how far it was from where it was expected, lately [px]
        self.history: list[tuple[float, Array]] = [(time, places)]

    @property
    def step(self) -> float:
        """How far it moved between the last two frames in which it was seen [px/frame]."""
        if len(self.history) < 2:
            return 0.0
        return _distance(self.history[-1][1], self.history[-2][1])

    @property
    def bend(self) -> float:
        """How much that step differs from the one before [px/frame]."""
        if len(self.history) < 3:
            return self.step
        (_, first), (_, second), (_, third) = self.history
        return _distance(third - second, second - first)

    @property
    def turn(self) -> float:
        """Angle by which it turned between the last two frames in which it was seen [rad]."""
        if len(self.history) < 2:
            return 0.0
        ends = self.pairs[:1, 1], self.pairs[:1, 0]
        ways = [places[ends[0]] - places[ends[1]] for _, places in self.history[-2:]]
        return abs(
            float(np.angle(np.exp(1j * np.diff([np.arctan2(way[:, 1], way[:, 0]) for way in ways], axis=0)).sum()))
        )

    def predicted(self, time: float) -> Array:
        """Where its markers should be [px]. Shape (M, 2)."""
        when, last = self.history[-1]
        if self.fixed or len(self.history) < 2:
            return last
        before, earlier = self.history[-2]
        span = (time - when) / (when - before)
        step = last - earlier
        if self.unseen:  # it slows down, as far as anybody knows
            frames = self.unseen + 1
            return rigid_fit(self.shape, last + step * span / frames * (1 - _FADE**frames) / (1 - _FADE))
        places = last + step * span
        if len(self.history) > 2:
            oldest, first = self.history[-3]
            change = step - (earlier - first) * ((when - before) / (before - oldest))
            places = places + _BEND * change * span * (span + 1) / 2
        return rigid_fit(self.shape, places)

    def spread(self, radius: float) -> float:
        """How far it may easily be from where it is expected, if its last labels are right [px]."""
        still = 1.0 + 0.25 * radius
        return still if self.fixed else still + 0.25 * self.bend + 1.2 * self.surprise

    def follow(self, places: Array, time: float) -> None:
        """Takes in where its markers are seen, NaN where they aren't [px]. Shape (M, 2)."""
        self.unseen = 0
        self.followed += 1
        if not self.fixed:
            expected = self.predicted(time)
            moved = rigid_fit(expected, places)  # one marker alone doesn't tell how it is turned
            self.surprise = max(FORGET * self.surprise, _distance(moved, expected))
            self.history = [*self.history, (time, rigid_fit(self.shape, moved))][-3:]

    def begin(self, places: Array, time: float) -> None:
        """Takes in that it is somewhere else than expected."""
        self.unseen = self.followed = 0
        self.surprise = 0.0
        self.history = [(time, rigid_fit(self.shape, rigid_fit(self.history[-1][1], places)))]

    def lose(self, way: float) -> None:
        """Takes in that it isn't seen, while it may go some way [px]."""
        self.unseen += 1
        self.followed = 0
        if not self.fixed:
            self.doubt += way
            self.swing += STIFF + self.turn

    def adapt(self, places: Array, rate: float) -> None:
        """Lets the shape follow what is seen, as far as perspective may change it. Shape (M, 2)."""
        known = np.isfinite(places[:, 0])
        if known.sum() < 3:
            return
        back = rigid_fit(places[known], self.shape[known])
        shape = self.shape.copy()
        shape[known] += rate * (back - shape[known])
        extent = np.linalg.norm(self._first_shape - self._first_shape.mean(axis=0), axis=1, keepdims=True)
        limit = SHAPE_SHARE * extent + 0.5
        change = shape - self._first_shape
        self.shape = self._first_shape + change * np.minimum(1.0, limit / np.maximum(np.abs(change), 1e-9))


class BodyTracker:
    """Follows markers on rigid bodies. See `tracker.Tracker`."""

    def __init__(self, bodies: Sequence[int], fixed: int | None = None) -> None:
        """Takes what the robot file knows.

        Args:
            bodies: Number of the rigid body that carries each marker. Shape (M,).
            fixed: The body that can't move, if any marker is on one.
        """
        self._numbers = np.asarray(bodies)
        self._fixed = fixed

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie on their bodies."""
        height, width = image.shape[:2]
        if not ((points >= 0) & (points <= [width - 1, height - 1])).all():
            raise TrackingError(f"{len(points)} points must be finite and lie in the frame of {width} x {height} px")
        look = Appearance(image, points)
        self._radius = look.radius
        self._finder = SpotFinder(image, look.points, look.radius)
        spots = self._finder.find(image, _boxes(look.points, 2 * self._radius))
        away = np.linalg.norm(look.points[:, None] - spots.centers[None], axis=2)
        near = away.argmin(axis=1) if len(spots) else np.zeros(len(points), dtype=np.int64)
        seen = away.min(axis=1, initial=np.inf) < 0.7 * self._radius
        seen &= np.array([np.count_nonzero(near == spot) == 1 for spot in near])
        if not seen.any():
            listed = ", ".join(f"({x:.0f}, {y:.0f})" for x, y in points[:3])
            raise TrackingError(
                f"no spot as large as a marker stands out at the points in the first frame, such as {listed}; pick the "
                f"points on the markers' centers (`swim2real pick`)"
            )
        positions = look.points.copy()
        positions[seen] = spots.centers[near[seen]]
        self._area = float(np.median(spots.areas[near[seen]]))
        self._bodies = [
            _Body(
                np.flatnonzero(self._numbers == number), number == self._fixed, positions[self._numbers == number], time
            )
            for number in dict.fromkeys(self._numbers.tolist())
        ]
        self._time = time
        self._fastest = 0.0
        confidence = np.where(seen, self._confidence(spots, near, np.zeros(len(points))), 0.0)
        return np.where(confidence[:, None] > 0, positions, np.nan), confidence

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        if time <= self._time:
            raise TrackingError(f"frame time {time:.4f} s isn't after the last one; call start() first, then in order")
        predicted = [body.predicted(time) for body in self._bodies]
        pushed = [False] * len(predicted)
        spots, labeling, reaches = self._labeled(image, predicted, pushed)
        size = np.array(image.shape[1::-1]) - 1
        missing = [
            bool(np.count_nonzero(labels >= 0) < _inside(places, size))
            for labels, places in zip(labeling.spots, predicted, strict=True)
        ]
        if any(missing):
            spots, labeling, reaches = self._labeled(image, predicted, missing)
        positions, streaks, confidence = self._taken(spots, labeling, reaches, time)
        self._adapt(image, positions, streaks, confidence, time)
        self._time = time
        return positions, confidence

    def _labeled(self, image: Image, predicted: list[Array], pushed: list[bool]) -> tuple[Spots, Labeling, list[float]]:
        """Labels of the bodies, of which some may have been pushed farther than they are usually looked for."""
        expected: list[Expected] = []
        boxes = np.empty((len(self._numbers), 4), dtype=np.int64)
        for body, places, far in zip(self._bodies, predicted, pushed, strict=True):
            usual, reach = body.spread(self._radius), 3 * self._radius + 4
            spread = max(usual, body.doubt)
            near = reach if body.fixed else max(3 * spread, reach)
            reach = near if body.fixed or not far else max(near, 18 * self._radius)
            tolerance = min(0.3 * self._radius + 1.0 + 0.08 * body.step, self._radius)
            lost = not body.fixed and body.doubt > 0
            swing = STIFF + 0.5 * body.turn + body.swing
            expected.append(Expected(places, body.pairs, spread, usual, swing, near, reach, tolerance, lost))
            boxes[body.markers] = _boxes(places, reach)
        spots = self._finder.find(image, boxes)
        sizes = np.abs(np.log2(np.maximum(spots.areas / self._area, 1e-3)))
        looks = np.clip(1.5 - sizes, 0.0, 1.0) * np.minimum(spots.fills, 1.0)
        height, width = image.shape[:2]
        return spots, label(expected, spots.centers, looks, (width, height)), [body.reach for body in expected]

    def _taken(self, spots: Spots, labeling: Labeling, reaches: list[float], time: float) -> tuple[Array, Array, Array]:
        """Positions, streaks and confidence; each body takes in how it moved and how certain that is."""
        count = len(self._numbers)
        positions, confidence, off = np.full((count, 2), np.nan), np.zeros(count), np.zeros(count)
        chosen = np.full(count, -1)
        for body, labels, lead, reach in zip(self._bodies, labeling.spots, labeling.leads, reaches, strict=True):
            seen = labels >= 0
            places = np.full((len(labels), 2), np.nan)
            places[seen] = spots.centers[labels[seen]]
            last, frames, expected = body.history[-1][1], body.unseen + 1, body.predicted(time)
            away = _distance(rigid_fit(expected, places), expected) if seen.any() else 0.0
            far = not body.fixed and away > FAR * body.spread(self._radius)
            few = body.doubt > 0 and seen.sum() < min(len(seen), max(2, FEW * len(seen)))
            if not seen.any() or few or (far and lead < LEAD):
                body.lose(max(1.5 * self._fastest, 2 * self._radius))
                continue
            if far:
                body.begin(places, time)
            else:
                body.follow(places, time)
            chosen[body.markers], positions[body.markers] = labels, places
            off[body.markers[seen]] = np.linalg.norm(rigid_fit(body.shape, places) - places, axis=1)[seen]
            blur = float(np.median(np.linalg.norm(spots.streaks[labels[seen]], axis=1)))
            moved = away if far else body.step
            if lead < LEAD or blur > 1.5 * moved + 0.7 * self._radius:  # it moved farther than these labels say
                body.doubt = body.doubt or 0.5 * reach
            elif body.followed >= AGAIN_FRAMES:
                body.doubt = body.swing = 0.0
            if body.doubt == 0.0 and not body.fixed:
                self._fastest = max(self._fastest, _distance(body.history[-1][1], last) / frames)
        sure = np.repeat(False, count)
        for body in self._bodies:
            sure[body.markers] = body.doubt == 0.0
        seen = chosen >= 0
        confidence[seen] = self._confidence(spots, chosen[seen], off[seen])
        streaks = np.zeros((count, 2))
        streaks[seen] = spots.streaks[chosen[seen]]
        sure &= ~self._cut(np.linalg.norm(streaks, axis=1), seen)
        return positions, streaks, np.where(sure, confidence, np.minimum(confidence, DOUBT))

    def _cut(self, streaks: Array, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Markers with a streak that is too long or too short for how far they moved, off its middle. Shape (M,)."""
        steps = np.zeros(len(seen))
        for body in self._bodies:
            if len(body.history) > 1:
                steps[body.markers] = np.linalg.norm(body.history[-1][1] - body.history[-2][1], axis=1)
        fast = seen & (steps > self._radius)
        if fast.sum() < 3:
            return np.zeros(len(seen), dtype=bool)
        shutter = np.median(streaks[fast] / steps[fast])
        return fast & (np.abs(streaks - shutter * steps) > max(6.0, 0.6 * self._radius))

    def _confidence(self, spots: Spots, chosen: NDArray[np.int64], off: Array) -> Array:
        """How much spots look like a marker at its place, from 0 to 1. Shape (K,)."""
        area, fill = spots.areas[chosen] / self._area, np.minimum(spots.fills[chosen], 1.0)
        confidence = (0.5 + 0.5 * fill) * (1 - 0.3 * np.minimum(off / (0.3 * self._radius + 1.0), 1.0) ** 2)
        streak = np.linalg.norm(spots.streaks[chosen], axis=1)
        sure = (area > WHOLE[0]) & (area < WHOLE[1]) & (off < 0.3 * self._radius + 1.0)
        return np.where(sure & (streak < FAINT * self._radius), confidence, np.minimum(confidence, DOUBT))

    def _adapt(self, image: Image, positions: Array, streaks: Array, confidence: Array, time: float) -> None:
        sure = np.where((confidence > DOUBT)[:, None], positions, np.nan)
        for body in self._bodies:
            if body.doubt == 0.0 and not body.fixed:
                body.adapt(sure[body.markers], min(1.0, (time - self._time) / ADAPT_TIME + body.step / ADAPT_WAY))
        self._finder.learn(image, sure, streaks)


@njit(cache=True, nogil=True)
def _distance(here: Array, there: Array) -> float:
    """Root mean square distance of markers [px]."""
    return float(np.sqrt(((here - there) ** 2).sum() / len(here)))


def _inside(places: Array, size: Array) -> int:
    return int(((places >= 0) & (places <= size)).all(axis=1).sum())


def _boxes(places: Array, reach: float) -> NDArray[np.int64]:
    """Squares around places: left, top, right, bottom. Shape (N, 4)."""
    return np.concatenate([np.floor(places - reach), np.ceil(places + reach) + 1], axis=1).astype(np.int64)
