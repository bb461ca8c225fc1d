"""Which spots are which markers of rigid bodies: all ways to lay the bodies over the spots, and how sure the best is.

Each body is laid over the spots by all shifts that bring one of its markers onto a spot, and by all motions that bring
two onto two. A way to label the markers costs something for each marker without a spot, for spots beside their places
and for being far from where the body was expected. The bodies together take the cheapest ways in which no spot is two
markers. How much more the next one would cost, in which a marker or a spot has another partner, says how sure that is:
a row of equal markers can be mistaken by one spacing, and only its ends tell.

Of a body in doubt two costs are known. By the one its last labels are preferred, by the other they are as good as any
that are no farther from where it was last held than it may have gone: what was assumed is no evidence for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.tracking.tracker import Array, Mask

Labels = NDArray[np.int64]

LEAD = 4.0  # by which labels must be better than any others to be sure: two fifths of a missing marker
MISSED = 10.0  # cost of a marker that should be in the frame and has no spot; of a pushed or turned body, at most
BESIDE = 0.5  # cost of a spot that is as far from its place as is allowed
POOR = 2.0  # cost of a spot that isn't like its marker at all
NEARER = 0.6  # cost that prefers the last labels among those that are as good, by the logarithm of the distance
MOST_WAYS = 16  # to lay one body that are kept
_BEAM = 64
_MOST_PAIRS = 3  # of a body's markers that are laid over spots


class Labeled(NamedTuple):
    """What the markers of a body were found to be.

    Attributes:
        spots: Index of each marker's spot, -1 for none. Shape (M,).
        places: Their centers, NaN of none [px]. Shape (M, 2).
        lead: By how much these labels are better than the next ones in which half of those that have a spot have
            others, in units of cost.
        own_leads: By how much that of each marker is better than the next other one of it. Shape (M,).
        apart: How far the body would be from there by labels that aren't worse for sure [px].
        turned: How far it would be turned by them [rad].
    """

    spots: Labels
    places: Array
    lead: float
    own_leads: Array
    apart: float = 0.0
    turned: float = 0.0


@dataclass(frozen=True)
class Expected:
    """Where a body should be.

    Attributes:
        places: Its markers [px]. Shape (M, 2).
        held: Where they were when nothing else was far from there, or the same [px]. Shape (M, 2).
        pairs: `pairs_of` its shape.
        spread: How far it may easily be from where it was held [px].
        usual: How far it would be from where it is expected if its last labels are right [px].
        swing: How far it may easily be turned against where it was held [rad].
        near: How far it may be where all is well [px].
        reach: How far it may be at most [px].
        tolerance: How far a spot may be from a marker's place on the body [px].
        lost: Whether it may have been mistaken for another, or wasn't seen.
    """

    places: Array
    held: Array
    pairs: NDArray[np.int64]
    spread: float
    usual: float
    swing: float
    near: float
    reach: float
    tolerance: float
    lost: bool


@njit(cache=True, nogil=True)
def distance(here: Array, there: Array) -> float:
    """Root mean square distance of markers [px]."""
    return float(np.sqrt(((here - there) ** 2).sum() / len(here)))


def turn(here: Array, there: Array) -> float:
    """Angle by which markers (M, 2) have turned about their middle, from 0 to pi [rad]."""
    ways = [(places - places.mean(axis=0)) @ np.array([1, 1j]) for places in (here, there)]
    return float(abs(np.angle(np.vdot(*ways))))


def pairs_of(shape: Array) -> NDArray[np.int64]:
    """Pairs of a body's markers that tell how it is turned, the widest first. Shape (K, 2)."""
    first, second = np.triu_indices(len(shape), 1)
    order = np.argsort(-np.linalg.norm(shape[first] - shape[second], axis=1), kind="stable")[:_MOST_PAIRS]
    return np.stack([first[order], second[order]], axis=1).astype(np.int64)


