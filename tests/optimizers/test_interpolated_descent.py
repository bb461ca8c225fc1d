"""Descent on an interpolated model: valleys, rough ground, dead ends, points that fail."""

import numpy as np
import pytest

from swim2real.optimizers import Evaluation
from swim2real.optimizers.contract import Candidate, cube_point
from swim2real.optimizers.interpolated_descent import descend


def descended(residual, start, fails=lambda point: False, most=2000):
    """What a descent returns, and all evaluations on the way."""

    def evaluated(candidate):
        if fails(candidate.point):
            return Evaluation(candidate, 1.0, True)
        vector = np.asarray(residual(candidate.point), dtype=float)
        return Evaluation(candidate, float(np.linalg.norm(vector)), stages=(vector,))

    base, made = evaluated(Candidate(cube_point(start))), list[Evaluation]()
    search = descend(base, 0, np.random.default_rng(0), {"start": 1})
    asked = next(search)
    while len(made) < most:
        told = [evaluated(one) for one in asked]
        made += told
        try:
            asked = search.send(told)
        except StopIteration as end:
            return end.value, made
    raise AssertionError(f"no end after {most} evaluations")


def rosenbrock(point):
    x = 4 * point - 2
    return np.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])


@pytest.mark.parametrize("start", [(0.2, 0.7, 0.4), (0.9, 0.1, 0.5)])
def test_a_curved_valley_is_followed_to_its_end(start):
    best, made = descended(rosenbrock, start)
    assert best.loss < 0.1
    assert best.loss == min(one.loss for one in made)
    assert all(one.candidate.note["start"] == 1 for one in made)


def test_rough_ground_is_seen_past():
    def rough(point):
        return np.append(point - 0.6, 0.02 * np.sin(900 * point.sum()))

    best, _ = descended(rough, (0.1, 0.2, 0.1, 0.15))
    assert best.loss < 0.04


def test_hops_leave_a_dead_end():
    def walled(point):
        wall = 0.3 if 0.32 < point[0] < 0.36 else 0.0
        return np.append(point - 0.5, wall)

    best, _ = descended(walled, (0.25, 0.5, 0.5))
    assert best.loss < 0.05


def test_points_that_fail_are_passed_over():
    best, made = descended(lambda p: p - 0.5, (0.2, 0.2, 0.2), fails=lambda p: p[1] < 0.15 or p[2] > 0.6)
    assert best.loss < 0.01
    assert not best.failed
    assert any(one.failed for one in made)


def test_a_residual_of_zero_and_one_that_nothing_changes_come_to_an_end():
    best, _ = descended(lambda p: 0 * p, (0.5, 0.5))
    assert best.loss == 0
    best, _ = descended(lambda p: np.ones(3), (0.5, 0.5))
    assert best.loss == pytest.approx(np.sqrt(3))
