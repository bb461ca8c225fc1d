"""Tracks the markers of a robot whose trials are recordings: bodies of several by their shape, single ones by flow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swim2real.tracking.bodies import BodyTracker
from swim2real.tracking.free import APART, DOUBT, FreeTracker
from swim2real.tracking.tracker import REASONS, Array, Image


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
        alone = np.bincount(numbers - numbers.min())[numbers - numbers.min()] == 1
        parts = (BodyTracker(numbers[~alone].tolist(), fixed), ~alone), (FreeTracker(), alone)
        self._parts = [(tracker, np.flatnonzero(of)) for tracker, of in parts if of.any()]
        self._count = len(numbers)

    @property
    def reasons(self) -> dict[str, Array]:
        out = {reason: np.zeros(self._count) for reason in REASONS}
        for tracker, of in self._parts:
            for reason, frames in tracker.reasons.items():
                out[reason][of] = frames
        return out

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie on their bodies."""
        return self._joined([tracker.start(image, points[of], time) for tracker, of in self._parts])

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        return self._joined([tracker.follow(image, time) for tracker, _ in self._parts])

    def _joined(self, parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Positions and confidence of all; a single marker at the place of a body's is doubtful."""
        positions, confidence = np.full((self._count, 2), np.nan), np.zeros(self._count)
        for (_, of), (places, sure) in zip(self._parts, parts, strict=True):
            positions[of], confidence[of] = places, sure
        if len(parts) == 2:
            (bodies, tracked), (free, alone) = self._parts
            near = (
                np.linalg.norm(positions[alone, None] - positions[tracked], axis=2)
                < APART * free.radii[:, None] + APART * bodies.radii
            )
            doubled = alone[(near & (confidence[tracked] > DOUBT)).any(axis=1)]
            confidence[doubled] = np.minimum(confidence[doubled], DOUBT)
        return positions, confidence
