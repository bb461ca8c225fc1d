"""Tracks the markers of a robot whose trials are recordings: bodies of several by their shape, single ones by flow.

A marker that its body can't place is followed by flow from where it was. A body that turns out not to keep its shape is
left to flow from then on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.bodies import BodyTracker
from markertrack.tracking.free import CERTAIN, RATIO, FreeTracker
from markertrack.tracking.looks import NEARBY, Looks
from markertrack.tracking.tracker import DOUBT, REASONS, Array, Image, Mask, contradict

FOUND = 0.7  # of the markers of a soft body, up to which it is left
STREAK = 2.0  # radii that a marker moves in a frame, from which on it may be a streak


class MarkerTracker:
    """Follows markers on rigid or soft bodies and such that move by themselves. See `tracker.Tracker`.

    Attributes:
        reasons: In how many frames each marker was lost or doubtful, by the reason. Shapes (M,).
    """

    def __init__(self, bodies: Sequence[int], fixed: int | None = None, chain: bool = False) -> None:
        """Takes what the robot file knows.

        Args:
            bodies: Number of the rigid body that carries each marker. Shape (M,).
            fixed: The body that can't move, if any marker is on one.
            chain: Whether the markers stand in a row along a flexible body, in their order; no two are on a rigid one.
        """
        numbers = np.asarray(bodies)
        alone = np.array([chain or np.count_nonzero(numbers == number) == 1 for number in numbers])
        self._bodies, self._rigid = BodyTracker(numbers[~alone].tolist(), fixed), np.flatnonzero(~alone)
        parts = (self._bodies, self._rigid), (FreeTracker(chained=chain), np.flatnonzero(alone))
        self._parts = [(tracker, of) for tracker, of in parts if len(of)]  # each with the markers that it follows
        self._count = len(numbers)
        self._doubted: dict[int, _Flowed] = {}  # bodies that aren't believed, by their first marker

    @property
    def reasons(self) -> dict[str, Array]:
        out = {reason: np.zeros(self._count) for reason in REASONS}
        for tracker, of in self._parts:
            for reason, frames in tracker.reasons.items():
                out[reason][of] = frames
        return out

    @property
    def radii(self) -> Array:
        """Radius of each marker as it is now [px]. Shape (M,)."""
        out = np.zeros(self._count)
        for tracker, of in self._parts:
            out[of] = tracker.radii
        return out

    def free(self, marker: int) -> tuple[FreeTracker, int] | None:
        """What follows a marker that nothing connects with others, and its number there."""
        for tracker, of in reversed(self._parts):  # those that a soft body was left to come last
            if isinstance(tracker, FreeTracker) and not tracker.chained and marker in of:
                return tracker, of.tolist().index(marker)
        return None

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie on their bodies."""
        positions, confidence = points.copy(), np.ones(self._count)
        for tracker, of in self._parts:
            positions[of], confidence[of] = tracker.start(image, points[of], time)
        self._last = _Frame(image, time, positions, confidence, np.zeros_like(positions))
        return positions, confidence

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        positions, confidence = np.full((self._count, 2), np.nan), np.zeros(self._count)
        for tracker, of in self._parts:
            places, sure = tracker.follow(image, time)
            doubled = self._doubled(places, tracker.radii, positions, np.where(confidence > DOUBT, self.radii, np.nan))
            positions[of], confidence[of] = places, np.where(doubled, np.minimum(sure, DOUBT), sure)
        if len(self._rigid):
            soft = [part for part in self._bodies.soft() if (confidence[self._rigid[part]] > DOUBT).mean() <= FOUND]
            for part in self._bodies.parts():
                self._ask_flow(image, time, part, positions, confidence)
            for part in soft:  # only now, with what flow knows of those that the body lost
                self._leave(image, time, part, positions, confidence)
        both = (confidence > DOUBT) & (self._last.confidence > DOUBT)
        steps = np.where(both[:, None], positions - self._last.positions, self._last.steps)
        self._last = _Frame(image, time, positions.copy(), confidence.copy(), steps)
        return positions, confidence

    def turn(self) -> None:
        """Takes in that the film is played backward from here on."""
        for tracker, _ in self._parts:
            tracker.turn()
        for flowed in self._doubted.values():
            flowed.turn()
        self._last = self._last._replace(steps=-self._last.steps)

    def _ask_flow(
        self, image: Image, time: float, part: NDArray[np.int64], positions: Array, confidence: Array
    ) -> None:
        """Puts in what flow knows of markers of a body that aren't found any longer, until all are."""
        of, key = self._rigid[part], int(part[0])
        believed, known = confidence[of] > DOUBT, self._last.confidence[of] > DOUBT
        if key not in self._doubted:
            if not (known & ~believed).any():
                return
            looks, expected = self._bodies.known(part)
            places = np.where(known[:, None], self._last.positions[of], expected)
            self._doubted[key] = _Flowed(self._last, looks, places, known, self._last.steps[of])
        flowed = self._doubted[key]
        places, sure = flowed.follow(image, time)
        certain = sure > DOUBT
        if believed.any():  # against a body flow is too little
            certain &= (sure >= CERTAIN) | ~contradict(places, self._bodies.laid(part), flowed.radii)
        certain &= np.linalg.norm(places - self._last.positions[of], axis=1) < STREAK * flowed.radii
        doubled = self._doubled(places, flowed.radii, positions, np.where(confidence > DOUBT, self.radii, np.nan))
        both, more = certain & believed, certain & ~believed & ~doubled
        apart = both & (np.linalg.norm(places - positions[of], axis=1) > flowed.radii)
        confidence[of[apart & flowed.followed]] = DOUBT  # flow brought it here, and the body says it is elsewhere
        flowed.aliased |= apart & ~flowed.followed
        flowed.followed = more | apart & flowed.followed
        positions[of[more]], confidence[of[more]] = places[more], sure[more]
        if more.any():
            found = np.where((confidence[of] > DOUBT)[:, None], positions[of], np.nan)
            self._bodies.learn(part, found, more, flowed.looks)
        if more.sum() > 1 and not believed.any():
            self._bodies.carry(part, np.where(more[:, None], places, np.nan), time)
        if believed.all():
            del self._doubted[key]

    @staticmethod
    def _doubled(places: Array, radii: Array, others: Array, known: Array) -> Mask:
        """Which markers are at the place of another one, whose radius is known if its place is. Shapes (K,), (M,)."""
        near = np.linalg.norm(places[:, None] - others, axis=2) < (radii[:, None] + known) / 2
        return near.any(axis=1)

    def _leave(self, image: Image, time: float, part: NDArray[np.int64], positions: Array, confidence: Array) -> None:
        """Leaves a body to flow that doesn't keep its shape, and of which many markers aren't found any longer."""
        of, free = self._rigid[part], FreeTracker()
        certain = confidence[of] > DOUBT
        looks, expected = self._bodies.leave(part)
        free.take_over(image, looks, np.where(certain[:, None], positions[of], expected), certain, time)
        self._parts.append((free, of))


