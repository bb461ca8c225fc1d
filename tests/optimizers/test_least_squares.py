from collections.abc import Callable

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from swim2real.errors import OptimizerError
from swim2real.optimizers import Candidate, Evaluation, Optimizer, first_point, streams
from swim2real.optimizers.least_squares import LeastSquares

D = 4
GOAL = np.array([0.3, 0.8, 0.55, 0.1])


def linear(point: np.ndarray) -> np.ndarray:
    mixed = np.eye(D) + 0.3 * np.ones((D, D))
    return mixed @ (point - GOAL)


def rosenbrock(point: np.ndarray) -> np.ndarray:
    x = 4 * point - 2
    return np.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])


def drive(
    optimizer: Optimizer, count: int, residual: Callable[[np.ndarray], np.ndarray] = linear,
    failed: Callable[[int], bool] = lambda i: False,
) -> list[Evaluation]:  # fmt: skip
    told = []
    for i in range(count):
        candidate = optimizer.ask()
        vector = residual(candidate.point)
        lost = failed(i)
        if lost:
            vector = np.full(vector.size, 1.0)
        told.append(Evaluation(candidate, 1.0 if lost else float(np.linalg.norm(vector)), lost, residual=vector))
        optimizer.tell(told[-1])
    return told


def make(seed: int = 0, **settings) -> LeastSquares:
    return LeastSquares(first_point(D, seed), streams(seed)[1], **settings)


def sources(told: list[Evaluation]) -> list[str]:
    return [one.candidate.note["source"] for one in told]


def points(told: list[Evaluation]) -> np.ndarray:
    return np.array([one.candidate.point for one in told])


def test_a_linear_residual_is_solved_by_one_jacobian():
    told = drive(make(), 1 + D + 6)
    assert sources(told) == ["first point"] + ["difference"] * D + ["step"] * 6
    assert min(one.loss for one in told) < 2e-3 * told[0].loss


def test_rosenbrocks_valley_is_followed_to_its_end():
    told = drive(make(1, difference=0.02), 150, rosenbrock)
    assert told[0].loss > 3
    assert min(one.loss for one in told) < 0.05


def test_differences_change_one_parameter_and_point_inward():
    first = np.array([0.0, 1.0, 0.2, 0.9])
    told = drive(LeastSquares(first, streams(0)[1], difference=0.02), 1 + D)
    changes = points(told)[1:] - first
    np.testing.assert_allclose(changes, np.diag([0.02, -0.02, 0.02, -0.02]), atol=1e-15)
    assert [one.candidate.note for one in told[1:]] == [
        {"source": "difference", "parameter": k, "start": 1} for k in range(D)
    ]


def test_the_first_step_stays_in_the_box_of_trust():
    told = drive(make(radius=0.05), 2 + D)
    assert told[-1].candidate.note == {"source": "step", "start": 1, "radius": 0.05}
    base = min(told[: 1 + D], key=lambda one: one.loss)
    assert np.abs(told[-1].candidate.point - base.candidate.point).max() == pytest.approx(0.05)


def test_a_difference_that_is_better_is_where_the_steps_begin():
    told = drive(make(difference=0.1, radius=0.02), 2 + D)
    base = min(told[: 1 + D], key=lambda one: one.loss)
    assert base is not told[0]
    assert np.abs(told[-1].candidate.point - base.candidate.point).max() == pytest.approx(0.02)
    assert np.abs(told[-1].candidate.point - told[0].candidate.point).max() > 0.05


def test_a_goal_outside_the_cube_ends_at_its_nearest_face():
    beyond = np.array([-0.5, 0.5, 1.4, 0.5])
    told = drive(make(), 40, lambda point: point - beyond)
    assert np.all((points(told) >= 0) & (points(told) <= 1))
    best = min(told, key=lambda one: one.loss)
    np.testing.assert_allclose(best.candidate.point, [0.0, 0.5, 1.0, 0.5], atol=5e-3)


