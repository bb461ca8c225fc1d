"""Which of the blobs in a frame is which marker: predicted places, corrected together, and lengths along the body.

Markers move together, so what a prediction misses is nearly the same for neighbors. First one shift for all is found by
vote, then a correction that varies smoothly along the body; only then is each marker given the blob at its place. Blobs
that would stretch or shrink the body are refused.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GATE_SHARE = 0.45  # of the distance to the next marker: how far from its place a blob may be
LINK_SHARES = (0.15, 0.22)  # by which the distance of neighbors, and of next neighbors, may be off
SUPPORT = 0.6  # of the strain that is allowed, at most, to vouch for a marker that reappears
LEAST_GROUP = 4  # markers that may reappear without another that was seen
LEAST_SEEN = 3  # markers, for a correction along the body
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
        blobs: Found in the frame [px]. Shape (P, 2).
        quality: Of the blobs, from 0 to 1. Shape (P,).

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


def links_of(count: int) -> NDArray[np.int64]:
    """Pairs of markers whose distance is watched: neighbors and next neighbors. Shape (L, 2)."""
    return np.array([(i, j) for i in range(count) for j in (i + 1, i + 2) if j < count], dtype=np.int64).reshape(-1, 2)


def strained(points: Array, links: NDArray[np.int64], lengths: Array, slack: float) -> NDArray[np.bool_]:
    """Markers that have to go until all lengths along the body are as usual. Shape (M,).

    Args:
        points: NaN for markers that weren't found [px]. Shape (M, 2).
        links: Pairs of markers. Shape (L, 2).
        lengths: Usual distance of each pair [px]. Shape (L,).
        slack: By which a length may be off in any case [px].
    """
    out = np.zeros(len(points), dtype=bool)
    strain = link_strain(points, links, lengths, slack)
    while True:
        alive = ~out[links].any(axis=1) & (strain > 1)
        if not alive.any():
            return out
        badness, support = np.zeros(len(points)), np.zeros(len(points))
        np.add.at(badness, links[alive].ravel(), np.repeat(strain[alive], 2))
        sound = ~out[links].any(axis=1) & (strain <= 1)
        np.add.at(support, links[sound].ravel(), 1.0)
        out[int(np.argmax(np.where(badness > 0, badness / (1 + support), -1.0)))] = True


def link_strain(points: Array, links: NDArray[np.int64], lengths: Array, slack: float) -> Array:
    """How far each length is off, 1 at what is allowed; 0 where one end wasn't found. Shape (L,)."""
    found = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    shares = np.array(LINK_SHARES)[links[:, 1] - links[:, 0] - 1]
    return np.nan_to_num(np.abs(found - lengths) / (shares * lengths + slack))


def unsupported(found: NDArray[np.bool_], known: NDArray[np.bool_], links: NDArray[np.int64], strain: Array) -> Mask:
    """Markers that reappeared where nothing vouches for them: a wrong blob may lie there. Shape (M,).

    A marker that was seen a moment ago vouches for one that reappears next to it at the right distance, and so on along
    the body. Without any, most of the body must reappear at once.

    Args:
        found: In this frame. Shape (M,).
        known: In the last frame, too. Shape (M,).
        links: Pairs of markers. Shape (L, 2).
        strain: Of each, see `link_strain`. Shape (L,).
    """
    sure = found & known
    if not sure.any():
        sound = found.copy()
        a, b = links[strain > SUPPORT].T
        sound[a] = sound[b] = False
        return found & ~(sound if sound.sum() >= max(LEAST_GROUP, len(found) // 2) else np.zeros_like(found))
    while True:
        a, b = links.T
        good, bad = strain <= SUPPORT, strain > SUPPORT
        vouched, refused = np.zeros_like(found), np.zeros_like(found)
        for one, other in ((a, b), (b, a)):
            vouched[one[good & sure[other] & found[one]]] = True
            refused[one[bad & sure[other] & found[one]]] = True
        more = vouched & ~refused & ~sure
        if not more.any():
            return found & ~sure
        sure |= more


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
        out[m] = placed(points, shape, 1 / (1 + (away / near) ** 2) ** 2)[m]
    return out


def placed(points: Array, before: Array, weights: Array) -> Array:
    """Where a body of the shape `before` is now, rigidly, by the markers that are known.

    Args:
        points: Now, NaN for unknown markers [px]. Shape (M, 2).
        before: The shape [px], NaN where it wasn't known. Shape (M, 2).
        weights: Of each marker. Shape (M,).

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
