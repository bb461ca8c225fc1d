"""Least squares: differences, steps in a box of trust, failures, starts."""

import numpy as np
import pytest
from driving import drive, lowest, notes, points
from threadpoolctl import threadpool_limits

from swim2real.optimizers import Evaluation, first_point, streams
from swim2real.optimizers.least_squares import LeastSquares

D = 4
GOAL = np.array([0.3, 0.8, 0.55, 0.1])


def linear(point: np.ndarray) -> np.ndarray:
    return (np.eye(D) + 0.3 * np.ones((D, D))) @ (point - GOAL)


def rosenbrock(point: np.ndarray) -> np.ndarray:
    x = 4 * point - 2
    return np.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])


def driven(count, residual=linear, failed=lambda i: False, seed=0, **settings) -> list[Evaluation]:
    return drive(LeastSquares(first_point(D, seed), streams(seed)[1], **settings), count, residual, failed)


def moved(told: list[Evaluation], i: int = -1) -> float:
    """The largest change of a coordinate from the best of the first point and its differences."""
    base = min(told[: 1 + D], key=lambda one: one.loss)
    return float(np.abs(told[i].candidate.point - base.candidate.point).max())


def test_a_linear_residual_is_solved_by_one_jacobian():
    told = driven(1 + D + 6)
    assert notes(told, "source") == ["first point"] + ["difference"] * D + ["step"] * 6
    assert lowest(told) < 2e-3 * told[0].loss


def test_rosenbrocks_valley_is_followed_to_its_end():
    told = driven(150, rosenbrock, seed=1, difference=0.02)
    assert told[0].loss > 3
    assert lowest(told) < 0.05


def test_differences_change_one_parameter_and_point_inward():
    first = np.array([0.0, 1.0, 0.2, 0.9])
    told = drive(LeastSquares(first, streams(0)[1], difference=0.02), 1 + D, linear)
    np.testing.assert_allclose(points(told)[1:] - first, np.diag([0.02, -0.02, 0.02, -0.02]), atol=1e-15)
    assert notes(told[1:]) == [{"source": "difference", "parameter": k, "start": 1} for k in range(D)]


def test_the_first_step_goes_from_the_best_difference_and_stays_in_the_box_of_trust():
    told = driven(2 + D, difference=0.1, radius=0.02)
    assert told[-1].candidate.note == {"source": "step", "start": 1, "radius": 0.02}
    assert lowest(told[: 1 + D]) < told[0].loss
    assert moved(told) == pytest.approx(0.02)
    assert np.abs(told[-1].candidate.point - told[0].candidate.point).max() > 0.05


def test_a_goal_outside_the_cube_ends_at_its_nearest_face():
    beyond = np.array([-0.5, 0.5, 1.4, 0.5])
    best = min(driven(40, lambda point: point - beyond), key=lambda one: one.loss)
    np.testing.assert_allclose(best.candidate.point, [0.0, 0.5, 1.0, 0.5], atol=5e-3)


def test_a_failed_difference_poisons_nothing_and_a_failed_step_is_retried_closer():
    told = driven(2 + D, failed=lambda i: i == 2)
    step = told[-1].candidate.point - told[0].candidate.point
    assert step[1] == pytest.approx(0.0, abs=1e-12)
    assert told[-1].loss < told[0].loss
    solved = driven(40, failed=lambda i: i in (2, 3))
    assert lowest(solved) < 0.02 * solved[0].loss
    told = driven(3 + D, failed=lambda i: i == 1 + D)
    assert moved(told, -1) <= 0.5 * moved(told, -2) + 1e-12
    assert told[-1].loss < told[0].loss


def test_points_that_failed_are_left_for_random_ones():
    told = driven(40, failed=lambda i: i < 2)
    assert notes(told, "source")[:4] == ["first point", "start", "start", "difference"]
    assert told[3].candidate.note["start"] == 3
    assert lowest(told[2:]) < 0.01 * told[2].loss
    told = driven(12, failed=lambda i: True)
    assert notes(told, "source") == ["first point"] + ["start"] * 11
    assert len(np.unique(points(told), axis=0)) == 12


def test_parameters_without_effect_stay_and_no_effect_at_all_ends_the_start():
    told = driven(12, lambda point: 2 * (point[:2] - GOAL[:2]))
    np.testing.assert_allclose(told[-1].candidate.point[2:], told[0].candidate.point[2:], atol=1e-12)
    flat = driven(2 * (1 + D) + 1, lambda point: np.ones(3))
    assert notes(flat, "source") == ["first point"] + ["difference"] * D + ["start"] + ["difference"] * D + ["start"]


def test_after_a_start_has_converged_another_begins_at_random():
    told = driven(80, lambda point: np.append(linear(point), 0.3))
    starts = [note.get("start", 1) for note in notes(told)]
    assert starts == sorted(starts)
    assert starts[-1] >= 3
    for number in range(1, starts[-1]):
        assert min(one.loss for one, start in zip(told, starts, strict=True) if start == number) < 0.301


def test_the_same_residuals_give_the_same_points_to_the_last_bit_on_any_number_of_threads():
    """As long as a real one: 26000 numbers."""
    mixing = np.random.default_rng(3).normal(size=(26000, 2 * (D - 1))) / 160
    runs = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            runs.append(driven(30, lambda point: np.einsum("ni,i->n", mixing, rosenbrock(point)), seed=5))
    assert points(runs[1]).tobytes() == points(runs[0]).tobytes()
    assert notes(runs[1]) == notes(runs[0])
