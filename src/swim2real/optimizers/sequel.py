"""Finishes what another optimizer began: after a number of evaluations the next one goes on from the best of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer
from swimbase.errors import OptimizerError


class Sequel(Optimizer):
    """One optimizer for its budget, then another one, which is made with the best point so far."""

    needs_residual = True

    def __init__(self, first: Optimizer, budget: int, then: Callable[[Array], Optimizer]) -> None:
        """Prepares both.

        Args:
            first: The optimizer that begins.
            budget: Its evaluations.
            then: Makes the other one from the best point. Shape (d,).
        """
        super().__init__(first.dimension)
        self._current, self._left, self._then = first, budget, then
        self._best: Evaluation | None = None

    @property
    def ends(self) -> Sequence[float]:
        return self._current.ends

    def upcoming(self) -> Sequence[Candidate]:
        return () if self._left else self._current.upcoming()

    def _next(self) -> Candidate:
        return self._current.ask()

    def _learn(self, evaluation: Evaluation) -> None:
        self._current.tell(evaluation)
        self.done = not self._left and self._current.done
        if not self._left:
            return
        self._left -= 1
        if not evaluation.failed and (self._best is None or evaluation.loss < self._best.loss):
            self._best = evaluation
        if not self._left:
            if self._best is None:
                raise OptimizerError("every evaluation so far has failed, so there is nothing to go on from")
            self._current = self._then(self._best.candidate.point)
