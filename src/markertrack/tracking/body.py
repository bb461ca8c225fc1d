"""How one body moves in the picture: where its markers should be, how far off they may be, and what its shape is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.rigid import distance, pairs_of, rigid_fit, turn
from markertrack.tracking.tracker import AGAIN, Array

STIFF = 0.1  # rad by which a body may turn in a frame without notice
FORGET = 0.7  # of a surprise, and of the velocity of a body that isn't seen, that is left in each frame
_BEND = 0.9  # of the last change of velocity that is expected again


class Body:
    """The markers of one rigid body.

    Attributes:
        markers: Their indices. Shape (M,).
        fixed: Whether the body can't move, but for the camera that films it.
        shape: Their places on the body, in the picture [px]. Shape (M, 2).
        doubt: How far from the chosen labels others may lie that weren't refuted; 0 where these are certain [px].
    """

    def __init__(self, markers: NDArray[np.int64], fixed: bool, places: Array, time: float) -> None:
        self.markers, self.fixed = markers, fixed
        self.shape = places.copy()
        self.pairs = pairs_of(places)
        self.doubt = 0.0
        self.swing = 0.0  # how far it may be turned against them [rad]
        self.held: Array | None = None  # where it was from where doubt counts; None: by the newest labels [px]
        self.unseen = 0  # frames since it was seen last
        self.followed = AGAIN  # frames, one after the other, in which nothing else was as likely
        self.surprise = 0.0  # how far it was from where it was expected, lately [px]
        self.history: list[tuple[float, Array]] = [(time, places)]

    @property
    def step(self) -> float:
        """How far it moved between the last two frames in which it was seen [px/frame]."""
        if len(self.history) < 2:
            return 0.0
        return distance(self.history[-1][1], self.history[-2][1])

    @property
    def bend(self) -> float:
        """How much that step differs from the one before [px/frame]."""
        if len(self.history) < 3:
            return self.step
        (_, first), (_, second), (_, third) = self.history
        return distance(third - second, second - first)

    @property
    def turn(self) -> float:
        """Angle by which it turned between the last two frames in which it was seen [rad]."""
        return turn(self.history[-2][1], self.history[-1][1]) if len(self.history) > 1 else 0.0

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
            return rigid_fit(self.shape, last + step * span / frames * (1 - FORGET**frames) / (1 - FORGET))
        places = last + step * span
        if len(self.history) > 2:
            oldest, first = self.history[-3]
            change = step - (earlier - first) * ((when - before) / (before - oldest))
            if (change**2).sum() < ((2 * step) ** 2).sum():  # who more than turns back was pushed, or seen wrong
                places = places + _BEND * change * span * (span + 1) / 2
        return rigid_fit(self.shape, places)

    def turn_back(self) -> None:
        """Takes in that time runs backward from here on: it comes from where it would have gone."""
        if len(self.history) > 1 and not self.unseen:
            (before, _), (now, places) = self.history[-2:]
            self.history = [(before, self.predicted(2 * now - before)), (now, places)]

    def spread(self, radius: float) -> float:
        """How far it may easily be from where it is expected, if its last labels are right [px]."""
        still = 1.0 + 0.25 * radius
        return still if self.fixed else still + 0.25 * self.bend + 1.2 * self.surprise

    def follow(self, places: Array, time: float) -> None:
        """Takes in where its markers are seen, NaN where they aren't [px]. Shape (M, 2)."""
        self.unseen = 0
        if self.fixed:  # it moves with the camera
            self.history = [(time, rigid_fit(self.history[-1][1], places))]
            return
        expected = self.predicted(time)
        moved = rigid_fit(expected, places)  # one marker alone doesn't tell how it is turned
        new = distance(moved, expected) if self.doubt == 0.0 else 0.0  # what may be another one's tells nothing
        self.surprise = max(FORGET * self.surprise, new)
        self.history = [*self.history, (time, rigid_fit(self.shape, moved))][-3:]

    def begin(self, places: Array, time: float, surprise: float) -> None:
        """Takes in that it is somewhere else than expected, and how far it may be from there in the next frame."""
        self.unseen = self.followed = 0
        self.surprise = surprise
        self.history = [(time, rigid_fit(self.shape, rigid_fit(self.history[-1][1], places)))]

    def carry(self, places: Array, time: float, radius: float) -> None:
        """Takes in where others know that it is, NaN where they don't [px]. Shape (M, 2)."""
        before = [one for one in self.history if one[0] != time]
        last = (before or self.history)[-1][1]
        self.history = [*before, (time, rigid_fit(self.shape, rigid_fit(last, places)))][-3:]
        self.unseen, self.surprise = 0, 0.0
        self.hold(self.spread(radius), 0.0)

    def lose(self, way: float) -> None:
        """Takes in that it isn't seen, while it may go some way [px]."""
        self.unseen += 1
        self.followed = 0
        self.surprise *= FORGET
        if not self.fixed:
            self.hold(self.doubt + way, self.swing + STIFF + self.turn, self.history[-1][1])

    def hold(self, doubt: float, swing: float, before: Array | None = None) -> None:
        """Takes in how far others may lie that weren't refuted, from its newest labels or from where it was before.

        Args:
            doubt: How far [px].
            swing: How far they may be turned [rad].
            before: Where its markers were, if the newest labels tell less than that. Shape (M, 2).
        """
        self.doubt, self.swing = doubt, swing
        self.held = before if before is None or self.held is None else self.held

    def adapt(self, places: Array, rate: float, firm: float) -> None:
        """Lets the shape follow what is seen: all of it as it tilts, and each marker slowly, or at once if it is soft.

        Args:
            places: Where its markers are seen without a doubt, NaN where they aren't [px]. Shape (M, 2).
            rate: Share of a change that is taken in.
            firm: By how much half of the markers may be beside their places on a body that is rigid [px].
        """
        known = np.isfinite(places[:, 0])
        if known.sum() < 3:
            return
        back = np.full_like(self.shape, np.nan)
        back[known] = rigid_fit(places[known], self.shape[known])
        self.shape = affine_fit(self.shape, back, (firm / STIFF) ** 2)
        beside = (back - self.shape)[known]
        rate = max(rate, min(float(np.median(np.linalg.norm(beside, axis=1))) / firm, 1.0))
        self.shape[known] += rate * beside


def affine_fit(shape: Array, places: Array, ridge: float) -> Array:
    """The shape where an affine map, as a plane that tilts makes it, comes closest to places: see `rigid_fit`.

    The ridge [px²] holds its distances.
    """
    known = np.isfinite(places[:, 0])
    middle = shape[known].mean(axis=0)
    arms, ways = shape[known] - middle, (places - shape)[known]
    strain = np.linalg.solve(arms.T @ arms + (ridge + 1e-9) * np.eye(2), arms.T @ ways)
    return shape + ways.mean(axis=0) + (shape - middle) @ strain
