"""Which of the blobs in a frame is which marker: predicted places, corrected together, and lengths along the body.

Markers move together, so what a prediction misses is nearly the same for neighbors. First one shift for all is found by
vote, then a correction that varies smoothly along the body; only then is each marker given the blob at its place. Blobs
that would stretch or shrink the body are refused.

When this has lost the thread, the whole body is fitted to the blobs (`Chain.fit`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from markertrack.tracking.tracker import Array, Mask

GATE_SHARE = 0.45  # of the distance to the next marker: how far from its place a blob may be
LINK_SHARES = (0.15, 0.22)  # by which the distance of neighbors, and of next neighbors, may be off
SUPPORT = 0.6  # of the strain that is allowed, at most, to vouch for a marker that reappears
LEAST_GROUP = 4  # markers that may reappear without another that was seen
LEAST_SEEN = 3  # markers, for a correction along the body
MISSED = 2.0  # cost of a marker without a blob; a length that is off by all that is allowed costs 1
POOR = 1.0  # cost of a blob of quality 0
FAR = 1.0  # cost of a place that is off by the length of the body
LEAST_PARTS = 5  # markers that must be found for a body to be believed
SHORTEST_CHORD, LONGEST_CHORD = 0.5, 1.05  # of the way along the body, between markers with others left out between
_ROUNDS = 3
_FAR = 1e6


def gaps_of(points: Array) -> Array:
    """Distance of each marker to the nearest other one. Shape (M, 2) to (M,)."""
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    return np.nan_to_num(distances + np.where(np.eye(len(points)), np.inf, 0.0), nan=np.inf).min(axis=1)


def match(
    predicted: Array, doubt: Array, trust: Array, blobs: Array, quality: Array
) -> tuple[NDArray[np.int64], Array]:
    """Gives each marker a blob or none.

    Args:
        predicted: Places that markers should be at [px]. Shape (M, 2).
        doubt: How far off each one may be beyond what markers have in common [px]. Shape (M,).
        trust: How much each one says about what they have in common, from 0 to 1. Shape (M,).
        blobs: Places of the blobs in the frame [px]. Shape (P, 2).
        quality: Quality of the blobs, from 0 to 1. Shape (P,).

    Returns:
        Index of each marker's blob, -1 for none, shape (M,), and the corrected places [px], shape (M, 2).
    """
    count = len(predicted)
    if len(blobs) == 0:
        return np.full(count, -1), predicted
    gates = np.minimum(doubt, GATE_SHARE * gaps_of(predicted) + 1.0)
    reach = float(3 * np.median(doubt))
    places = predicted + _common_shift(predicted, np.maximum(gates, 2.0), trust, blobs, quality, reach)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(predicted, axis=0), axis=1))])
    along = 2 * along / max(along[-1], 1e-9) - 1
    chosen = np.full(count, -1)
    for degree in range(_ROUNDS):
        chosen = _assigned(places, gates, blobs, quality)
        seen = np.flatnonzero(chosen >= 0)
        if len(seen) < LEAST_SEEN:
            break
        places = predicted + _smooth(along, seen, blobs[chosen[seen]] - predicted[seen], min(degree, len(seen) - 2))
    chosen = _assigned(places, gates, blobs, quality)
    if 2 <= np.count_nonzero(chosen >= 0) < count:
        # those without a blob once more, where the nearest of the others have it
        known = np.where(chosen[:, None] >= 0, blobs[chosen], np.nan)
        places = np.where(chosen[:, None] >= 0, places, filled(known, predicted))
        chosen = _assigned(places, gates, blobs, quality)
    return chosen, places


def _common_shift(predicted: Array, gates: Array, trust: Array, blobs: Array, quality: Array, reach: float) -> Array:
    """The shift that brings most markers onto blobs. Shape (2,)."""
    between = blobs[None] - predicted[:, None]  # (M, P, 2)
    shifts = between.reshape(-1, 2)
    shifts = np.concatenate([np.zeros((1, 2)), shifts[np.linalg.norm(shifts, axis=1) < reach]])
    off = np.linalg.norm(between[None] - shifts[:, None, None], axis=3)  # (S, M, P)
    hits = (quality * np.exp(-0.5 * (off / (0.5 * gates[:, None])) ** 2)).max(axis=2) @ trust
    likely = np.exp(-0.5 * (np.linalg.norm(shifts, axis=1) / reach) ** 2)
    return shifts[int(np.argmax(hits * (0.5 + 0.5 * likely)))]


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
        shares = np.array(LINK_SHARES)[self.pairs[:, 1] - self.pairs[:, 0] - 1]
        off = np.abs(self._distances(points) - self.lengths)
        return np.nan_to_num(off / (shares * self.lengths + slack))

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
            a, b = self.pairs[strain > SUPPORT].T
            sound[a] = sound[b] = False
            return seen & ~(sound if sound.sum() >= max(LEAST_GROUP, len(seen) // 2) else np.zeros_like(seen))
        while True:
            a, b = self.pairs.T
            good, bad = strain <= SUPPORT, strain > SUPPORT
            vouched, refused = np.zeros_like(seen), np.zeros_like(seen)
            for end, other in ((a, b), (b, a)):
                vouched[end[good & sure[other] & seen[end]]] = True
                refused[end[bad & sure[other] & seen[end]]] = True
            more = vouched & ~refused & ~sure
            if not more.any():
                return seen & ~sure
            sure |= more

    def fit(self, predicted: Array, blobs: Array, quality: Array, slack: float) -> NDArray[np.int64]:
        """Gives the markers blobs in the order of the body, wherever they were expected.

        The markers keep their order and their distances along the body. Of all ways to give some of them a blob in
        this order, the one is taken that leaves fewest markers out and strains the distances least; dynamic programming
        finds it. Where the markers were a moment ago counts for little, so it recovers from a wrong prediction or a
        long occlusion.

        Args:
            predicted: Where the markers might be [px]. Shape (M, 2).
            blobs: Places of the blobs in the frame [px]. Shape (P, 2).
            quality: Quality of the blobs, from 0 to 1. Shape (P,).
            slack: Error of a length that is allowed in any case [px].

        Returns:
            Index of each marker's blob, -1 for none; all -1 when no body is found. Shape (M,).
        """
        count, number = len(predicted), len(blobs)
        nothing = np.full(count, -1)
        least = max(LEAST_PARTS, int(np.ceil(0.5 * count)))
        if count < 3 or number < least:
            return nothing
        neighbors = self.lengths[0::2]
        body = float(neighbors.sum())
        away = np.linalg.norm(blobs[:, None] - blobs[None], axis=2)  # (P, P)
        own = FAR * (np.linalg.norm(predicted[:, None] - blobs[None], axis=2) / body) ** 2 + POOR * (1 - quality)
        best = own + MISSED * np.arange(count)[:, None]  # cost up to here with all markers before left out
        came = np.full((count, number, 2), -1)
        for m in range(1, count):
            for before in range(m):
                strain = self._chord_strain(before, m, away, slack)
                step = best[before][:, None] + strain + MISSED * (m - before - 1)
                np.fill_diagonal(step, np.inf)
                source = np.argmin(step, axis=0)
                cost = step[source, np.arange(number)] + own[m]
                better = cost < best[m]
                best[m] = np.where(better, cost, best[m])
                came[m, better] = np.stack([np.full(number, before), source], axis=1)[better]
        ends = best + MISSED * np.arange(count - 1, -1, -1)[:, None]
        m, p = (int(i) for i in np.unravel_index(int(np.argmin(ends)), ends.shape))
        chosen = nothing.copy()
        while m >= 0:
            chosen[m] = p
            m, p = (int(i) for i in came[m, p])
        taken = chosen[chosen >= 0]
        return chosen if len(taken) >= least and len(set(taken.tolist())) == len(taken) else nothing

    def _chord_strain(self, before: int, m: int, away: Array, slack: float) -> Array:
        """Cost of two markers' blobs, with none for the markers between. Shape (P, P)."""
        if m - before <= 2:
            length = self.lengths[2 * before + (m - before - 1)]
            return np.minimum(((away - length) / (LINK_SHARES[m - before - 1] * length + slack)) ** 2, 1e3)
        way = float(self.lengths[0::2][before:m].sum())
        off = np.maximum(away - LONGEST_CHORD * way, 0.0) + np.maximum(SHORTEST_CHORD * way - away, 0.0)
        return np.minimum((off / (LINK_SHARES[1] * way + slack)) ** 2 * 4, 1e3)

    def _distances(self, points: Array) -> Array:
        return np.linalg.norm(points[self.pairs[:, 0]] - points[self.pairs[:, 1]], axis=1)
