"""Longer time steps for evaluations in which an error of some percent doesn't matter, chosen by measuring.

Which steps a robot bears depends on its parameters: joints that are stiff or hardly damped need short ones. So the
first of such evaluations are made with the model's own step and with a longer one, and later one of a dozen in large
batches. As soon as one differs, the next shorter step is tried, at last the model's own. What diverges is made again
with that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from swim2real.calibration.problem import Problem
from swim2real.objective import Comparison
from swim2real.parameters import Values

_FACTORS = (2.0, 1.5)  # of the model's own step
_SURE = 8  # evaluations that must agree first
_SELDOM = 12  # of which one is checked later
_ALIKE = 0.05  # of the residual's length, by which it may change


class CoarseSteps:
    """Evaluates batches of candidates, those that may be coarse with as long a step as the robot bears.

    The step depends on the evaluations so far alone, so a run that is replayed has the same.
    """

    def __init__(self, problem: Problem) -> None:
        self._own, self._longer = problem, [problem.with_longer_step(factor) for factor in _FACTORS]
        self._agreed = 0

    def evaluate(self, candidates: Sequence[Values], coarse: Sequence[bool]) -> Iterator[tuple[Comparison, bool]]:
        """Comparisons in their order, each as soon as it is there, and whether it has a longer step.

        Args:
            candidates: Values of each.
            coarse: Which may be coarse.
        """
        longer = self._longer[0] if self._longer else None
        allowed = [number for number, may in enumerate(coarse) if may and longer is not None]
        checked = allowed[: max(_SURE - self._agreed, len(allowed) // _SELDOM)]
        jobs: list[tuple[Problem, Values]] = []
        for number, values in enumerate(candidates):
            if number in checked or number not in allowed or longer is None:
                jobs.append((self._own, values))
            if number in allowed and longer is not None:
                jobs.append((longer, values))
        made = self._own.evaluate_jobs(jobs)
        for number, values in enumerate(candidates):
            comparison = next(made)
            if number in checked:
                self._learn(longer, _alike(comparison, next(made)))
            is_coarse = number in allowed and number not in checked
            if is_coarse and comparison.divergence is not None:
                comparison, is_coarse = self._own.evaluate(values), False
            yield comparison, is_coarse

    def _learn(self, longer: Problem | None, alike: bool) -> None:
        """Counts a check of a step, or drops the step; the rest of a batch is as it was planned."""
        if not self._longer or self._longer[0] is not longer:
            return
        self._agreed += 1
        if not alike:
            self._longer, self._agreed = self._longer[1:], 0


def _alike(own: Comparison, coarse: Comparison) -> bool:
    if own.divergence is not None:
        return True
    if coarse.divergence is not None:
        return False
    vector = own.residual_vector()
    return float(np.linalg.norm(coarse.residual_vector() - vector)) <= _ALIKE * float(np.linalg.norm(vector))