@njit(cache=True, nogil=True)
def rigid_fit(shape: Array, places: Array, weights: Array | None = None) -> Array:
    """The shape (M, 2) where its rigid motion comes closest to places (M, 2), NaN left out, by weights (M,)."""
    known = np.isfinite(places[:, 0])
    if not known.any():
        return shape.copy()
    counts = np.ones(len(shape)) if weights is None else weights
    c, s, x, y = _fitted(shape, places, np.where(known, np.arange(len(shape)), -1), counts, 1.0, 0.0)
    return np.stack((c * shape[:, 0] - s * shape[:, 1] + x, s * shape[:, 0] + c * shape[:, 1] + y), axis=1)


def label(expected: Sequence[Expected], centers: Array, looks: Sequence[Array], size: tuple[int, int]) -> list[Labeled]:
    """Labels the markers of all bodies: first of those that are where they should be, then of those that may be away.

    Args:
        expected: Where the bodies should be.
        centers: Centers of the spots [px]. Shape (P, 2).
        looks: How much each spot looks like each marker, body by body, from 0 to 1; below 0 it can't be it. Shapes
            (M, P).
        size: Width and height of the frame [px].
    """
    nothing = [np.full((len(one.places), 2), np.nan) for one in expected]
    found = [Labeled(np.full(len(one), -1), one, np.inf, np.full(len(one), np.inf)) for one in nothing]
    near = [index for index, body in enumerate(expected) if not body.lost]
    far = [index for index, body in enumerate(expected) if body.lost or body.reach > body.near]
    for group, narrow in ((near, True), (far, False)):
        for index in group:
            found[index].spots[:] = -1
        free = np.setdiff1d(np.arange(len(centers)), np.concatenate([one.spots for one in found]))
        bodies = [replace(expected[index], reach=expected[index].near if narrow else expected[index].reach)
                  for index in group]  # fmt: skip
        labeled = _labeled(bodies, centers[free], [looks[index][:, free] for index in group], size) if group else []
        for index, one in zip(group, labeled, strict=True):
            spots = free[one.spots] if len(free) else one.spots
            found[index] = one._replace(spots=np.where(one.spots >= 0, spots, -1))
    return found


def _places_of(labels: Labels, centers: Array) -> Array:
    """Places of markers by the spots (P, 2) that they are, NaN of those that are none. Shape (M, 2)."""
    return np.where(labels[:, None] >= 0, np.vstack([centers, np.full((1, 2), np.nan)])[labels], np.nan)


def _labeled(
    expected: Sequence[Expected], centers: Array, looks: Sequence[Array], size: tuple[int, int]
) -> list[Labeled]:
    """Labels some bodies at once."""
    ways: list[NDArray[np.int64]] = []
    costs: list[Array] = []
    for body, like in zip(expected, looks, strict=True):
        markers = len(body.places)
        labels, cost = np.full((MOST_WAYS, markers), -1, dtype=np.int64), np.full((MOST_WAYS, 2), np.inf)
        limits = np.array([body.spread, body.usual, body.swing, body.tolerance, *size], dtype=float)
        there = np.stack([body.places, body.held])
        count = _ways(there, limits, body.reach, body.pairs, centers, np.ascontiguousarray(like), labels, cost)
        inside = ((body.places >= 0) & (body.places <= np.array(size) - 1)).all(axis=1)
        visible = markers if body.lost else int(inside.sum())
        ways.append(np.concatenate([labels[:count], np.full((1, markers), -1)]))
        costs.append(np.append(cost[:count], np.full((1, 2), MISSED * visible), axis=0))
    rows, total = _together(ways, costs)
    spots = np.concatenate([way[rows[:, body]] for body, way in enumerate(ways)], axis=1)  # (B, all markers)
    owner = np.repeat(np.arange(len(ways)), [len(body.places) for body in expected])
    changed = _changed(spots[0], spots[1:], len(centers))
    dearer = (total[1:, 1] - total[0, 1])[:, None]
    own_leads = np.where(changed, dearer, np.inf).min(axis=0, initial=np.inf)
    of = np.arange(len(ways)) == owner[:, None]
    named = (spots[0] >= 0).astype(float) @ of
    mostly = changed.astype(float) @ of >= np.maximum(named, 1) / 2
    leads = np.where(mostly, dearer, np.inf).min(axis=0, initial=np.inf).tolist()
    best = [way[index] for way, index in zip(ways, rows[0], strict=True)]
    best = _without_doubles(best, [body.places for body in expected], centers)
    out: list[Labeled] = []
    for index, (body, way, labels) in enumerate(zip(expected, ways, best, strict=True)):
        others = way[np.unique(rows[1:, index][mostly[:, index] & (dearer[:, 0] < LEAD)])]
        places, own = _places_of(labels, centers), own_leads[owner == index]
        apart, turned = _apart(body, places, [_places_of(other, centers) for other in others])
        out.append(Labeled(labels, places, leads[index], own, apart, turned))
    return out


