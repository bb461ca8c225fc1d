"""Descent on an interpolated model: valleys, rough ground, weights, points that fail."""

import numpy as np
import pytest
from driving import staged

from swim2real.optimizers import Evaluation
from swim2real.optimizers.contract import Candidate, cube_point
from swim2real.optimizers.interpolated_descent import EXACT, PATIENT, go_down, surround


def descended(residual, start, pace=EXACT, radius=0.1, fails=lambda point: False, weights=None, most=2000):
    """What a descent returns, and all evaluations on the way."""

    def evaluated(candidate):
        if fails(candidate.point):
            return Evaluation(candidate, 1.0, True)
        vector = np.asarray(residual(candidate.point), dtype=float)
        stages = staged(vector) if weights is None else ((vector, weights(vector)),)
        return Evaluation(candidate, float(np.linalg.norm(stages[0][0] * stages[0][1])), stages=stages)

    def search():
        points = yield from surround(base, radius, {"start": 1})
        return (yield from go_down(points, 0, pace, {"start": 1}))

    base, made = evaluated(Candidate(cube_point(start))), list[Evaluation]()
    going = search()
    asked = next(going)
    while len(made) < most:
        told = [evaluated(one) for one in asked]
        made += told
        try:
            asked = going.send(told)
        except StopIteration as end:
            return end.value, made
    raise AssertionError(f"no end after {most} evaluations")


def rosenbrock(point):
    x = 4 * point - 2
    return np.concatenate([3 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])


@pytest.mark.parametrize("start", [(0.6, 0.2, 0.7), (0.9, 0.1, 0.5)])
def test_a_curved_valley_is_followed_to_its_end(start):
    best, made = descended(rosenbrock, start, radius=0.05)
    assert best.loss < 0.1
    assert best.loss == min(one.loss for one in made)
    assert all((one.candidate.note["start"], one.candidate.note.get("stage", 1)) == (1, 1) for one in made)


def test_rough_ground_is_seen_past_and_a_smooth_bottom_found_in_few_evaluations():
    def rough(point):
        return np.append(point - 0.6, 0.02 * np.sin(900 * point.sum()))

    best, _ = descended(rough, (0.1, 0.2, 0.1, 0.15), PATIENT)
    assert best.loss < 0.04
    best, made = descended(lambda p: p + 0.2 * p[::-1] ** 2 - 0.5, (0.45, 0.5, 0.4, 0.45), radius=0.02)
    assert best.loss < 1e-5
    assert len(made) < 40


def test_a_residual_whose_weights_fall_with_its_length_is_stepped_along_not_past():
    """Seen as log(1 + length), a step for a linear model of it would go far beyond the end."""

    def bounded(vector):
        length = np.linalg.norm(vector)
        return np.full_like(vector, 0.01 / length * np.log1p(length / 0.01) if length > 0 else 1.0)

    _, made = descended(lambda p: p - 0.6, (0.3, 0.3, 0.3), radius=0.05, weights=bounded)
    furthest = max(one.candidate.point.max() for one in made)
    assert furthest < 0.66
    assert min(one.loss for one in made) < 1e-6


def test_points_that_fail_are_passed_over():
    best, made = descended(
        lambda p: p - 0.5, (0.2, 0.2, 0.2), PATIENT, fails=lambda p: p[1] < 0.15 or p[2] > 0.6 or 0.25 < p[0] < 0.35
    )  # fmt: skip
    assert best.loss < 0.01
    assert not best.failed
    assert any(one.failed for one in made)


def test_a_residual_of_zero_and_one_that_nothing_changes_come_to_an_end():
    best, _ = descended(lambda p: 0 * p, (0.5, 0.5))
    assert best.loss == 0
    best, _ = descended(lambda p: np.ones(3), (0.5, 0.5))
    assert best.loss == pytest.approx(np.sqrt(3))