class _Frame(NamedTuple):
    """What is known of a frame.

    Attributes:
        image: RGB. Shape (H, W, 3).
        time: Time stamp [s].
        positions: Of the markers [px]. Shape (M, 2).
        confidence: From 0 to 1. Shape (M,).
        steps: Last known step of each marker [px]. Shape (M, 2).
    """

    image: Image
    time: float
    positions: Array
    confidence: Array
    steps: Array


class _Flowed:
    """The markers of one body, followed by flow from a frame on in which the body was believed.

    Attributes:
        looks: What the markers look like, as it knows.
        aliased: Markers that were where the last step led another one of the body: they may be that one. Shape (M,).
        followed: Markers of which flow was believed in the last frame. Shape (M,).
    """

    def __init__(self, frame: _Frame, looks: Looks, places: Array, known: Mask, steps: Array) -> None:
        self._free, self._expected = FreeTracker(NEARBY), places + steps
        self.looks = looks
        self._free.take_over(frame.image, looks, places, known, frame.time)
        self.aliased = np.zeros(len(places), dtype=bool)
        self.followed = np.zeros(len(places), dtype=bool)

    @property
    def radii(self) -> Array:
        return self._free.radii

    def turn(self) -> None:
        """Takes in that the film is played backward from here on."""
        self._free.turn()
        self._expected = 2 * self._free.places - self._expected

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Places [px], shape (M, 2), and confidence, shape (M,), of the next frame."""
        before = self._free.places
        positions, confidence = self._free.follow(image, time)
        off = np.linalg.norm(self._free.places[:, None] - self._expected, axis=2)
        own = np.diag(off).copy()
        np.fill_diagonal(off, np.inf)
        self.aliased |= own > RATIO * off.min(axis=1)
        self._expected = 2 * self._free.places - before
        return positions, np.where(self.aliased, np.minimum(confidence, DOUBT), confidence)
