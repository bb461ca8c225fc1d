"""Ways through the pixels of a mask, by Dijkstra's algorithm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from markertrack.tracking.tracker import Array, Mask


class Grid:
    """Pixels of a mask, each beside up to eight others.

    Attributes:
        places: Where they are, x and y [px]. Shape (N, 2).
    """

    def __init__(self, mask: Mask) -> None:
        rows, columns = np.nonzero(mask)
        self.places: NDArray[np.int64] = np.stack([columns, rows], axis=1)
        number = np.full((mask.shape[0] + 2, mask.shape[1] + 2), -1)
        number[rows + 1, columns + 1] = np.arange(len(rows))
        first: list[NDArray[np.int64]] = []
        second: list[NDArray[np.int64]] = []
        steps: list[Array] = []
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            other = number[rows + 1 + down, columns + 1 + right]
            one = np.flatnonzero(other >= 0)
            first.append(one)
            second.append(other[one])
            steps.append(np.full(len(one), np.hypot(down, right)))
        self._first, self._second, self._steps = np.concatenate(first), np.concatenate(second), np.concatenate(steps)

    def nearest(self, place: Array) -> int:
        """Number of the pixel nearest to a place (2,)."""
        return int(np.hypot(*(self.places - place).T).argmin())

    def away(self, sources: NDArray[np.int64] | list[int]) -> Array:
        """Length of the way through the mask to each pixel from the nearest of some; inf where there is none [px]."""
        return np.asarray(dijkstra(self._graph(None), directed=False, indices=sources, min_only=True))

    def paths(self, source: int, targets: list[int], costs: Array) -> list[NDArray[np.int64]]:
        """Numbers of the pixels on the cheapest ways from one to others, by the cost of a step in each. Shapes (K,)."""
        _, before = dijkstra(self._graph(costs), directed=False, indices=[source], return_predecessors=True)
        found: list[NDArray[np.int64]] = []
        for target in targets:
            path = [target]
            while path[-1] != source and before[0, path[-1]] >= 0:
                path.append(int(before[0, path[-1]]))
            found.append(np.array(path[::-1]))
        return found

    def path(self, source: Array, target: Array, costs: Array) -> NDArray[np.int64]:
        """Pixels of the cheapest way from one place (2,) to another. Shape (K, 2)."""
        return self.places[self.paths(self.nearest(source), [self.nearest(target)], costs)[0]]

    def _graph(self, costs: Array | None) -> csr_matrix:
        count = len(self.places)
        weights = self._steps if costs is None else self._steps * (costs[self._first] + costs[self._second]) / 2
        return csr_matrix(coo_matrix((weights, (self._first, self._second)), shape=(count, count)))
