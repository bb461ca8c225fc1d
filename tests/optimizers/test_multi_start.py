"""Least squares in stages: order of starts and stages, differences across a border, the pull, the end."""

import numpy as np
import pytest
from driving import answered, drive, lowest, notes, points

from swim2real.errors import OptimizerError
from swim2real.optimizers import Evaluation, MultiStart, streams
from swim2real.optimizers.multi_start import agreeing, damped_step

D = 3
GOAL = np.array([0.3, 0.8, 0.55])
MIDDLE = np.full(D, 0.5)
ITERATION = D + 6  # differences, and three dampings at two lengths


def linear(point: np.ndarray) -> np.ndarray:
    return (np.eye(D) + 0.3 * np.ones((D, D))) @ (point - GOAL)


def searched(count, stages, starts=(MIDDLE,), failed=lambda i: False) -> list[Evaluation]:
    """Evaluations by stages of the residual as a function of the point; the loss is the last stage's length."""

    def answer(i, candidate):
        if failed(i):
            return Evaluation(candidate, 1.0, True)
        vectors = tuple(stages(candidate.point))
        return Evaluation(candidate, float(np.linalg.norm(vectors[-1])), stages=vectors)

    return answered(MultiStart(starts, streams(0)[1]), count, answer)


def test_a_linear_residual_is_solved_in_two_iterations():
    told = drive(MultiStart([MIDDLE], streams(0)[1]), 1 + 2 * ITERATION + D, linear)
    assert notes(told[: 2 + ITERATION], "source") == ["first point"] + ["difference"] * D + ["step"] * 6 + [
        "difference"
    ]
    assert lowest(told) < 0.02 * told[0].loss


def test_curved_valleys_are_followed():
    def rosenbrock(point):
        x = 4 * point - 2
        return np.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])

    told = drive(MultiStart([np.array([0.2, 0.7, 0.4])], streams(0)[1]), 1 + 20 * ITERATION, rosenbrock)
    assert told[0].loss > 10
    assert lowest(told) < 0.5


def test_the_start_that_is_best_in_the_last_but_one_stage_goes_first():
    starts = [np.full(D, share) for share in (0.1, 0.7, 0.4)]
    told = searched(4, lambda p: (p, p - 0.45, 0.2 - p), starts)
    np.testing.assert_array_equal(points(told[:3]), starts)
    assert notes(told[3:]) == [{"source": "difference", "parameter": 0, "start": 3, "stage": 1}]


def test_stages_are_lowered_in_turn():
    told = searched(100, lambda p: (linear(p)[:1], linear(p)))
    order = [note["stage"] for note in notes(told) if note.get("start") == 1]
    assert order == sorted(order)
    assert set(order) == {1, 2}
    shape = [np.linalg.norm(one.stages[0]) for one in told if one.candidate.note.get("stage", 1) == 1]
    assert min(shape) < 0.05 * shape[0]


def test_a_slope_is_taken_on_the_side_that_is_not_across_a_border_or_on_both():
    def border(point):
        return ((linear(point) + (5.0 if point[1] > 0.5 else 0.0)),)

    told = searched(1 + ITERATION + 1, border)
    asked = points(told)[1 : D + 2] - MIDDLE
    np.testing.assert_allclose(asked, [[0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01], [0, -0.01, 0]], atol=1e-12)
    straight = searched(1 + ITERATION, lambda p: (linear(p),))
    np.testing.assert_allclose(points(told)[-6:-4], points(straight)[-6:-4], atol=1e-9)
    narrow = searched(1 + ITERATION + 1, lambda p: ((p - 0.501) * [1.0, 100.0, 1.0],))
    assert lowest(narrow) < 0.1 * narrow[0].loss


def test_nothing_is_learned_from_a_parameter_whose_differences_failed():
    told = searched(1 + ITERATION + 1, lambda p: (linear(p),), failed=(2, 4).__contains__)
    steps = points(told)[2 + D :] - MIDDLE
    np.testing.assert_allclose(steps[:, 1], 0.0, atol=1e-12)
    assert np.abs(steps[:, 0]).max() > 0.05


def test_starts_that_failed_are_passed_over_and_random_ones_follow_the_last():
    told = searched(4, lambda p: (linear(p),), [MIDDLE, np.full(D, 0.2)], failed=lambda i: i < 3)
    assert notes(told, "start") == [None, 2, 3, 4]
    assert not np.array_equal(points(told)[3], points(told)[2])


def test_what_has_no_effect_is_pulled_to_the_middle():
    gradients = np.array([[1.0, 0.0], [0.0, 0.0]])
    step = damped_step(gradients, np.array([0.1, 0.0]), np.array([0.5, 0.9]), damping=1e-6, pull=1e-3)
    np.testing.assert_allclose(step, [-0.1, -0.4], atol=0.02)
    np.testing.assert_array_equal(damped_step(0 * gradients, np.zeros(2), np.full(2, 0.9), 0.1, pull=0.0), 0.0)


def test_what_comes_next_whatever_the_evaluations_are_is_known():
    optimizer = MultiStart([MIDDLE, np.full(D, 0.2)], streams(0)[1])
    told = answered(optimizer, 2, lambda i, one: Evaluation(one, 1.0, stages=(linear(one.point),)))
    assert optimizer.upcoming() == ()
    first = optimizer.ask()
    ahead = optimizer.upcoming()
    assert len(told) == 2
    assert [one.note["parameter"] for one in (first, *ahead)] == [0, 1, 2]
    optimizer.tell(Evaluation(first, 1.0, True))
    assert optimizer.ask() is ahead[0]


def test_a_start_is_needed():
    with pytest.raises(OptimizerError, match="starts is empty; give one point at least"):
        MultiStart([], streams(0)[1])


def test_it_is_done_when_two_descents_agree_or_six_have_ended():
    optimizer = MultiStart([MIDDLE, np.full(D, 0.2)], streams(0)[1])
    assert not optimizer.done
    offset = np.full(1, 0.01)

    def answer(i, one):
        residual = np.concatenate([linear(one.point), offset])
        return Evaluation(one, float(np.linalg.norm(residual)), stages=(residual,))

    asked = 0
    while not optimizer.done:
        one = optimizer.ask()
        optimizer.tell(answer(asked, one))
        asked += 1
        assert asked < 2000
    assert agreeing([0.010, 0.0109, 0.02]) == 2
    begun = {note.get("start") for note in notes(answered(MultiStart([MIDDLE], streams(0)[1]), asked, answer))}
    assert {1, 2} <= begun
    assert len(begun) <= 7
