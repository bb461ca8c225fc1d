"""Least squares: Gauss-Newton steps on the residual within a box of trust; finite differences are candidates, too.

Sums over the residual avoid BLAS, whose order of summation hangs on the number of threads.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from scipy.optimize import lsq_linear

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swimbase.errors import OptimizerError

_DAMPING = 1e-3  # of the mean curvature: parameters without effect stay where they are
_CONVERGED = 1e-3  # promised relative gain below which a start is given up
_SMALLEST_RADIUS = 5e-3
_NEW_JACOBIAN_TRIES, _OLD_JACOBIAN_TRIES = 6, 2  # steps in a row that may gain nothing

Search = Generator[Candidate, Evaluation, None]


class LeastSquares(Optimizer):
    """Goes down from the first point, then from random ones, by linear models of the residual.

    A Jacobian costs an evaluation a parameter: forward differences, away from the nearer bound, as candidates that
    count. Each step minimizes the linear model's squares within the cube and within a box around the best point of this
    start; the box shrinks and grows with what the steps gain against what the model promised. Between Jacobians the
    model learns from every step (Broyden's update), so that one Jacobian serves several; a new one is taken when two
    steps in a row gain nothing. A start has converged when the model promises less than a thousandth or a fresh
    Jacobian's steps gain nothing; the next start is random. A difference that turns out better than its base takes the
    base's place.

    A parameter whose difference failed stays put until the next Jacobian; a step that failed only shrinks the box.
    What is minimized is the residual's squared norm, not the loss, whose lowest value the run keeps all the same.

    Why not `scipy.optimize.least_squares` itself: its reflective steps shun the bounds, and from the published tracks'
    seed 0 (logarithmic scale, aligned) it was at 207 mm after 60 evaluations, with a Jacobian for each of its short
    steps, and this one at 30 mm. It also takes the residual of a simulation that diverged for a fact, as
    `mujoco.sysid` does, which is a method of its own.

    Differences are wide since the residual changes fast near good fits: there, steps of 0.004 in the cube changed the
    loss by 5 mm. Where it is smooth they cost precision at the end. Which width is best isn't settled: on that one seed
    0.05 led after 60 evaluations (30 mm, with 0.02 35 mm) and 0.02 after 80 (17 mm against 23 mm).
    """

    needs_residual = True

    def __init__(self, first: Array, rng: np.random.Generator, difference: float = 0.05, radius: float = 0.3) -> None:
        """Prepares the search.

        Args:
            first: First point of the run. Shape (d,).
            rng: Generator of further starts.
            difference: Step of the finite differences, in the unit cube.
            radius: Radius of the box of trust at every start: the farthest that a parameter goes in one step.

        Raises:
            OptimizerError: A setting is out of range.
        """
        super().__init__(len(first))
        if not 0 < difference <= 0.5:
            raise OptimizerError(f"difference is {difference}; it must be above 0 and at most 0.5")
        if not 0 < radius <= 1:
            raise OptimizerError(f"radius is {radius}; it must be above 0 and at most 1")
        self._first_point, self._rng = cube_point(first), rng
        self._difference, self._radius = difference, radius
        self._search = self._starts()
        self._last: Evaluation | None = None

    def _next(self) -> Candidate:
        return next(self._search) if self._last is None else self._search.send(self._last)

    def _learn(self, evaluation: Evaluation) -> None:
        if evaluation.residual is None and not evaluation.failed:
            raise OptimizerError("tell() got an evaluation without a residual, which least squares needs")
        self._last = evaluation

    def _starts(self) -> Search:
        start = 1
        evaluation = yield Candidate(self._first_point, {"source": "first point"})
        while True:
            if not evaluation.failed:
                yield from self._descend(evaluation, start)
            start += 1
            evaluation = yield Candidate(
                cube_point(self._rng.random(self.dimension)), {"source": "start", "start": start}
            )

    def _descend(self, base: Evaluation, start: int) -> Search:
        radius = self._radius
        while True:
            gradients, best = yield from self._differences(base, start)
            useful, failures = best is not base, 0
            base = best
            while failures < (_OLD_JACOBIAN_TRIES if useful else _NEW_JACOBIAN_TRIES):
                residual, squares = _residual(base), _squares(base)
                step, promised = box_step(gradients, residual, base.candidate.point, radius, _DAMPING)
                if promised <= _CONVERGED * squares or radius < _SMALLEST_RADIUS:
                    break
                point = cube_point(np.clip(base.candidate.point + step, 0.0, 1.0))
                evaluation = yield Candidate(point, {"source": "step", "start": start, "radius": radius})
                gained = -np.inf
                if not evaluation.failed:
                    gained = squares - _squares(evaluation)
                    gradients = updated(gradients, _residual(evaluation) - residual, point - base.candidate.point)
                if gained < 0.25 * promised:
                    radius = float(np.abs(step).max()) / 2
                elif gained > 0.75 * promised:
                    radius = min(2 * radius, 1.0)
                failures = 0 if gained > 0 else failures + 1
                if gained > 0:
                    base, useful = evaluation, True
            if not useful:
                return

    def _differences(self, base: Evaluation, start: int) -> Generator[Candidate, Evaluation, tuple[Array, Evaluation]]:
        """Change of the residual with each parameter, 0 where it isn't known (d, n); and the best point on the way."""
        residual, best = _residual(base), base
        gradients = np.zeros((self.dimension, residual.size))
        for k in range(self.dimension):
            point = np.array(base.candidate.point)
            change = self._difference if point[k] <= 0.5 else -self._difference
            point[k] += change
            evaluation = yield Candidate(cube_point(point), {"source": "difference", "parameter": k, "start": start})
            if not evaluation.failed:
                gradients[k] = (_residual(evaluation) - residual) / change
                best = evaluation if _squares(evaluation) < _squares(best) else best
        return gradients, best


def _squares(evaluation: Evaluation) -> float:
    residual = _residual(evaluation)
    return float(np.einsum("n,n->", residual, residual))


def _residual(evaluation: Evaluation) -> Array:
    if evaluation.residual is None:
        raise OptimizerError("an evaluation has no residual, which least squares needs")
    return evaluation.residual


def updated(gradients: Array, change: Array, step: Array) -> Array:
    """Broyden's update: the smallest change of the gradients with which the model explains a change of the residual.

    Along a single coordinate it replaces that coordinate's gradient by the difference quotient.

    Args:
        gradients: Gradients of the residual, by coordinate. Shape (d, n).
        change: Change of the residual over the step. Shape (n,).
        step: Step in the unit cube; nothing is learned from a step of length zero. Shape (d,).
    """
    length = float(step @ step)
    if length == 0:
        return gradients
    unexplained = change - np.einsum("in,i->n", gradients, step)
    return gradients + np.multiply.outer(step, unexplained) / length


def box_step(gradients: Array, residual: Array, point: Array, radius: float, damping: float) -> tuple[Array, float]:
    """The step that minimizes the model's squares within the box and the cube, and the gain that the model promises.

    Sums of squares of the residual are the measure of the gain.

    Args:
        gradients: Gradients of the residual, by coordinate. Shape (d, n).
        residual: Residual at the point. Shape (n,).
        point: Point of the unit cube. Shape (d,).
        radius: Radius of the box around the point.
        damping: Share of the mean curvature that is added: coordinates without effect stay where they are.
    """
    curvature = np.einsum("in,jn->ij", gradients, gradients)
    slope = np.einsum("in,n->i", gradients, residual)
    damping = damping * float(np.trace(curvature)) / point.size
    if damping == 0:
        return np.zeros(point.size), 0.0
    bounds = (np.maximum(-point, -radius), np.minimum(1 - point, radius))
    step = lowest_within(curvature + damping * np.eye(point.size), slope, bounds)
    return step, -float(2 * slope @ step + step @ curvature @ step)


def lowest_within(curvature: Array, slope: Array, bounds: tuple[Array, Array]) -> Array:
    """The step within bounds at which 2 slope · step + step · curvature · step is lowest. Shape (d,).

    Args:
        curvature: Positive definite. Shape (d, d).
        slope: Shape (d,).
        bounds: Lowest and highest step of each coordinate. Shapes (d,).
    """
    root = np.linalg.cholesky(curvature)
    solution = lsq_linear(root.T, -np.linalg.solve(root, slope), bounds, method="bvls")
    return np.clip(solution.x, *bounds)