def _apart(body: Expected, places: Array, others: list[Array]) -> tuple[float, float]:
    """How far a body would be, at most, by other places of its markers (M, 2) [px], and how far turned [rad]."""
    here, apart, turned = rigid_fit(body.places, places), 0.0, 0.0
    for other in others:
        there = rigid_fit(body.places, other)
        unseen = np.isnan(other).all()  # then it may be anywhere
        apart, turned = max(apart, body.spread if unseen else distance(here, there)), max(turned, turn(here, there))
    return apart, turned


def _together(ways: list[NDArray[np.int64]], costs: list[Array]) -> tuple[NDArray[np.int64], Array]:
    """The cheapest combinations of one way for each body, and their costs. Shapes (B, bodies), (B, 2)."""
    rows, total = np.zeros((1, 0), dtype=np.int64), np.zeros((1, 2))
    for body, (way, cost) in enumerate(zip(ways, costs, strict=True)):
        grown = total[:, None] + cost
        for before in range(body):
            shared = (ways[before][:, None, :, None] == way[None, :, None, :]) & (way >= 0)[None, :, None, :]
            if shared.any():
                grown = grown + MISSED * shared.sum(axis=(2, 3))[rows[:, before], :, None]
        order = np.argsort(grown[..., 0], axis=None, kind="stable")[:_BEAM]
        source, index = np.unravel_index(order, grown.shape[:2])
        rows, total = np.concatenate([rows[source], index[:, None]], axis=1), grown.reshape(-1, 2)[order]
    return rows, total


def _changed(best: Labels, others: Labels, count: int) -> Mask:
    """Whether each marker has another spot, or its spot another marker; one only left out has not.

    Args:
        best: Spot of each marker. Shape (M,).
        others: Spots in other ways. Shape (B, M).
        count: Number of spots.

    Returns:
        By way and marker. Shape (B, M).
    """
    holder = np.full(count + 1, -1)  # the last one stands for no spot
    holder[best[best >= 0]] = np.flatnonzero(best >= 0)
    before = holder[others]
    taken = (before >= 0) & (before != np.arange(len(best)))
    changed = taken | ((others != best) & (others >= 0) & (best >= 0))
    row, marker = np.nonzero(taken)
    changed[row, before[row, marker]] = True
    return changed


def _without_doubles(labels: list[Labels], predicted: list[Array], centers: Array) -> list[Labels]:
    """A spot that two bodies have keeps the marker that is nearer to its place on its body."""
    out = [one.copy() for one in labels]
    taken: dict[int, tuple[float, int, int]] = {}
    for body, (one, places) in enumerate(zip(labels, predicted, strict=True)):
        seen, found = np.flatnonzero(one >= 0), _places_of(one, centers)
        off = np.linalg.norm(found - rigid_fit(places, found), axis=1)
        for marker in seen:
            spot, mine = int(one[marker]), (float(off[marker]), body, int(marker))
            if spot in taken:
                _, loser, lost = max(mine, taken[spot])
                out[loser][lost] = -1
                mine = min(mine, taken[spot])
            taken[spot] = mine
    return out


