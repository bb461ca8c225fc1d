"""Bounded Gauss-Newton steps in the unit cube, for studies around a best fit.

The simulator has no gradient, and near a fit it may have cliffs. So a step tries several reaches in one batch and keeps
the best, and the Jacobian is updated from the evaluated points (Broyden's update) instead of being measured anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from swim2real.calibration.problem import Problem
from swim2real.objective import Comparison
from swim2real.parameters import ParameterSpace

Array = NDArray[np.float64]

STEP = 0.02  # of central differences: smaller ones see the tolerance of the steady cycle
_DAMPING = 1e-3  # m of residual for moving a parameter through its whole range
_FAR = 3.0  # times the residual, from which on an evaluation says nothing on the slope here
_REACHES = (1.0, 1 / 3, 1 / 9)
_JUMP = 4.0  # times the change on the other side, from which on a difference has crossed a jump
_SMALLEST = 1e-4  # reach [of the range] at which a re-fit gives up


@dataclass(frozen=True)
class EvaluatedPoint:
    """An evaluated point.

    Attributes:
        point: Coordinates in the unit cube. Shape (d,).
        loss: Loss of the comparison [m].
        residual: Residual vector of the comparison [m]. Shape (n,).
        failed: Whether a simulation diverged.
    """

    point: Array
    loss: float
    residual: Array
    failed: bool

    @property
    def misfit(self) -> float:
        """Root of the mean square of the residual, which Gauss-Newton lowers [m]."""
        return float(np.linalg.norm(self.residual))


class Evaluator:
    """Evaluates points of the unit cube in batches and counts them."""

    def __init__(
        self, problem: Problem, space: ParameterSpace, on_batch: Callable[[int], None] = lambda count: None
    ) -> None:
        """Prepares the evaluations.

        Args:
            problem: What evaluates parameter values.
            space: Maps the unit cube to values.
            on_batch: Called after every batch with the number of evaluations so far.
        """
        self.problem, self.space, self.count = problem, space, 0
        self._on_batch = on_batch

    def comparisons(self, points: Sequence[Array]) -> list[Comparison]:
        """Comparisons of points of the unit cube. Each of shape (d,)."""
        comparisons = self.problem.evaluate_many([self.space.to_values(point) for point in points])
        self.add(len(points))
        return comparisons

    def add(self, count: int) -> None:
        """Counts evaluations that were made elsewhere."""
        self.count += count
        self._on_batch(self.count)

    def __call__(self, points: Sequence[Array]) -> list[EvaluatedPoint]:
        return [
            EvaluatedPoint(
                np.asarray(point), comparison.loss, comparison.residual_vector(), comparison.divergence is not None
            )
            for point, comparison in zip(points, self.comparisons(points), strict=True)
        ]


def jacobian(evaluate: Evaluator, at: EvaluatedPoint) -> tuple[Array, list[int]]:
    """Slopes of the residual by central differences, one-sided at a bound or where the other side crosses a jump.

    A jump, where a motion changes into another kind, is no slope: one among the columns would hide all others.

    Returns:
        Slopes [m], shape (n, d), and the parameters that have a jump within a step.
    """
    points: list[Array] = []
    for i in range(len(at.point)):
        for sign in (-1.0, 1.0):
            point = at.point.copy()
            point[i] = np.clip(point[i] + sign * STEP, 0.0, 1.0)
            points.append(point)
    neighbors = evaluate(points)
    columns: list[Array] = []
    jumps: list[int] = []
    for i in range(len(at.point)):
        low, high = neighbors[2 * i], neighbors[2 * i + 1]
        down, up = (float(np.linalg.norm(side.residual - at.residual)) for side in (low, high))
        if low.failed or (down > _JUMP * up and high.point[i] > at.point[i]):
            low = at
            jumps.append(i)
        elif high.failed or (up > _JUMP * down and low.point[i] < at.point[i]):
            high = at
            jumps.append(i)
        width = high.point[i] - low.point[i]
        columns.append((high.residual - low.residual) / width if width > 0 else np.zeros_like(at.residual))
    return np.column_stack(columns), jumps


def refit(
    evaluate: Evaluator, start: EvaluatedPoint, slopes: Array, free: NDArray[np.bool_], steps: int, reach: float = 0.1,
    enough: float = 0.0,
) -> tuple[EvaluatedPoint, Array]:  # fmt: skip
    """Lowers the residual by a few bounded steps.

    Args:
        evaluate: Evaluates points.
        start: The point to begin at.
        slopes: Jacobian near the start [m]. Shape (n, d).
        free: Which parameters may move. Shape (d,).
        steps: Most steps, of three evaluations each.
        reach: The most that a parameter moves in the first step [of its range].
        enough: Gain in the loss below which the re-fit ends [m].

    Returns:
        The best evaluated point, which may be the start, and the updated Jacobian.
    """
    at = start
    for _ in range(steps if free.any() else 0):
        points = [step_toward(at.point, -at.residual, slopes, free, reach * share) for share in _REACHES]
        trials = evaluate(points)
        slopes = broyden_update(slopes, at, trials)
        best = min(range(len(trials)), key=lambda i: trials[i].misfit)
        if trials[best].misfit >= at.misfit:
            reach *= _REACHES[-1] / 3
            if reach < _SMALLEST:
                break
            continue
        gain = at.misfit - trials[best].misfit
        at, reach = trials[best], 2 * reach * _REACHES[best]
        if gain < enough:
            break
    return at, slopes


def step_toward(point: Array, change: Array, slopes: Array, free: NDArray[np.bool_], reach: float) -> Array:
    """The point whose residual changes as asked, as nearly as the slopes, the reach and the bounds allow."""
    a = np.vstack([slopes[:, free], _DAMPING * np.eye(int(free.sum()))])
    q, r = np.linalg.qr(a)
    b = q.T @ np.concatenate([change, np.zeros(int(free.sum()))])
    tiny = 1e-12  # the solver wants room between the bounds
    low = np.maximum(-point[free], -reach) - tiny
    high = np.minimum(1.0 - point[free], reach) + tiny
    out = point.copy()
    out[free] = np.clip(point[free] + lsq_linear(r, b, (low, high)).x, 0.0, 1.0)
    return out


def broyden_update(slopes: Array, at: EvaluatedPoint, evaluated: Sequence[EvaluatedPoint]) -> Array:
    """Broyden's update by each evaluation that is neither far off nor so near that it shows the engine's grain."""
    for other in sorted(evaluated, key=lambda other: -other.misfit):
        step = other.point - at.point
        square = float(step @ step)
        if square >= STEP**2 and not other.failed and other.misfit < _FAR * at.misfit:
            slopes = slopes + np.outer(other.residual - at.residual - slopes @ step, step) / square
    return slopes
