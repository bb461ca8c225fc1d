"""Longer time steps, where the robot bears them."""

from dataclasses import replace

import numpy as np
import pytest

from recorded import PENDULUM, pendulum_reference
from swim2real.calibration import CoarseSteps, Problem
from swim2real.calibration.file_models import RecordedEvaluation


def evaluated(problem, batches, coarse=True):
    """Comparisons of batches of random candidates, and whether they are coarse."""
    steps, rng, found = CoarseSteps(problem), np.random.default_rng(0), []
    for count in batches:
        candidates = [problem.robot.space.to_values(point) for point in rng.random((count, 3))]
        made = list(steps.evaluate(candidates, [coarse] * count))
        found += [(values, *one) for values, one in zip(candidates, made, strict=True)]
    return found


def posed(change):
    """The problem of the pendulum, whose model is changed."""

    def build(values):
        spec = PENDULUM.build(values)
        change(spec)
        return spec

    return Problem(replace(PENDULUM, build=build), pendulum_reference(), horizon=0.5, threads=2)


def test_a_longer_step_is_taken_once_eight_evaluations_agree():
    problem = posed(lambda spec: setattr(spec.option, "timestep", 2e-4))
    found = evaluated(problem, [5, 5, 14, 2])
    assert [coarse for _, _, coarse in found] == [False] * 8 + [True] * 2 + [False] + [True] * 15
    longer = problem.with_longer_step(2.0)
    for values, comparison, coarse in found[8:13]:
        assert comparison.loss == (longer if coarse else problem).evaluate(values).loss
    assert not any(coarse for _, _, coarse in evaluated(problem, [12], coarse=False))


def test_a_robot_that_bears_no_longer_step_keeps_its_own():
    problem = posed(lambda spec: setattr(spec.joint("elbow"), "stiffness", [300.0, 0, 0]))
    found = evaluated(problem, [9, 9, 9])
    assert not any(coarse for _, _, coarse in found)
    values, comparison, _ = found[-1]
    assert comparison.loss == problem.evaluate(values).loss


def test_the_best_is_a_coarse_evaluation_only_where_it_is_clearly_lower():
    entry = {
        "index": 0, "loss": 0.01, "failed": False, "point": [], "values": {}, "note": {}, "evidence": {"loss": 0.01}
    }  # fmt: skip
    own, coarse = (RecordedEvaluation.model_validate(entry | {"note": {"coarse": one}}) for one in (False, True))
    assert (own.at_most, coarse.at_most) == (0.01, pytest.approx(0.011))
