import numpy as np
import pytest
from driving import bowl, drive, lowest, notes, points
from threadpoolctl import threadpool_limits

from swim2real.optimizers import Evaluation, first_point, streams
from swim2real.optimizers.bayesopt import BayesianOptimization

D = 3


def make(seed: int = 0, dimension: int = D, **settings) -> BayesianOptimization:
    return BayesianOptimization(dimension, streams(seed)[1], first_point(dimension, seed), **settings)


@pytest.fixture(scope="module")
def run() -> list[Evaluation]:
    return drive(make(), 17)


def test_the_model_follows_the_initial_points():
    told = drive(make(initial=4), 6)
    assert notes(told, "source") == ["first point", *["initial"] * 3, *["Bayesian optimization"] * 2]


@pytest.mark.slow
def test_a_bowl_is_solved(run):
    assert lowest(run[:10]) > 0.01
    assert lowest(run) < 0.005


@pytest.mark.slow
def test_a_minimum_in_a_corner_is_found_within_the_cube_and_no_point_is_asked_twice():
    told = drive(make(1, initial=5), 11, np.sum)
    assert np.all((points(told) >= 0) & (points(told) <= 1))
    assert lowest(told) < 0.05
    told = drive(make(5, 1, initial=2), 12, np.sum)  # the model suggests the corner again and again
    assert lowest(told) < 1e-6
    assert len(np.unique(points(told))) == 12


@pytest.mark.slow
def test_the_same_losses_give_the_same_points_to_the_last_bit_on_any_number_of_threads(run):
    with threadpool_limits(1):
        again = drive(make(), 12)
    assert points(again).tobytes() == points(run[:12]).tobytes()
    assert notes(again) == notes(run[:12])


@pytest.mark.slow
def test_the_model_reads_losses_not_flags():
    """A failed evaluation counts with its loss, so its point is avoided."""
    told = drive(make(4), 16, lambda point: 1.0 if point[0] > 0.5 else bowl(point))
    assert np.mean(points(told)[:10, 0] > 0.5) > 0.3
    assert np.mean(points(told)[10:, 0] > 0.5) <= 0.2
