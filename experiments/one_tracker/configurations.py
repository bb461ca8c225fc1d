"""Where the markers of one body are together, and how it got there.

Flow may be that of what is alike near by, and if it is for one marker of a row it is for all: that a body's step isn't
what flow says counts once. So each body has a few *configurations* per frame, one candidate for each marker or none,
made marker after marker (a beam search) by how it looks, by the distances that it keeps from those that are placed
already, and by where these put it by the shape of the last frame. Which of them was there is decided over the film, as
a marker's candidate is (`trellis`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from trellis import APART, TAKEN

from markertrack.tracking.tracker import Array, Mask

KEPT = 3  # configurations of each frame
BEAM = 3  # of each way to begin
WITNESSES = 3.0  # distances that speak independently: a rigid body moves in three ways
ALIASED = 0.7  # cost of the flow of a body being that of something else
TOLD = 6.0  # cost of a step, or of a distance, that isn't at all like those of others
TURN, BEND = 0.15, 0.03  # of a distance by which one end goes aside in a frame, and beyond what two others do
NOISE = 1.0  # px by which they do in any case
BESIDE = 3.0  # cost of a marker being elsewhere than its body has it
FAR = 40.0  # cost above the best one, of what isn't looked at further

Index = NDArray[np.int64]


class Candidates(NamedTuple):
    """Candidates of all markers in a frame, C each, and what leads there from the B of the frame before.

    Attributes:
        places: Places [px]; the first one is that the marker isn't seen. Shape (M, C, 2).
        costs: Cost of each by its look; infinite where there is none. Shape (M, C).
        moves: Cost of steps by flow, and by the last step alone. Shape (2, M, B, C).
        distances: Usual distance of each pair of markers [px]. Shape (M, M).
        variances: Their variances [px²]. Shape (M, M).
        radii: Radius of each marker [px]. Shape (M,).
    """

    places: Array
    costs: Array
    moves: Array
    distances: Array
    variances: Array
    radii: Array


class Body:
    """Configurations of some markers that keep distances.

    Attributes:
        markers: Their indices, in the order in which they are placed. Shape (n,).
        chosen: Candidate of each marker in each configuration, 0 for none. Shape (K, n).
        places: Places of its markers, those that aren't seen where the others put them [px]. Shape (K, n, 2).
        edges: Costs of the ways there from those of the frame before. Shape (B, K).
        costs: Cost of the cheapest way to each. Shape (K,).
    """

    def __init__(self, points: Array, distances: Array, pairs: Mask, first: int) -> None:
        """Orders the markers that are connected with a first one.

        Args:
            points: Places of all markers [px]. Shape (M, 2).
            distances: Of all pairs of them [px]. Shape (M, M).
            pairs: Which of them are kept. Shape (M, M).
            first: Index of a marker.
        """
        order, near = [first], [np.zeros(0, dtype=np.int64)]
        while True:
            apart = np.where(pairs[:, order], distances[:, order], np.inf)
            apart[order] = np.inf
            if not np.isfinite(apart).any():
                break
            marker = int(apart.min(axis=1).argmin())
            near.append(np.argsort(apart[marker], kind="stable")[: int(np.isfinite(apart[marker]).sum())])
            order.append(marker)
        self.markers, self._near = np.array(order), near
        self.chosen, self.edges, self.costs = np.ones((1, len(order)), np.int64), np.zeros((1, 1)), np.zeros(1)
        self.places = points[None, self.markers]

    def advance(self, at: Candidates, same: Array, unseen: float) -> None:
        """Finds the configurations of the next frame.

        Args:
            at: Candidates of all markers.
            same: Distance within which two candidates of a marker are one place [px]. Shape (M,).
            unseen: Cost of a marker that isn't seen.
        """
        found, costs = self._searched(at, unseen)
        kept: list[int] = []
        for i in np.argsort(costs, kind="stable").tolist():
            if len(kept) == KEPT or costs[i] > costs.min() + FAR:
                break
            if all(self._differs(at, found[i], found[k], same) for k in kept):
                kept.append(i)
        before, chosen = len(self.costs), found[kept]
        beam = self._begun(np.repeat(np.arange(2 * before), len(kept)))
        for k in range(len(self.markers)):
            added = self._added(at, beam, k, unseen)
            beam = beam.taken(at, np.arange(len(beam.costs)), np.tile(chosen[:, k], 2 * before), added, k)
        self.edges = self._ended(at, beam).reshape(before, 2, len(kept)).min(axis=1)
        paths = self.costs[:, None] + self.edges
        last = self.places[paths.argmin(axis=0)]
        self.chosen, self.costs = chosen, paths.min(axis=0) - paths.min()
        self.places = at.places[self.markers, chosen]
        for k in range(len(self.markers)):  # in their order, so that what is near is placed first
            hidden = chosen[:, k] == 0
            there, sigmas = self._shaped(self.places, chosen > 0, last, k)
            self.places[hidden, k] = np.where(np.isfinite(sigmas)[:, None], there, self.places[:, k])[hidden]

    def open(self, moves: Array, before: Index, now: Index) -> None:
        """Lets markers go the ways of their body, which pays for them. `moves`: (M, B, C); places taken: (K, n)."""
        for one in before:
            for other in now:
                both = (one > 0) & (other > 0)
                steps = self.markers[both], one[both], other[both]
                moves[steps] = np.minimum(moves[steps], 0.0)

    def _begun(self, ways: Index) -> _Beam:
        """Empty ones, by the ways there from each configuration before: by flow and by the last steps. Shape (N,)."""
        count = len(self.markers)
        places = np.zeros((len(ways), count, 2))
        return _Beam(
            np.stack(np.divmod(ways, 2), axis=1), np.zeros(len(ways)), np.zeros(places.shape[:2], np.int64), places,
            self.markers,
        )  # fmt: skip

    def _searched(self, at: Candidates, unseen: float) -> tuple[Index, Array]:
        """Configurations and their costs. Shapes (N, n), (N,)."""
        beam = self._begun(np.arange(2 * len(self.costs)))
        beam = beam._replace(costs=self.costs[beam.ways[:, 0]])
        group = np.arange(len(beam.costs))
        for k in range(len(self.markers)):
            added = self._added(at, beam, k, unseen)
            total = beam.costs[:, None] + added
            rows, columns = np.nonzero(total < total.min() + FAR)
            order = np.argsort(total[rows, columns], kind="stable")
            rows, columns = rows[order], columns[order]
            groups = group[rows] if k else rows * total.shape[1] + columns
            best = _ranks(groups) < BEAM
            group = groups[best]
            beam = beam.taken(at, rows[best], columns[best], added, k)
        return beam.chosen, self._ended(at, beam)

    def _added(self, at: Candidates, beam: _Beam, k: int, unseen: float) -> Array:
        """What each candidate of the next marker adds to the cost. Shape (N, C)."""
        marker, before = int(self.markers[k]), self.chosen[beam.ways[:, 0], k]
        places, way = at.places[marker], beam.ways[:, 1]
        near, others = self._near[k], self.markers[self._near[k]]
        seen = beam.chosen[:, near] > 0
        stretch = np.linalg.norm(places[:, None] - beam.places[:, None, near], axis=3) - at.distances[marker, others]
        apart = np.minimum(stretch**2 / (2 * at.variances[marker, others]), TOLD)
        weights = np.minimum(1.0, WITNESSES / np.maximum(seen.sum(axis=1), 1))
        apart = (apart * seen[:, None]).sum(axis=2) * weights[:, None]
        foreseen, sigmas = self._shaped(beam.places, beam.chosen > 0, self.places[beam.ways[:, 0]], k)
        strange = ((places - foreseen[:, None]) ** 2).sum(axis=2) / (2 * sigmas[:, None] ** 2)
        known = (beam.chosen[:, :k] > 0) & (self.chosen[beam.ways[:, 0], :k] > 0)
        first = ((before > 0) & ~known.any(axis=1))[:, None]
        flowed = at.moves[0, marker, before] - at.moves[0, marker, before].min(axis=1, keepdims=True)
        alone = at.moves[1, marker, before] + np.where(way[:, None] == 0, flowed, ALIASED)
        added = at.costs[marker] + apart + np.minimum(strange, TOLD) + np.where(first, alone, 0.0)
        gap = np.linalg.norm(places[:, None] - beam.places[:, None, :k], axis=3)
        taken = (gap < APART * (at.radii[marker] + at.radii[self.markers[:k]])) & (beam.chosen[:, None, :k] > 0)
        added += np.where(taken.any(axis=2), TAKEN, 0.0)
        added[:, 0] = unseen
        return added

    def _shaped(self, places: Array, seen: Mask, last: Array, k: int) -> tuple[Array, Array]:
        """Where the two nearest of the markers that are placed put another, by the shape of the last frame.

        Args:
            places: Of what is placed [px]. Shape (N, n, 2).
            seen: Whether it is. Shape (N, n).
            last: The shape [px]. Shape (N, n, 2).
            k: The other marker.

        Returns:
            Its places [px], shape (N, 2), and their standard deviations [px], inf where none is placed, shape (N,).
        """
        near, rows = self._near[k], np.arange(len(places))
        before, now = last[..., 0] + 1j * last[..., 1], places[..., 0] + 1j * places[..., 1]
        if not len(near):
            return last[:, k], np.full(len(places), np.inf)
        rank = np.cumsum(seen[:, near], axis=1)
        one, other = near[(rank == 1).argmax(axis=1)], near[(rank == 2).argmax(axis=1)]
        way = before[:, k] - before[rows, one]
        across = before[rows, other] - before[rows, one]
        turn = (now[rows, other] - now[rows, one]) / np.where(across == 0, 1.0, across)
        two = (rank[:, -1] > 1) & (across != 0)
        foreseen = now[rows, one] + np.where(two, turn, 1.0) * way
        sigmas = NOISE + np.where(two, BEND, TURN) * np.abs(way)
        return np.stack([foreseen.real, foreseen.imag], axis=1), np.where(rank[:, -1] > 0, sigmas, np.inf)

    def _ended(self, at: Candidates, beam: _Beam) -> Array:
        """Costs of what is complete: one marker that appears anew pays where none was there before. Shape (N,)."""
        seen = beam.chosen > 0
        anew = seen.any(axis=1) & ~(seen & (self.chosen[beam.ways[:, 0]] > 0)).any(axis=1)
        first = seen.argmax(axis=1)
        appears = at.moves[1, self.markers[first], 0, beam.chosen[np.arange(len(first)), first]]
        return beam.costs + np.where(anew, appears, 0.0)

    def _differs(self, at: Candidates, one: Index, other: Index, same: Array) -> bool:
        """Whether most of the markers that both have are elsewhere."""
        both = (one > 0) & (other > 0)
        m = self.markers[both]
        away = np.linalg.norm(at.places[m, one[both]] - at.places[m, other[both]], axis=1) > same[m]
        return bool(away.sum() > len(away) / 2)


def said(shape: tuple[int, int], bodies: Iterable[tuple[Index, Index, Array]]) -> tuple[Array, Array]:
    """What bodies say of the candidates of their markers.

    Args:
        shape: Numbers M of markers and C of candidates.
        bodies: Of each the indices of its markers, shape (n,), the candidate of each of these in each configuration,
            shape (K, n), and the cost of each configuration, shape (K,).

    Returns:
        Cost of each candidate, and its margin at most: how much more any configuration costs in which the marker is
        elsewhere. Shapes (M, C) each.
    """
    costs, margins = np.zeros(shape), np.full(shape, np.inf)
    for markers, chosen, paths in bodies:
        paths = paths - paths.min()
        costs[markers] = BESIDE
        for k in np.argsort(-paths, kind="stable"):
            hidden = chosen[k] == 0
            costs[markers[hidden]] = np.minimum(costs[markers[hidden]], paths[k])
            costs[markers, chosen[k]] = paths[k]
            others = np.where(chosen != chosen[k], paths[:, None], np.inf).min(axis=0)
            margins[markers, chosen[k]] = others - paths[k]
    return costs, margins


class _Beam(NamedTuple):
    """Configurations that are being made.

    Attributes:
        ways: Configuration of the frame before that each comes from, and whether its flow isn't believed. Shape (N, 2).
        costs: Shape (N,).
        chosen: Shape (N, n).
        places: Of what was chosen [px]. Shape (N, n, 2).
        markers: Indices of the markers. Shape (n,).
    """

    ways: Index
    costs: Array
    chosen: Index
    places: Array
    markers: Index

    def taken(self, at: Candidates, rows: Index, columns: Index, added: Array, k: int) -> _Beam:
        """Some of them (rows) with candidates of the next marker (columns); of one column, all take that."""
        chosen, places = self.chosen[rows], self.places[rows]
        chosen[:, k], places[:, k] = columns, at.places[self.markers[k], columns]
        return _Beam(self.ways[rows], self.costs[rows] + added[rows, columns], chosen, places, self.markers)


def _ranks(groups: Index) -> Index:
    """How many of the same group are before each. Shape (N,)."""
    order = np.argsort(groups, kind="stable")
    begins = np.r_[True, np.diff(groups[order]) != 0]
    ranks = np.empty(len(groups), dtype=np.int64)
    ranks[order] = np.arange(len(groups)) - np.maximum.accumulate(np.where(begins, np.arange(len(groups)), 0))
    return ranks
