"""Least squares by somebody else's solver, which takes a function and comes back when it is done."""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swimbase.errors import OptimizerError

Residuals = Callable[[Array], Array]
"""Points of the unit cube to their residuals. Shape (k, d) to (k, n)."""
Solve = Callable[[Array, Residuals], None]
"""A solver, given its start, shape (d,), and the function. With the same results it must make the same calls."""


class CallbackSolver(Optimizer):
    """Asks for what a solver calls for, and starts it again at a random point when it is done.

    A function can't be left in the middle of a call and gone on with later. So the solver is begun anew for every call:
    it is given the residuals of its earlier calls once more, in order, and the call after them holds the next
    candidates. That costs the solver's own arithmetic again and no evaluation, leaves no thread behind, and is what a
    resumed run does anyway.

    What the solver knows is the residual. A failed evaluation has one, too, and counts as any other.
    """

    needs_residual = True

    def __init__(self, first: Array, rng: np.random.Generator, solve: Solve, name: str) -> None:
        """Prepares the search.

        Args:
            first: First point of the run. Shape (d,).
            rng: Generator of further starts.
            solve: The solver.
            name: Name of the solver in the record.
        """
        super().__init__(len(first))
        self._first_point, self._rng, self._solve, self._name = cube_point(first), rng, solve, name
        self._search = self._starts()
        self._last_residual: Array | None = None

    def _next(self) -> Candidate:
        return next(self._search) if self._last_residual is None else self._search.send(self._last_residual)

    def _learn(self, evaluation: Evaluation) -> None:
        if evaluation.residual is None:
            raise OptimizerError(f"tell() got an evaluation without a residual, which {self._name} needs")
        self._last_residual = evaluation.residual

    def _starts(self) -> Generator[Candidate, Array, None]:
        point, start = self._first_point, 1
        while True:
            calls: list[Array] = []
            while (points := self._next_call(point, calls)) is not None:
                residuals: list[Array] = []
                for solver_point in points:
                    note = {"source": self._name, "start": start, "call": len(calls) + 1}
                    if start == 1 and not calls and not residuals:
                        note = {"source": "first point"}
                    residuals.append((yield Candidate(cube_point(np.clip(solver_point, 0.0, 1.0)), note)))
                calls.append(np.stack(residuals))
            point, start = self._rng.random(self.dimension), start + 1

    def _next_call(self, first: Array, answers: list[Array]) -> Array | None:
        """Points of the solver's first call beyond those answered, shape (k, d); None when it is done without one."""
        left = iter(answers)

        def residuals(points: Array) -> Array:
            answer = next(left, None)
            if answer is None:
                raise _UnansweredError(points)
            return answer

        try:
            self._solve(first, residuals)
        except _UnansweredError as call:
            return call.points
        return None


class _UnansweredError(Exception):
    """Leaves the solver at a call that nothing is known for."""

    def __init__(self, points: Array) -> None:
        super().__init__()
        self.points = np.array(points)
