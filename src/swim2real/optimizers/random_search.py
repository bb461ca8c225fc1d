"""Random search: uniform in the unit cube."""

from __future__ import annotations

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point


class RandomSearch(Optimizer):
    """The first point where one is given, then uniform samples."""

    def __init__(self, dimension: int, rng: np.random.Generator, first: Array | None = None) -> None:
        super().__init__(dimension)
        self._first = None if first is None else cube_point(first, dimension)
        self._rng = rng

    def _next(self) -> Candidate:
        if self._first is not None:
            point, self._first = self._first, None
            return Candidate(point, {"source": "first point"})
        return Candidate(cube_point(self._rng.random(self.dimension)), {"source": "random"})

    def _learn(self, evaluation: Evaluation) -> None:
        """Random search learns nothing."""
