"""CMA-ES in the unit cube, by pycma: the evolution strategy of the paper's table."""

from __future__ import annotations

from typing import Any

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swimbase.errors import MissingExtraError, OptimizerError


class CmaEs(Optimizer):
    """Generations of candidates around a mean that moves, from a random start of its own.

    pycma learns from a generation when all of it is evaluated, so nothing from one that the budget cuts off: 40
    evaluations with a population of 12 are three generations and four candidates. Failed evaluations take part with
    their loss. When pycma ends a search (converged, or all losses equal) another one begins at a new random mean.
    """

    def __init__(self, dimension: int, rng: np.random.Generator, population: int = 12, sigma: float = 0.2) -> None:
        """Prepares the search.

        Args:
            dimension: Dimension of the unit cube, at least 2.
            rng: Generator of the starts and all samples. NumPy's global stream is neither read nor seeded.
            population: Candidates of a generation; 12 is pycma's own for 16 parameters.
            sigma: Standard deviation of the first generation, in the unit cube.

        Raises:
            OptimizerError: A setting is out of range.
            MissingExtraError: pycma isn't installed.
        """
        super().__init__(dimension)
        if dimension < 2:
            raise OptimizerError(f"dimension is {dimension}; CMA-ES needs at least 2")
        if population < 4:
            raise OptimizerError(f"population is {population}; it must be at least 4")
        if not 0 < sigma <= 1:
            raise OptimizerError(f"sigma is {sigma}; it must be above 0 and at most 1")
        self._rng, self._population, self._sigma = rng, population, sigma
        self._start, self._generation = 1, 1
        self._strategy = self._begin()
        self._samples: list[Array] = []
        self._losses: list[float] = []

    def _next(self) -> Candidate:
        if not self._samples:
            self._samples = self._strategy.ask()
        number = len(self._losses)
        note = {
            "source": "CMA-ES", "generation": self._generation, "number": number + 1, "start": self._start,
        }  # fmt: skip
        return Candidate(cube_point(np.clip(self._samples[number], 0.0, 1.0)), note)

    def _learn(self, evaluation: Evaluation) -> None:
        self._losses.append(evaluation.loss)
        if len(self._losses) < self._population:
            return
        self._strategy.tell(self._samples, self._losses)
        self._samples, self._losses = [], []
        self._generation += 1
        if self._strategy.stop():
            self._start += 1
            self._strategy = self._begin()

    def _begin(self) -> Any:
        try:
            import cma
        except ImportError as error:
            raise MissingExtraError(
                "method cma-es needs pycma; install it with: pip install 'swim2real[compare]'"
            ) from error
        options = {
            "bounds": [0, 1],
            "popsize": self._population,
            "seed": float("nan"),  # any other value seeds NumPy's global stream, 0 from the clock
            "randn": lambda *shape: self._rng.standard_normal(shape),
            "signals_filename": "",  # or a file in the working folder could change a run
            "verbose": -9,
        }
        return cma.CMAEvolutionStrategy(self._rng.random(self.dimension), self._sigma, options)