@njit(cache=True, nogil=True)
def _ways(
    there: Array, limits: Array, reach: float, pairs: NDArray[np.int64], centers: Array, looks: Array,
    labels: NDArray[np.int64], costs: Array,
) -> int:  # fmt: skip
    """Fills in the best ways to label one body, and their costs; gives their number.

    `there` is where it is expected and where it was held, `limits` are spread, usual spread, swing and tolerance of
    `Expected`, and width and height of the frame.
    """
    predicted, tolerance = there[0], limits[3]
    markers = len(predicted)
    near = np.zeros((markers, len(centers)), dtype=np.bool_)
    for m in range(markers):
        for p in range(len(centers)):
            away = (centers[p, 0] - predicted[m, 0]) ** 2 + (centers[p, 1] - predicted[m, 1]) ** 2
            near[m, p] = looks[m, p] >= 0 and away < reach**2
    trial, off = np.empty(markers, dtype=np.int64), np.empty(markers)
    count = _tried(there, (1.0, 0.0, 0.0, 0.0), limits, centers, looks, trial, off, labels, costs, 0)
    for m in range(markers):
        for p in range(len(centers)):
            if near[m, p]:
                motion = (1.0, 0.0, centers[p, 0] - predicted[m, 0], centers[p, 1] - predicted[m, 1])
                count = _tried(there, motion, limits, centers, looks, trial, off, labels, costs, count)
    for k in range(len(pairs)):
        a, b = pairs[k]
        bx, by = predicted[b, 0] - predicted[a, 0], predicted[b, 1] - predicted[a, 1]
        length = np.sqrt(bx * bx + by * by)
        for p in range(len(centers)):
            if not near[a, p]:
                continue
            for q in range(len(centers)):
                if q == p or not near[b, q]:
                    continue
                dx, dy = centers[q, 0] - centers[p, 0], centers[q, 1] - centers[p, 1]
                far = np.sqrt(dx * dx + dy * dy)
                if abs(far - length) > 1.5 * tolerance:
                    continue
                c, s = (bx * dx + by * dy) / (length * far), (bx * dy - by * dx) / (length * far)
                x = centers[p, 0] - (c * predicted[a, 0] - s * predicted[a, 1])
                y = centers[p, 1] - (s * predicted[a, 0] + c * predicted[a, 1])
                count = _tried(there, (c, s, x, y), limits, centers, looks, trial, off, labels, costs, count)
    return count


@njit(cache=True, nogil=True)
def _tried(
    there: Array, motion: tuple[float, float, float, float], limits: Array, centers: Array, looks: Array,
    trial: NDArray[np.int64], off: Array, labels: NDArray[np.int64], costs: Array, count: int,
) -> int:  # fmt: skip
    """Lays a body by one motion, labels it, fits the motion to the labels, and keeps the way if it is a good one.

    A motion is the cosine and sine of a turn about the origin, and a shift.
    """
    spread, usual, swing, tolerance, width, height = limits
    c, s, x, y = motion
    predicted, held = there[0], there[1]
    markers, even = len(predicted), np.ones(len(predicted))
    for turn in range(3):
        gate = (2.5 if turn == 0 else 1.0) * tolerance
        seen = _nearest(predicted, (c, s, x, y), centers, looks, gate, trial, off)
        if seen == 0:
            return count
        if turn < 2:
            c, s, x, y = _fitted(predicted, centers, trial, even, c, s)
    cost = away = gone = 0.0
    laid = np.empty_like(predicted)
    for m in range(markers):
        px, py = c * predicted[m, 0] - s * predicted[m, 1] + x, s * predicted[m, 0] + c * predicted[m, 1] + y
        laid[m, 0], laid[m, 1] = px, py
        away += (px - predicted[m, 0]) ** 2 + (py - predicted[m, 1]) ** 2
        gone += (px - held[m, 0]) ** 2 + (py - held[m, 1]) ** 2
        if trial[m] >= 0:
            cost += BESIDE * (off[m] / tolerance) ** 2 + POOR * (1 - looks[m, trial[m]])
        elif _inside(px, py, width, height) or _inside(predicted[m, 0], predicted[m, 1], width, height):
            cost += MISSED
        elif markers > 2:
            cost += MISSED / 2  # it may be outside; or else a row is laid beside itself
    away, gone = away / (2 * markers), gone / (2 * markers)
    turned, _, _, _ = _fitted(held, laid, np.arange(markers), even, 1.0, 0.0)
    proof = cost + min((2 + NEARER) * np.log1p(gone / spread**2), MISSED)
    proof += min(2 * np.log1p(np.arccos(min(max(turned, -1.0), 1.0)) ** 2 / (2 * swing**2)), MISSED)
    cost += min(2 * np.log1p(away / spread**2) + NEARER * np.log1p(away / usual**2), MISSED)
    cost += min(2 * np.log1p(np.arctan2(s, c) ** 2 / (2 * swing**2)), MISSED)
    # one that only leaves out what a better one has isn't another way
    for k in range(count):
        more = less = True
        for m in range(markers):
            if trial[m] != labels[k, m]:
                more = more and labels[k, m] < 0
                less = less and trial[m] < 0
        if more or less:
            if cost < costs[k, 0]:
                _put(labels, costs, k, trial, cost, proof)
            return count
    if count == len(costs):
        if cost >= costs[count - 1, 0]:
            return count
        count -= 1
    _put(labels, costs, count, trial, cost, proof)
    return count + 1


