"""What a flexible body tells of the markers along it: their order, and their distances, which change little.

Nothing else connects them, so flow follows them (`markers`). Of those that flow doesn't carry on the chain
tells where they may be, which spots they are, and what can't be one of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.rigid import rigid_fit
from markertrack.tracking.tracker import RATE, Array, Mask

LINK_SHARE = 0.2  # by which the distance of neighbors, and of next neighbors, may be off
BENT = 2 / np.pi  # of the way along the body, by which two of its markers are apart at least: it is half a circle
SLACK = 0.15, 1.0, 0.05  # of a radius, px, and of a step, by which a length may be off in any case


class Chain:
    """Lengths along a body: of neighbors and next neighbors, (i, i + 1) and (i, i + 2) in turns.

    A strain is how far a length is off, 1 at what is allowed.

    Attributes:
        slack: By how much a length may be off in any case [px].
    """

    def __init__(self, places: Array, linked: bool = True) -> None:
        """Takes the markers' places in the first frame (M, 2) [px], and whether anything connects them."""
        self._count, self.linked = len(places), linked
        ends = [(i, j) for i in range(self._count) for j in (i + 1, i + 2) if linked and j < self._count]
        self._pairs = np.array(ends, dtype=np.int64).reshape(-1, 2)
        self._lengths, self.slack = self._distances(places), SLACK[1]
        self._shapes = np.repeat(places[None], self._count, axis=0)  # all markers when each was last seen

    def learn(self, positions: Array, radius: float, step: float) -> None:
        """Takes in markers that are known (M, 2), NaN of others; their radius, and how far they go in a frame [px]."""
        self._lengths += RATE * np.nan_to_num(self._distances(positions) - self._lengths)
        self.slack = SLACK[0] * radius + SLACK[1] + SLACK[2] * step
        known = np.isfinite(positions[:, 0])
        self._shapes[known] = self.filled(positions, positions)

    def filled(self, positions: Array, otherwise: Array) -> Array:
        """Positions (M, 2), NaN ones where the body had them when they were last seen, carried by the nearest.

        Where nothing tells, they are as given otherwise (M, 2).
        """
        known = np.isfinite(positions[:, 0])
        if not (self.linked and known.any()):
            return np.where(known[:, None], positions, otherwise)
        out = positions.copy()
        for m in np.flatnonzero(~known):
            shape = self._shapes[m]
            away = np.linalg.norm(shape - shape[m], axis=1)
            near = np.median(np.sort(away)[1:3])
            out[m] = rigid_fit(shape, positions, 1 / (1 + (away / near) ** 2) ** 2)[m]
        return out

    def reaches(self, far: Array, known: Mask) -> Array:
        """How far from where it is filled in each marker may be, as others are known [px]. Shape (M,).

        As far as it may go by itself (M,), and the body may bend up to it; but both places are no farther from one that
        is known than the body is long between them.
        """
        if not (self.linked and known.any()):
            return far
        along = np.concatenate([[0.0], np.cumsum(self._lengths[0::2])])
        way = np.abs(along[:, None] - along[known]).min(axis=1)
        return np.minimum(far + LINK_SHARE * way, 2 * way + self.slack)

    def closest(self, radii: Array) -> Array:
        """How near two markers are at one place: a mean radius, or half of their usual distance [px]. Shape (M, M)."""
        out, (a, b) = (radii[:, None] + radii) / 2, self._pairs.T
        out[a, b] = out[b, a] = np.minimum(out[a, b], self._lengths / 2)
        return out

    def fit(self, costs: Array, spots: Array) -> tuple[NDArray[np.int64], Array]:
        """Gives the markers spots in the order of the body, so that few are left out and lengths are strained little.

        Args:
            costs: Of each marker at each spot, where leaving one out costs 1, as does a length that is off by all it
                may be. Shape (M, P).
            spots: Their places [px]. Shape (P, 2).

        Returns:
            Index of each marker's spot, -1 for none, and how much more it costs to explain all otherwise: with another
            spot for it, or another marker for its spot. Shapes (M,) twice.
        """
        away = np.linalg.norm(spots[:, None] - spots, axis=2)
        strains = {(i, j): self._strain_between(i, j, away) for j in range(self._count) for i in range(j)}
        order = list(range(self._count))
        forth, came = _ways(costs, strains, order)
        back, _ = _ways(costs, strains, order[::-1])
        total = forth + back - costs
        ends = forth + np.arange(self._count - 1, -1, -1)[:, None]
        m, p = (int(i) for i in np.unravel_index(int(np.argmin(ends)), ends.shape))
        chosen, margins, best = np.full(self._count, -1), np.zeros(self._count), float(ends[m, p])
        while m >= 0 and best < self._count:
            chosen[m] = p
            m, p = (int(i) for i in came[m, p])
        for m in np.flatnonzero(chosen >= 0):
            others = np.concatenate([np.delete(total[m], chosen[m]), np.delete(total[:, chosen[m]], m)])
            margins[m] = others.min(initial=np.inf) - best
        return chosen, margins

    def strained(self, positions: Array) -> Mask:
        """Markers that have to go until all lengths along the body are as usual, at positions (M, 2). Shape (M,)."""
        strain, links = self._strain(positions), self._pairs
        out = np.zeros(self._count, dtype=bool)
        while True:
            alive = ~out[links].any(axis=1) & (strain > 1)
            if not alive.any():
                return out
            badness, support = np.zeros((2, self._count))
            np.add.at(badness, links[alive].ravel(), np.repeat(strain[alive], 2))
            sound = ~out[links].any(axis=1) & (strain <= 1)
            np.add.at(support, links[sound].ravel(), 1.0)
            out[int(np.argmax(np.where(badness > 0, badness / (1 + support), -1.0)))] = True

    def vouched(self, positions: Array, known: Mask) -> Mask:
        """Markers that reappeared where others vouch for them. Shape (M,).

        A marker that was seen a moment ago vouches for one that reappears next to it at the right distance, and so on
        along the body. Without any, most of the body must reappear at once.

        Args:
            positions: NaN for markers that aren't seen [px]. Shape (M, 2).
            known: Whether each was seen in the last frame. Shape (M,).
        """
        seen, strain = np.isfinite(positions[:, 0]), self._strain(positions)
        sure, (a, b) = seen & known, self._pairs.T
        if not self.linked:
            return np.zeros_like(seen)
        if not sure.any():
            sound = seen.copy()
            sound[a[strain > 1]] = sound[b[strain > 1]] = False
            return sound & (2 * sound.sum() > len(sound))
        good, bad = strain <= 1, strain > 1
        while True:
            vouched, refused = np.zeros_like(seen), np.zeros_like(seen)
            for end, other in ((a, b), (b, a)):
                vouched[end[good & sure[other] & seen[end]]] = True
                refused[end[bad & sure[other] & seen[end]]] = True
            more = vouched & ~refused & ~sure
            if not more.any():
                return sure
            sure |= more

    @property
    def _allowed(self) -> Array:
        """By how much each length may be off: one over a joint by what the shorter arm may turn [px]. Shape (L,)."""
        out, arms = self._lengths.copy(), self._lengths[0::2]
        out[1::2] = 2 * np.minimum(arms[:-1], arms[1:])
        return LINK_SHARE * out + self.slack

    def _strain(self, positions: Array) -> Array:
        """Strain of each length, 0 where one end isn't seen. Shape (L,)."""
        off = np.abs(self._distances(positions) - self._lengths)
        return np.nan_to_num(off / self._allowed)

    def _strain_between(self, before: int, m: int, away: Array) -> Array:
        """Squared strain of two markers' spots, with none for the markers between. Shape (P, P)."""
        if m - before <= 2:
            pair = 2 * before + (m - before - 1)
            return np.minimum(((away - self._lengths[pair]) / self._allowed[pair]) ** 2, 1e3)
        way = float(self._lengths[0::2][before:m].sum())
        off = away - np.clip(away, BENT * way, way)
        return np.minimum((off / (LINK_SHARE * way + self.slack)) ** 2, 1e3)

    def _distances(self, points: Array) -> Array:
        return np.linalg.norm(points[self._pairs[:, 0]] - points[self._pairs[:, 1]], axis=1)


def _ways(costs: Array, strains: dict[tuple[int, int], Array], order: list[int]) -> tuple[Array, NDArray[np.int64]]:
    """Least cost of markers up to each at each spot, taken in an order, and marker and spot before it.

    By dynamic programming. Shapes (M, P), (M, P, 2).
    """
    count, number = costs.shape
    best, came = costs.copy(), np.full((count, number, 2), -1)
    for k, m in enumerate(order):
        best[m] += k
        for skipped, before in enumerate(order[:k][::-1]):
            step = best[before][:, None] + strains[min(before, m), max(before, m)] + skipped
            np.fill_diagonal(step, np.inf)
            source = step.argmin(axis=0)
            cost = step[source, np.arange(number)] + costs[m]
            better = cost < best[m]
            best[m] = np.where(better, cost, best[m])
            came[m, better] = np.stack([np.full(number, before), source], axis=1)[better]
    return best, came
