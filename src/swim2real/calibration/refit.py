"""Bounded Gauss-Newton steps in the unit cube, for studies around a best fit.

The simulator has no gradient, and near a fit it may have cliffs. So a step tries several reaches in one batch and keeps
the best, and the Jacobian is mended from what was evaluated (Broyden's update) instead of being measured anew.
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
class Fitted:
    """An evaluated point.

    Attributes:
        point: In the unit cube. Shape (d,).
        loss: [m].
        residual: `Comparison.residual_vector()` [m]. Shape (n,).
        failed: Whether a simulation diverged.
    """

    point: Array
    loss: float
    residual: Array
    failed: bool

    @property
    def misfit(self) -> float:
        """Root of the mean square of the residual, what Gauss-Newton lowers [m]."""
        return float(np.linalg.norm(self.residual))


class Evaluator:
    """Evaluates points of the unit cube in batches, counts them and tells of it."""

    def __init__(
        self, problem: Problem, space: ParameterSpace, on_batch: Callable[[int], None] = lambda count: None
    ) -> None:
        """Args: `on_batch` is called after every batch, with the evaluations so far."""
        self.problem, self.space, self.count = problem, space, 0
        self._on_batch = on_batch

    def comparisons(self, points: Sequence[Array]) -> list[Comparison]:
        """Evaluates points of the unit cube. Each of shape (d,)."""
        found = self.problem.evaluate_many([self.space.to_values(point) for point in points])
        self.count += len(points)
        self._on_batch(self.count)
        return found

    def __call__(self, points: Sequence[Array]) -> list[Fitted]:
        return [
            Fitted(np.asarray(point), one.loss, one.residual_vector(), one.divergence is not None)
            for point, one in zip(points, self.comparisons(points), strict=True)
        ]


def jacobian(evaluate: Evaluator, at: Fitted) -> tuple[Array, list[int]]:
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
    found = evaluate(points)
    columns: list[Array] = []
    jumps: list[int] = []
    for i in range(len(at.point)):
        low, high = found[2 * i], found[2 * i + 1]
        down, up = (float(np.linalg.norm(one.residual - at.residual)) for one in (low, high))
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
    evaluate: Evaluator, start: Fitted, slopes: Array, free: NDArray[np.bool_], steps: int, reach: float = 0.1,
    enough: float = 0.0,
) -> tuple[Fitted, Array]:  # fmt: skip
    """Lowers the residual by a few bounded steps.

    Args:
        evaluate: Evaluates points.
        start: Where to begin.
        slopes: Jacobian near the start [m]. Shape (n, d).
        free: Which parameters may move. Shape (d,).
        steps: At most, of three evaluations each.
        reach: Of the first step, the most that a parameter moves [of its range].
        enough: Gain in the loss below which the re-fit ends [m].

    Returns:
        The best point found, which may be the start, and the mended Jacobian.
    """
    at = start
    for _ in range(steps if free.any() else 0):
        points = [moved(at.point, -at.residual, slopes, free, reach * share) for share in _REACHES]
        found = evaluate(points)
        slopes = mended(slopes, at, found)
        best = min(range(len(found)), key=lambda i: found[i].misfit)
        if found[best].misfit >= at.misfit:
            reach *= _REACHES[-1] / 3
            if reach < _SMALLEST:
                break
            continue
        gain = at.misfit - found[best].misfit
        at, reach = found[best], 2 * reach * _REACHES[best]
        if gain < enough:
            break
    return at, slopes


def moved(point: Array, wanted: Array, slopes: Array, free: NDArray[np.bool_], reach: float) -> Array:
    """The point whose residual changes by what is wanted, as near as the slopes, the reach and the bounds allow."""
    a = np.vstack([slopes[:, free], _DAMPING * np.eye(int(free.sum()))])
    q, r = np.linalg.qr(a)
    b = q.T @ np.concatenate([wanted, np.zeros(int(free.sum()))])
    tiny = 1e-12  # the solver wants room between the bounds
    low = np.maximum(-point[free], -reach) - tiny
    high = np.minimum(1.0 - point[free], reach) + tiny
    out = point.copy()
    out[free] = np.clip(point[free] + lsq_linear(r, b, (low, high)).x, 0.0, 1.0)
    return out


def mended(slopes: Array, at: Fitted, found: Sequence[Fitted]) -> Array:
    """Broyden's update by each evaluation that is neither far off nor so near that it shows the engine's grain."""
    for one in sorted(found, key=lambda one: -one.misfit):
        step = one.point - at.point
        square = float(step @ step)
        if square >= STEP**2 and not one.failed and one.misfit < _FAR * at.misfit:
            slopes = slopes + np.outer(one.residual - at.residual - slopes @ step, step) / square
    return slopes
