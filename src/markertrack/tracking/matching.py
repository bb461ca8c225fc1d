"""Which of the blobs in a frame is which marker: predicted places, corrected together, and lengths along the body.

Markers move together, so what a prediction misses is nearly the same for neighbors: each marker is given the blob at
its place, then all places are corrected by what varies smoothly along the body, and so on. Blobs that would stretch or
shrink the body are refused.

When this has lost the thread, the whole body is fitted to the blobs (`Chain.fit`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from markertrack.tracking.tracker import Array, Mask

LINK_SHARE = 0.2  # by which the distance of neighbors, and of next neighbors, may be off
MOST = 0.5  # share of its markers of which more must be found for a body to be believed
_ROUNDS = 3
_FAR = 1e6


def gaps_of(points: Array) -> Array:
    """Distance of each marker to the nearest other one. Shape (M, 2) to (M,)."""
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    return np.nan_to_num(distances + np.where(np.eye(len(points)), np.inf, 0.0), nan=np.inf).min(axis=1)


def match(predicted: Array, doubt: Array, blobs: Array, quality: Array) -> tuple[NDArray[np.int64], Array]:
    """Gives each marker a blob or none.

    Args:
        predicted: Places that markers should be at [px]. Shape (M, 2).
        doubt: How far off each one may be beyond what markers have in common [px]. Shape (M,).
        blobs: Places of the blobs in the frame [px]. Shape (P, 2).
        quality: Quality of the blobs, from 0 to 1. Shape (P,).

    Returns:
        Index of each marker's blob, -1 for none, shape (M,), and the corrected places [px], shape (M, 2).
    """
    count = len(predicted)
    if len(blobs) == 0:
        return np.full(count, -1), predicted
    gates = np.minimum(doubt, gaps_of(predicted) / 2 + 1.0)  # else another marker is nearer
    places = predicted
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(predicted, axis=0), axis=1))])
    along = 2 * along / max(along[-1], 1e-9) - 1
    chosen = np.full(count, -1)
    for degree in range(_ROUNDS):
        chosen = _assigned(places, gates, blobs, quality)
        seen = np.flatnonzero(chosen >= 0)
        if len(seen) < 2:
            break
        places = predicted + _smooth(along, seen, blobs[chosen[seen]] - predicted[seen], min(degree, len(seen) - 2))
    chosen = _assigned(places, gates, blobs, quality)
    if 2 <= np.count_nonzero(chosen >= 0) < count:
        # those without a blob once more, where the nearest of the others have it
        known = np.where(chosen[:, None] >= 0, blobs[chosen], np.nan)
        places = np.where(chosen[:, None] >= 0, places, filled(known, predicted))
        chosen = _assigned(places, gates, blobs, quality)
    return chosen, places


def _smooth(along: Array, seen: NDArray[np.int64], off: Array, degree: int) -> Array:
    """A polynomial along the body through what the seen markers are off by. Shape (M, 2)."""
    basis = np.polynomial.legendre.legvander(along, max(degree, 0))
    ridge = 1e-2 * np.diag(np.arange(basis.shape[1]) ** 2.0)
    part = basis[seen]
    # what a straight fit doesn't explain must not pull the others: one round of robust weights
    weights = np.ones(len(seen))
    correction = np.zeros((basis.shape[1], 2))
    for _ in range(2):
        scaled = part * weights[:, None]
        correction = np.linalg.solve(scaled.T @ part + ridge, scaled.T @ off)
        rest = np.linalg.norm(off - part @ correction, axis=1)
        weights = 1 / (1 + (rest / (2 * np.median(rest) + 0.5)) ** 2)
    return basis @ correction


def _assigned(places: Array, gates: Array, blobs: Array, quality: Array) -> NDArray[np.int64]:
    count = len(places)
    off = np.linalg.norm(places[:, None] - blobs[None], axis=2) / gates[:, None]
    cost = np.where(off < 1, off**2 + 0.5 * (1 - quality), _FAR)
    none = np.where(np.eye(count, dtype=bool), 1.5, _FAR)
    rows, columns = linear_sum_assignment(np.concatenate([cost, none], axis=1))
    chosen = np.full(count, -1)
    chosen[rows] = np.where(columns < len(blobs), columns, -1)
    return chosen


def filled(points: Array, before: Array) -> Array:
    """The points, unknown ones where a body of the shape `before` has them, carried by the nearest known ones.

    Args:
        points: NaN for unknown markers [px]. Shape (M, 2).
        before: The shape [px]. Shape (M, 2), or one for each marker: (M, M, 2).
    """
    out = points.copy()
    for m in np.flatnonzero(~np.isfinite(points[:, 0])):
        shape = before if before.ndim == 2 else before[m]
        away = np.linalg.norm(shape - shape[m], axis=1)
        near = np.median(np.sort(away)[1:3])
        out[m] = _placed(points, shape, 1 / (1 + (away / near) ** 2) ** 2)[m]
    return out


def _placed(points: Array, before: Array, weights: Array) -> Array:
    """Where a body of the shape `before` is now, rigidly, by the markers that are known.

    Args:
        points: Now, NaN for unknown markers [px]. Shape (M, 2).
        before: The shape [px], NaN where it wasn't known. Shape (M, 2).
        weights: Weight of each marker. Shape (M,).

    Returns:
        All markers now [px]. Shape (M, 2).
    """
    known = np.isfinite(points).all(axis=1) & np.isfinite(before).all(axis=1)
    if not known.any():
        return before
    w = weights[known] / weights[known].sum()
    here, there = w @ points[known], w @ before[known]
    if known.sum() == 1:
        return before - there + here
    a, b = points[known] - here, before[known] - there
    cross, dot = float(w @ (b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])), float(w @ (b * a).sum(axis=1))
    turn = np.arctan2(cross, dot)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])  # for row vectors
    return (before - there) @ rotation + here


class Chain:
    """Lengths along the body that are watched: of neighbors and next neighbors, (i, i + 1) and (i, i + 2) in turns.

    Attributes:
        pairs: Pairs of markers. Shape (L, 2).
        lengths: Usual distance of each pair [px]. Shape (L,).
    """

    def __init__(self, points: Array) -> None:
        """Takes the markers' places in the first frame (M, 2)."""
        count = len(points)
        self.pairs = np.array([(i, j) for i in range(count) for j in (i + 1, i + 2) if j < count], dtype=np.int64)
        self.lengths = self._distances(points)

    def adapt(self, points: Array, sure: Mask, rate: float) -> None:
        """Takes in a share of how lengths have changed between markers that are sure. Shapes (M, 2), (M,)."""
        change = rate * (np.nan_to_num(self._distances(points)) - self.lengths)
        self.lengths = np.where(sure[self.pairs].all(axis=1), self.lengths + change, self.lengths)

    def strain(self, points: Array, slack: float) -> Array:
        """How far each length is off, 1 at what is allowed; 0 where one end isn't seen. Shape (L,).

        Args:
            points: Positions, NaN for markers that aren't seen [px]. Shape (M, 2).
            slack: Error of a length that is allowed in any case [px].
        """
        off = np.abs(self._distances(points) - self.lengths)
        return np.nan_to_num(off / (LINK_SHARE * self.lengths + slack))

    def strained(self, strain: Array, count: int) -> Mask:
        """Markers that have to go until all lengths along the body are as usual. Shape (M,).

        Args:
            strain: Strain of each length. Shape (L,).
            count: Number of markers.
        """
        out, links = np.zeros(count, dtype=bool), self.pairs
        while True:
            alive = ~out[links].any(axis=1) & (strain > 1)
            if not alive.any():
                return out
            badness, support = np.zeros((2, count))
            np.add.at(badness, links[alive].ravel(), np.repeat(strain[alive], 2))
            sound = ~out[links].any(axis=1) & (strain <= 1)
            np.add.at(support, links[sound].ravel(), 1.0)
            out[int(np.argmax(np.where(badness > 0, badness / (1 + support), -1.0)))] = True

    def unsupported(self, seen: Mask, known: Mask, strain: Array) -> Mask:
        """Markers that reappeared where nothing vouches for them: a wrong blob may lie there. Shape (M,).

        A marker that was seen a moment ago vouches for one that reappears next to it at the right distance, and so on
        along the body. Without any, most of the body must reappear at once.

        Args:
            seen: Whether each marker is seen in this frame. Shape (M,).
            known: Whether it was seen in the last frame. Shape (M,).
            strain: Strain of each length. Shape (L,).
        """
        sure = seen & known
        if not sure.any():
            sound = seen.copy()
            a, b = self.pairs[strain > 1].T
            sound[a] = sound[b] = False
            return seen & ~(sound if sound.mean() > MOST else np.zeros_like(seen))
        while True:
            a, b = self.pairs.T
            good, bad = strain <= 1, strain > 1
            vouched, refused = np.zeros_like(seen), np.zeros_like(seen)
            for end, other in ((a, b), (b, a)):
                vouched[end[good & sure[other] & seen[end]]] = True
                refused[end[bad & sure[other] & seen[end]]] = True
            more = vouched & ~refused & ~sure
            if not more.any():
                return seen & ~sure
            sure |= more

    def fit(self, count: int, blobs: Array, slack: float) -> NDArray[np.int64]:
        """Gives the markers blobs in the order of the body, wherever they were expected.

        The markers keep their order and their distances along the body. Of all ways to give some of them a blob in
        this order, the one is taken that leaves fewest markers out and strains the distances least; dynamic programming
        finds it. Where the markers were a moment ago doesn't count, so it recovers from a wrong prediction or a long
        occlusion.

        Args:
            count: Number of markers.
            blobs: Places of the blobs in the frame [px]. Shape (P, 2).
            slack: Error of a length that is allowed in any case [px].

        Returns:
            Index of each marker's blob, -1 for none; all -1 when no body is found. Shape (M,).
        """
        number = len(blobs)
        nothing = np.full(count, -1)
        if number <= MOST * count:
            return nothing
        away = np.linalg.norm(blobs[:, None] - blobs[None], axis=2)  # (P, P)
        # cost up to here with all markers before left out: each costs as much as a length that is off by all it may be
        best = np.repeat(np.arange(count, dtype=float)[:, None], number, axis=1)
        came = np.full((count, number, 2), -1)
        for m in range(1, count):
            for before in range(m):
                strain = self._chord_strain(before, m, away, slack)
                step = best[before][:, None] + strain + m - before - 1
                np.fill_diagonal(step, np.inf)
                source = np.argmin(step, axis=0)
                cost = step[source, np.arange(number)]
                better = cost < best[m]
                best[m] = np.where(better, cost, best[m])
                came[m, better] = np.stack([np.full(number, before), source], axis=1)[better]
        ends = best + np.arange(count - 1, -1, -1)[:, None]
        m, p = (int(i) for i in np.unravel_index(int(np.argmin(ends)), ends.shape))
        chosen = nothing.copy()
        while m >= 0:
            chosen[m] = p
            m, p = (int(i) for i in came[m, p])
        taken = chosen[chosen >= 0]
        return chosen if len(taken) > MOST * count and len(set(taken.tolist())) == len(taken) else nothing

    def _chord_strain(self, before: int, m: int, away: Array, slack: float) -> Array:
        """Cost of two markers' blobs, with none for the markers between. Shape (P, P)."""
        if m - before <= 2:
            length = self.lengths[2 * before + (m - before - 1)]
            return np.minimum(((away - length) / (LINK_SHARE * length + slack)) ** 2, 1e3)
        way = float(self.lengths[0::2][before:m].sum())  # no two are farther apart than along the body
        return np.minimum((np.maximum(away - way, 0.0) / (LINK_SHARE * way + slack)) ** 2, 1e3)

    def _distances(self, points: Array) -> Array:
        return np.linalg.norm(points[self.pairs[:, 0]] - points[self.pairs[:, 1]], axis=1)
