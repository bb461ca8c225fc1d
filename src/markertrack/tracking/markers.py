"""Tracks the markers of a robot whose trials are recordings: bodies of several by their shape, single ones by flow.

A body that turns out not to keep its shape is left to flow from then on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markertrack.tracking.bodies import BodyTracker
from markertrack.tracking.free import APART, FreeTracker
from markertrack.tracking.tracker import DOUBT, REASONS, Array, Image, Mask

FOUND = 0.7  # of the markers of a soft body, up to which it is left


class MarkerTracker:
    """Follows markers on rigid or soft bodies and such that move by themselves. See `tracker.Tracker`.

    Attributes:
        reasons: In how many frames each marker was lost or doubtful, by the reason. Shapes (M,).
    """

    def __init__(self, bodies: Sequence[int], fixed: int | None = None) -> None:
        """Takes what the robot file knows.

        Args:
            bodies: Number of the rigid body that carries each marker. Shape (M,).
            fixed: The body that can't move, if any marker is on one.
        """
        numbers = np.asarray(bodies)
        alone = np.array([np.count_nonzero(numbers == number) == 1 for number in numbers])
        self._bodies, self._rigid = BodyTracker(numbers[~alone].tolist(), fixed), np.flatnonzero(~alone)
        parts = (self._bodies, self._rigid), (FreeTracker(), np.flatnonzero(alone))
        self._parts = [(tracker, of) for tracker, of in parts if len(of)]  # each with the markers that it follows
        self._count = len(numbers)

    @property
    def reasons(self) -> dict[str, Array]:
        out = {reason: np.zeros(self._count) for reason in REASONS}
        for tracker, of in self._parts:
            for reason, frames in tracker.reasons.items():
                out[reason][of] = frames  # a body that was left begins anew
        return out

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie on their bodies."""
        positions, confidence = points.copy(), np.ones(self._count)
        for tracker, of in self._parts:
            positions[of], confidence[of] = tracker.start(image, points[of], time)
        return positions, confidence

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        positions, confidence = np.full((self._count, 2), np.nan), np.zeros(self._count)
        radii = np.zeros(self._count)
        for tracker, of in self._parts:
            places, sure = tracker.follow(image, time)
            doubled = self._doubled(places, tracker.radii, positions, np.where(confidence > DOUBT, radii, np.nan))
            positions[of], confidence[of] = places, np.where(doubled, np.minimum(sure, DOUBT), sure)
            radii[of] = tracker.radii
        if len(self._rigid):
            self._leave_soft(image, positions, confidence, time)
        return positions, confidence

    @staticmethod
    def _doubled(places: Array, radii: Array, others: Array, known: Array) -> Mask:
        """Which markers are at the place of another one, whose radius is known if its place is. Shapes (K,), (M,)."""
        near = np.linalg.norm(places[:, None] - others, axis=2) < APART * (radii[:, None] + known)
        return near.any(axis=1)

    def _leave_soft(self, image: Image, positions: Array, confidence: Array, time: float) -> None:
        """Leaves bodies that don't keep their shape to flow, when many of their markers aren't found any longer."""
        for part in self._bodies.soft():
            of, free = self._rigid[part], FreeTracker()
            certain = confidence[of] > DOUBT
            if certain.mean() > FOUND:
                continue
            looks, expected = self._bodies.leave(part)
            free.take_over(image, looks, np.where(certain[:, None], positions[of], expected), certain, time)
            self._parts.append((free, of))
