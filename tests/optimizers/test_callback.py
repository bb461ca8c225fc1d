"""Solvers that take a function, behind ask and tell."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from swim2real.errors import OptimizerError
from swim2real.optimizers import Candidate, Evaluation, first_point, streams
from swim2real.optimizers.callback import CallbackSolver

D = 3
GOAL = np.array([0.3, 0.8, 0.55])


def residual_of(point: np.ndarray) -> np.ndarray:
    return np.concatenate([point - GOAL, 3 * (point[1:] - point[:-1] ** 2 - GOAL[1:] + GOAL[:-1] ** 2)])


def trf(first, residuals) -> None:
    """SciPy's solver, one point a call."""
    least_squares(lambda x: residuals(x[None])[0], first, bounds=(0, 1), jac="2-point", max_nfev=20)


def grid(first, residuals) -> None:
    """Two calls of several points each; the second call depends on what the first one gave."""
    around = np.clip(first + np.array([[0.0], [0.1], [-0.1]]), 0, 1)
    squares = np.square(residuals(around)).sum(axis=1)
    residuals(around[squares.argmin()] + 0.01 * np.arange(2)[:, None] * np.ones(D))


def make(solve=trf, seed: int = 0) -> CallbackSolver:
    return CallbackSolver(first_point(D, seed), streams(seed)[1], solve, "solver")


def drive(optimizer: CallbackSolver, count: int) -> list[Candidate]:
    asked = []
    for _ in range(count):
        asked.append(optimizer.ask())
        residual = residual_of(asked[-1].point)
        optimizer.tell(Evaluation(asked[-1], float(np.linalg.norm(residual)), residual=residual))
    return asked


def points(asked: list[Candidate]) -> np.ndarray:
    return np.array([candidate.point for candidate in asked])


def called_directly(first: np.ndarray) -> list[np.ndarray]:
    """Every point that the solver evaluates when it is left to itself."""
    seen = []

    def residuals(points: np.ndarray) -> np.ndarray:
        seen.extend(points.copy())
        return np.array([residual_of(point) for point in points])

    trf(first, residuals)
    return seen


def test_it_asks_for_just_what_the_solver_calls_for():
    alone = called_directly(first_point(D, 0))
    np.testing.assert_array_equal(points(drive(make(), len(alone))), np.clip(alone, 0, 1))
    np.testing.assert_allclose(alone[-1], GOAL, atol=1e-6)


def test_a_call_for_several_points_is_asked_one_by_one():
    asked = drive(make(grid), 5)
    assert [candidate.note for candidate in asked] == [
        {"source": "first point"}, {"source": "solver", "start": 1, "call": 1},
        {"source": "solver", "start": 1, "call": 1}, {"source": "solver", "start": 1, "call": 2},
        {"source": "solver", "start": 1, "call": 2},
    ]  # fmt: skip
    losses = [np.linalg.norm(residual_of(candidate.point)) for candidate in asked[:3]]
    np.testing.assert_array_equal(asked[3].point, asked[int(np.argmin(losses))].point)


def test_when_the_solver_is_done_it_starts_again_elsewhere():
    asked = drive(make(grid), 12)
    assert [candidate.note.get("start", 1) for candidate in asked] == [1] * 5 + [2] * 5 + [3] * 2
    assert len({tuple(candidate.point) for candidate in asked[::5]}) == 3


def test_points_a_rounding_beyond_the_cube_are_brought_back():
    asked = drive(make(lambda first, residuals: residuals(np.full((1, D), 1 + 1e-16 * np.array([0, 3, -3])))), 1)
    assert np.all(asked[0].point <= 1)


def test_what_is_told_must_have_a_residual():
    optimizer = make()
    candidate = optimizer.ask()
    with pytest.raises(OptimizerError) as caught:
        optimizer.tell(Evaluation(candidate, 0.1))
    assert str(caught.value) == "tell() got an evaluation without a residual, which solver needs"