def test_a_difference_that_failed_poisons_nothing_and_its_parameter_stays_put():
    told = drive(make(), 2 + D, failed=lambda i: i == 2)
    step = told[-1].candidate.point - told[0].candidate.point
    assert step[1] == pytest.approx(0.0, abs=1e-12)
    assert told[-1].loss < told[0].loss
    solved = drive(make(), 40, failed=lambda i: i in (2, 3))
    assert min(one.loss for one in solved) < 0.02 * solved[0].loss


def test_a_step_that_failed_is_retried_closer():
    told = drive(make(), 3 + D, failed=lambda i: i == 1 + D)
    base = min(told[: 1 + D], key=lambda one: one.loss)
    one, other = (np.abs(told[i].candidate.point - base.candidate.point).max() for i in (-2, -1))
    assert other <= 0.5 * one + 1e-12
    assert told[-1].loss < told[0].loss


def test_a_first_point_that_failed_is_left_for_a_random_one():
    told = drive(make(), 40, failed=lambda i: i < 2)
    assert sources(told)[:4] == ["first point", "start", "start", "difference"]
    assert told[3].candidate.note["start"] == 3
    assert min(one.loss for one in told[2:]) < 0.01 * told[2].loss


def test_when_everything_fails_it_goes_on_at_random():
    told = drive(make(), 12, failed=lambda i: True)
    assert sources(told) == ["first point"] + ["start"] * 11
    assert len(np.unique(points(told), axis=0)) == 12


def test_parameters_without_effect_stay_and_no_effect_at_all_ends_the_start():
    told = drive(make(), 12, lambda point: 2 * (point[:2] - GOAL[:2]))
    np.testing.assert_allclose(told[-1].candidate.point[2:], told[0].candidate.point[2:], atol=1e-12)
    flat = drive(make(), 2 * (1 + D) + 1, lambda point: np.ones(3))
    assert sources(flat) == ["first point"] + ["difference"] * D + ["start"] + ["difference"] * D + ["start"]


def test_after_a_start_has_converged_another_begins_at_random():
    told = drive(make(), 80, lambda point: np.append(linear(point), 0.3))
    starts = [one.candidate.note.get("start", 1) for one in told]
    assert starts == sorted(starts)
    assert starts[-1] >= 3
    for number in range(1, starts[-1]):
        assert min(one.loss for one, start in zip(told, starts, strict=True) if start == number) < 0.301


def test_the_same_residuals_give_the_same_points_to_the_last_bit_on_any_number_of_threads():
    """As long as a real one: 26000 numbers."""
    mixing = np.random.default_rng(3).normal(size=(26000, 2 * (D - 1))) / 160

    def long(point: np.ndarray) -> np.ndarray:
        return np.einsum("ni,i->n", mixing, rosenbrock(point))

    runs = []
    for threads in (1, 2, 2):
        with threadpool_limits(threads):
            runs.append(drive(make(5), 30, long))
    for run in runs[1:]:
        assert points(run).tobytes() == points(runs[0]).tobytes()
        assert [one.candidate.note for one in run] == [one.candidate.note for one in runs[0]]


def test_an_evaluation_without_a_residual_is_refused():
    optimizer = make()
    with pytest.raises(OptimizerError) as caught:
        optimizer.tell(Evaluation(optimizer.ask(), 0.1))
    assert str(caught.value) == "tell() got an evaluation without a residual, which least squares needs"
    assert LeastSquares.needs_residual


def test_a_failed_evaluation_needs_no_residual():
    optimizer = make()
    optimizer.tell(Evaluation(optimizer.ask(), 1.0, failed=True))
    candidate: Candidate = optimizer.ask()
    assert candidate.note == {"source": "start", "start": 2}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"difference": 0.0}, "difference is 0.0; it must be above 0 and at most 0.5"),
        ({"difference": 0.6}, "difference is 0.6; it must be above 0 and at most 0.5"),
        ({"radius": np.nan}, "radius is nan; it must be above 0 and at most 1"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(OptimizerError) as caught:
        make(**settings)
    assert str(caught.value) == message