@njit(cache=True, nogil=True)
def _put(
    labels: NDArray[np.int64], costs: Array, k: int, trial: NDArray[np.int64], cost: float, proof: float
) -> None:  # fmt: skip
    """Puts a way in place of another, and moves it ahead of those that cost more."""
    while k > 0 and cost < costs[k - 1, 0]:
        costs[k], labels[k] = costs[k - 1], labels[k - 1]
        k -= 1
    costs[k, 0], costs[k, 1], labels[k] = cost, proof, trial


@njit(cache=True, nogil=True)
def _inside(x: float, y: float, width: float, height: float) -> bool:
    return 0 <= x <= width - 1 and 0 <= y <= height - 1


@njit(cache=True, nogil=True)
def _nearest(
    predicted: Array, motion: tuple[float, float, float, float], centers: Array, looks: Array, gate: float,
    trial: NDArray[np.int64], off: Array,
) -> int:  # fmt: skip
    """Gives each marker the nearest spot to its place, where it is the nearest of that spot; gives their number."""
    c, s, x, y = motion
    seen = 0
    for m in range(len(predicted)):
        px, py = c * predicted[m, 0] - s * predicted[m, 1] + x, s * predicted[m, 0] + c * predicted[m, 1] + y
        trial[m], best, off[m] = -1, 2 * gate * gate, 0.0
        for p in range(len(centers)):
            away = (centers[p, 0] - px) ** 2 + (centers[p, 1] - py) ** 2
            if away < gate * gate and looks[m, p] >= 0:
                poor = (1 - looks[m, p]) * gate  # a spot that looks like the marker is preferred to one that is nearer
                if away + poor * poor < best:
                    trial[m], best, off[m] = p, away + poor * poor, np.sqrt(away)
        if trial[m] < 0:
            continue
        seen += 1
        for other in range(m):
            if trial[other] == trial[m]:
                seen -= 1
                if off[other] <= off[m]:
                    trial[m] = -1
                else:
                    trial[other] = -1
                break
    return seen


@njit(cache=True, nogil=True)
def _fitted(
    predicted: Array, centers: Array, trial: NDArray[np.int64], weights: Array, c: float, s: float
) -> tuple[float, float, float, float]:
    """The rigid motion that brings the markers closest to their spots; one alone keeps the turn."""
    hx = hy = tx = ty = total = 0.0
    for m in range(len(predicted)):
        if trial[m] >= 0:
            hx += weights[m] * centers[trial[m], 0]
            hy += weights[m] * centers[trial[m], 1]
            tx += weights[m] * predicted[m, 0]
            ty += weights[m] * predicted[m, 1]
            total += weights[m]
    hx, hy, tx, ty = hx / total, hy / total, tx / total, ty / total
    cross = dot = 0.0
    for m in range(len(predicted)):
        if trial[m] >= 0:
            ax, ay = centers[trial[m], 0] - hx, centers[trial[m], 1] - hy
            bx, by = predicted[m, 0] - tx, predicted[m, 1] - ty
            cross += weights[m] * (bx * ay - by * ax)
            dot += weights[m] * (bx * ax + by * ay)
    norm = np.sqrt(cross * cross + dot * dot)
    if norm > 0:
        c, s = dot / norm, cross / norm
    return c, s, hx - (c * tx - s * ty), hy - (s * tx + c * ty)
