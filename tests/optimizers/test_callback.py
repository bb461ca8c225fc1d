"""Solvers that take a function, behind ask and tell."""

import numpy as np
from driving import drive, notes, points
from scipy.optimize import least_squares

from swim2real.optimizers import first_point, streams
from swim2real.optimizers.callback import CallbackSolver

D = 3
GOAL = np.array([0.3, 0.8, 0.55])


def residual_of(point: np.ndarray) -> np.ndarray:
    return np.concatenate([point - GOAL, 3 * (point[1:] - point[:-1] ** 2 - GOAL[1:] + GOAL[:-1] ** 2)])


def trf(first, residuals) -> None:
    """SciPy's solver, one point per call."""
    least_squares(lambda x: residuals(x[None])[0], first, bounds=(0, 1), jac="2-point", max_nfev=20)


def grid(first, residuals) -> None:
    """Two calls of several points each; the second call depends on what the first one gave."""
    around = np.clip(first + np.array([[0.0], [0.1], [-0.1]]), 0, 1)
    squares = np.square(residuals(around)).sum(axis=1)
    residuals(around[squares.argmin()] + 0.01 * np.arange(2)[:, None] * np.ones(D))


def driven(solve, count: int):
    return drive(CallbackSolver(first_point(D, 0), streams(0)[1], solve, "solver"), count, residual_of)


def test_it_asks_for_just_what_the_solver_calls_for():
    alone = []

    def residuals(points: np.ndarray) -> np.ndarray:
        alone.extend(points.copy())
        return np.array([residual_of(point) for point in points])

    trf(first_point(D, 0), residuals)
    np.testing.assert_array_equal(points(driven(trf, len(alone))), np.clip(alone, 0, 1))
    np.testing.assert_allclose(alone[-1], GOAL, atol=1e-6)


def test_a_call_for_several_points_is_asked_one_by_one_and_in_the_end_it_starts_elsewhere():
    told = driven(grid, 12)
    assert notes(told[:5]) == [
        {"source": "first point"}, *({"source": "solver", "start": 1, "call": call} for call in (1, 1, 2, 2)),
    ]  # fmt: skip
    best = min(told[:3], key=lambda one: one.loss)
    np.testing.assert_array_equal(told[3].candidate.point, best.candidate.point)
    assert notes(told, "start") == [None] + [1] * 4 + [2] * 5 + [3] * 2
    assert len(np.unique(points(told[::5]), axis=0)) == 3


def test_points_a_rounding_beyond_the_cube_are_brought_back():
    told = driven(lambda first, residuals: residuals(np.full((1, D), 1 + 1e-16 * np.array([0, 3, -3]))), 1)
    assert np.all(points(told) <= 1)
