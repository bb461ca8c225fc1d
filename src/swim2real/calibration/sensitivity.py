"""Effect of each parameter on the loss around a point, and values between which the error hardly rises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration.problem import Problem
from swim2real.objective import Comparison
from swim2real.objective.figures import Fact
from swim2real.parameters import ParameterSpace, Values
from swimbase.arrays import Array

_WORSE = 0.1  # of the error, by which it may rise
_NEAR = 0.2  # of a parameter's range, within which a residual changes as a plane does
_SPARE = 8  # points that are kept beyond four a parameter
_UNKNOWN = 1e-2  # of the best known direction, below which one isn't known

STEP = 0.1  # of the parameter's range on the space's scale


@dataclass(frozen=True)
class Sensitivity:
    """Effect of a step of one parameter, all others fixed: that others could make up for it isn't seen.

    Attributes:
        name: Name of the parameter.
        lower: Change of the loss for a step down [m]; None where the bound is in the way.
        upper: Change of the loss for a step up [m]; None likewise.
        speed: Mean relative change of the forward speed for a step up, from both sides; None where nothing travels.
    """

    name: str
    lower: Fact
    upper: Fact
    speed: Fact


def sensitivities(problem: Problem, space: ParameterSpace, values: Values) -> list[Sensitivity]:
    """Evaluates a step up and a step down of every parameter, in one batch of twice as many candidates."""
    center = space.to_cube(values)
    moves: list[tuple[int, float]] = []
    for i in range(len(space)):
        moves += [(i, sign * STEP) for sign in (-1.0, 1.0) if 0 <= center[i] + sign * STEP <= 1]
    points = np.repeat(center[None], len(moves) + 1, axis=0)
    for row, (i, step) in enumerate(moves, start=1):
        points[row, i] += step
    results = problem.evaluate_many([space.to_values(point) for point in points])
    base = results[0]
    base_speed = _speeds(base)
    found: list[Sensitivity] = []
    for i, name in enumerate(space.names):
        changes: dict[float, float] = {}
        speeds: list[float] = []
        for (j, step), result in zip(moves, results[1:], strict=True):
            if i != j:
                continue
            changes[np.sign(step)] = result.loss - base.loss
            if len(base_speed):
                change = (_speeds(result) - base_speed) / np.maximum(base_speed, 1e-3)
                speeds.append(float(np.mean(change) * np.sign(step)))
        faster = float(np.mean(speeds or [0.0])) if len(base_speed) else None
        found.append(Sensitivity(name, changes.get(-1.0), changes.get(1.0), faster))
    return found


def _speeds(comparison: Comparison) -> Array:
    """Simulated forward speeds, by trial [m/s]; none where nothing travels."""
    figures = [trial.figures() for trial in comparison.trials]
    return np.array([one["velocity_simulated"] for one in figures if "velocity_simulated" in one])


class Slopes:
    """Slopes of the residual about the best point, from the evaluations that a search has made there anyway."""

    def __init__(self, space: ParameterSpace) -> None:
        """Begins with none.

        Args:
            space: Parameters, on the run's scale.
        """
        self._space, self._near = space, list[tuple[float, Array, NDArray[np.float32]]]()

    def add(self, point: Array, residual: Array) -> None:
        """Takes an evaluation that didn't fail, and drops the farthest from the best of too many. Shapes (d,), (n,)."""
        self._near.append((float(np.linalg.norm(residual)), point, residual.astype(np.float32)))
        best = min(self._near, key=lambda one: one[0])[1]
        if len(self._near) > 4 * len(self._space) + _SPARE:
            del self._near[int(np.argmax([np.abs(point - best).max() for _, point, _ in self._near]))]

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Within which values the error rises by less than a tenth, all other parameters following.

        By a plane through the points about the best; without parameters in whose direction too few points lie.
        """
        if len(self._near) < 2:
            return {}
        error, best, residual = min(self._near, key=lambda one: one[0])
        ways = np.array([point - best for _, point, _ in self._near])
        far = np.abs(ways).max(axis=1)
        kept = (far > 0) & (far < _NEAR)
        if not kept.any():
            return {}
        weights = 1 / far[kept, None]  # a plane touches at the best point
        changes = weights * np.array([one - residual for (*_, one), near in zip(self._near, kept, strict=True) if near])
        left, sizes, rows = np.linalg.svd(weights * ways[kept], full_matrices=False)
        seen = sizes > _UNKNOWN * sizes[0]
        slopes = rows[seen].T @ ((left.T @ changes)[seen] / sizes[seen, None])
        known = np.square(rows[seen]).sum(axis=0) > 1 - _UNKNOWN
        curvature = slopes @ slopes.T
        curvature += 1e-9 * np.trace(curvature) * np.eye(len(best))
        reach = error * np.sqrt(((1 + _WORSE) ** 2 - 1) * np.diag(np.linalg.pinv(curvature)))
        found: dict[str, tuple[float, float]] = {}
        for k in np.flatnonzero(known):
            ends = np.clip(best + np.outer([-1, 1], np.eye(len(best))[k] * reach[k]), 0.0, 1.0)
            low, high = (self._space.to_values(end)[self._space.names[k]] for end in ends)
            found[self._space.names[k]] = low, high
        return found
