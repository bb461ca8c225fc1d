"""Decides over a whole film which of a marker's candidates it is in each frame.

A candidate is a place where the marker may be, with a cost: minus the logarithm of how likely what is seen there is, if
it is the marker. Another cost says how likely the step from a candidate of the frame before is. The cheapest path
through all frames is where the marker was (Viterbi); how much more the cheapest path through any *other* place costs is
the margin, and the confidence is a function of it alone. The first candidate of every frame is that the marker isn't
seen. Where one marker is certain to be, no other one is; what is certain by that alone makes nothing else certain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.tracker import Array, Mask

HALF = 1.0  # margin with which the confidence is one half
SURE = 0.9  # confidence with which a marker keeps others from its place
TAKEN = 8.0  # cost of such a place
SAME = 3.0, 0.5  # px, and radii, within which two places are the same one
APART = 0.5  # of the sum of two radii, within which two markers can't both be
ROUNDS = 4  # in which markers keep others from their places


class Frame(NamedTuple):
    """Candidates of M markers in one frame, C each; places that aren't used are infinitely costly.

    Attributes:
        places: Places of the candidates [px]; of the first one, where the marker would be. Shape (M, C, 2).
        costs: Cost of each. Shape (M, C).
        moves: Cost of the step from each of the B candidates of the frame before. Shape (M, B, C).
        steady: Whether that step was foreseen. Shape (M, B, C).
        radii: Radius of each marker [px]. Shape (M,).
    """

    places: Array
    costs: Array
    moves: Array
    steady: Mask
    radii: Array


def decide(frames: Sequence[Frame], margins: Sequence[Array]) -> tuple[Array, Array]:
    """The most likely places over a film.

    Args:
        frames: T frames; of the first one `moves` isn't read.
        margins: Largest margin of each candidate, by what else is known. T x (M, C).

    Returns:
        Positions, NaN where a marker isn't seen [px], shape (T, M, 2), and confidence from 0 to 1, shape (T, M).
    """
    costs = [frame.costs for frame in frames]
    claims: list[Claims] = []
    for _ in range(ROUNDS):
        paths = through([frame.moves for frame in frames], costs)
        claims = [Claims.of(frames[0], paths[0], margins[0])]
        for frame, path, most in zip(frames[1:], paths[1:], margins[1:], strict=True):
            claims.append(claims[-1].next(frame, path, most))
        held = [one.taken(frame) for frame, one in zip(frames, claims, strict=True)]
        after = [frame.costs + kept for frame, kept in zip(frames, held, strict=True)]
        if all(np.array_equal(*pair) for pair in zip(costs, after, strict=True)):
            break
        costs = after
    found = [one.seen(frame) for frame, one in zip(frames, claims, strict=True)]
    return np.array([positions for positions, _ in found]), np.array([confidence for _, confidence in found])


def through(moves: Sequence[Array], costs: Sequence[Array]) -> list[Array]:
    """Costs of the cheapest path through each candidate of each frame, T x (M, C), with moves T x (M, B, C)."""
    paths = [costs[0] - costs[0].min(axis=1, keepdims=True)]
    for move, own in zip(moves[1:], costs[1:], strict=True):
        paths.append(advanced(paths[-1], own, move))
    after = np.zeros_like(costs[-1])
    for t in range(len(costs) - 1, 0, -1):
        paths[t] = paths[t] + after
        after = (moves[t] + (costs[t] + after)[:, None]).min(axis=2)
        after -= after.min(axis=1, keepdims=True)
    paths[0] = paths[0] + after
    return paths


def advanced(before: Array, costs: Array, moves: Array) -> Array:
    """Costs of the cheapest paths to candidates, less the cheapest. Shapes (M, B), (M, C), (M, B, C) to (M, C)."""
    paths = costs + (before[:, :, None] + moves).min(axis=1)
    return paths - paths.min(axis=1, keepdims=True)


class Claims(NamedTuple):
    """Where each marker most likely is in a frame.

    Attributes:
        chosen: Candidate of each; 0 where it isn't seen. Shape (M,).
        positions: Its place [px]. Shape (M, 2).
        confidence: From 0 to 1. Shape (M,).
        ages: Number of frames for which it was followed without a jump. Shape (M,).
    """

    chosen: NDArray[np.int64]
    positions: Array
    confidence: Array
    ages: Array

    @classmethod
    def of(cls, frame: Frame, paths: Array, margins: Array) -> Claims:
        """The cheapest candidates, by costs of paths through each, with margins of at most so much. (M, C) each."""
        every, chosen = np.arange(len(paths)), paths.argmin(axis=1)
        places = frame.places[every, chosen]
        limits = np.maximum(SAME[0], SAME[1] * frame.radii)
        away = np.linalg.norm(frame.places - places[:, None], axis=2) > limits[:, None]
        away[:, 0] = True  # not being seen is another explanation
        margin = np.where(away, paths, np.inf).min(axis=1) - paths[every, chosen]
        margin = np.minimum(margin, margins[every, chosen])
        confidence = np.where(chosen > 0, 1 / (1 + np.exp(HALF - np.minimum(margin, 50.0))), 0.0)
        return cls(chosen, places, confidence, np.zeros(len(paths)))

    def next(self, frame: Frame, paths: Array, margins: Array) -> Claims:
        """The claims in the next frame."""
        found, every = Claims.of(frame, paths, margins), np.arange(len(paths))
        followed = (self.chosen > 0) & (found.chosen > 0) & frame.steady[every, self.chosen, found.chosen]
        return found._replace(ages=np.where(followed, self.ages + 1, 0))

    def seen(self, frame: Frame) -> tuple[Array, Array]:
        """Positions, NaN where a marker isn't seen or another is there, and confidence. Shapes (M, 2), (M,)."""
        lost = (self.chosen == 0) | (near(self.positions, self.positions, frame.radii) & self._older()).any(axis=1)
        return np.where(lost[:, None], np.nan, self.positions), np.where(lost, 0.0, self.confidence)

    def taken(self, frame: Frame) -> Array:
        """Cost of each candidate by others that surely are there, followed for longer than its own marker. (M, C)."""
        there = near(frame.places, self.positions, frame.radii) & (self.confidence > SURE)  # (M, C, M)
        own = near(self.positions, self.positions, frame.radii) & ~self._older()
        out = np.where((there & ~own[:, None]).any(axis=2), TAKEN, 0.0)
        out[:, 0] = 0.0
        return out

    def _older(self) -> Mask:
        """Whether another marker (columns) has been followed for longer than one (rows). Shape (M, M)."""
        every, seen = np.arange(len(self.ages)), self.chosen > 0
        longer = (self.ages > self.ages[:, None]) | ((self.ages == self.ages[:, None]) & (every < every[:, None]))
        return longer & seen & (every != every[:, None])


def near(places: Array, others: Array, radii: Array) -> Mask:
    """Whether a place of each marker is that of another. Shapes (M, ..., 2), (M, 2) to (M, ..., M)."""
    apart = np.linalg.norm(places[..., None, :] - others, axis=-1)
    reach = APART * (radii[:, None] + radii)
    return apart < reach.reshape(len(radii), *[1] * (places.ndim - 2), len(radii))
