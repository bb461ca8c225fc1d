import sys

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from swim2real.errors import MissingExtraError, OptimizerError
from swim2real.optimizers import Candidate, Evaluation, Optimizer, first_point, streams
from swim2real.optimizers.bayesopt import BayesianOptimization

D = 3


def bowl(candidate: Candidate) -> float:
    return float(np.square(candidate.point - 0.3).sum())


def drive(optimizer: Optimizer, count: int, loss=bowl, failed=lambda i: False) -> list[Evaluation]:
    told = []
    for i in range(count):
        candidate = optimizer.ask()
        lost = failed(i)
        told.append(Evaluation(candidate, 1.0 if lost else loss(candidate), lost))
        optimizer.tell(told[-1])
    return told


def points(told: list[Evaluation]) -> np.ndarray:
    return np.array([one.candidate.point for one in told])


def make(seed: int = 0, **settings) -> BayesianOptimization:
    return BayesianOptimization(D, streams(seed)[1], first_point(D, seed), **settings)


@pytest.fixture(scope="module")
def run() -> list[Evaluation]:
    return drive(make(), 17)


def test_a_bowl_is_solved(run):
    assert min(one.loss for one in run[:10]) > 0.01
    assert min(one.loss for one in run) < 0.005


@pytest.mark.slow
def test_a_curved_valley_is_followed():
    def valley(candidate: Candidate) -> float:
        x = 4 * candidate.point - 2
        return float((100 * np.square(x[1:] - x[:-1] ** 2) + np.square(1 - x[:-1])).sum()) / 1000

    told = drive(make(2), 26, valley)
    assert min(one.loss for one in told) < 0.5 * min(one.loss for one in told[:10])


def test_ten_initial_points_then_the_model(run):
    sources = [one.candidate.note["source"] for one in run]
    assert sources[:10] == ["first point"] + ["initial"] * 9
    assert set(sources[10:]) == {"Bayesian optimization"}
    np.testing.assert_array_equal(run[0].candidate.point, first_point(D, 0))


@pytest.mark.slow
def test_a_minimum_in_a_corner_is_found_within_the_cube():
    told = drive(make(1, initial=5), 11, lambda candidate: float(candidate.point.sum()))
    assert np.all((points(told) >= 0) & (points(told) <= 1))
    assert min(one.loss for one in told) < 0.05


@pytest.mark.slow
def test_the_same_losses_give_the_same_points_to_the_last_bit_on_any_number_of_threads(run):
    again = make()
    with threadpool_limits(1):
        for one in run[:12]:
            candidate = again.ask()
            assert candidate.point.tobytes() == one.candidate.point.tobytes()
            assert candidate.note == one.candidate.note
            again.tell(Evaluation(candidate, one.loss))


@pytest.mark.slow
def test_the_model_reads_losses_not_flags(run):
    """A failed evaluation counts with its loss, so its point is avoided."""

    def loss(candidate: Candidate) -> float:
        return 1.0 if candidate.point[0] > 0.5 else bowl(candidate)

    told = drive(make(4), 16, loss)
    assert np.mean(points(told)[:10, 0] > 0.5) > 0.3
    assert np.mean(points(told)[10:, 0] > 0.5) <= 0.2


@pytest.mark.slow
@pytest.mark.parametrize("loss", [1.0, 0.0])
def test_equal_losses_are_lived_with(loss):
    told = drive(make(initial=3), 8, lambda candidate: loss)
    assert len(np.unique(points(told), axis=0)) == 8


@pytest.mark.slow
def test_no_point_is_asked_twice():
    """A lone minimum at a corner makes the model suggest that corner again and again."""
    optimizer = BayesianOptimization(1, streams(5)[1], first_point(1, 5), initial=2)
    told = drive(optimizer, 12, lambda candidate: float(candidate.point[0]))
    assert min(one.loss for one in told) < 1e-6
    assert len(np.unique(points(told))) == 12


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"initial": 0}, "initial is 0; it must be at least 1"),
        ({"loss_factor": 0.0}, "loss_factor is 0.0; it must be finite and above 0"),
        ({"loss_factor": np.inf}, "loss_factor is inf; it must be finite and above 0"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(OptimizerError) as caught:
        make(**settings)
    assert str(caught.value) == message


@pytest.mark.slow
def test_the_unit_of_the_loss_decides_what_the_hedge_draws():
    """The models are the same but for rounding, so until the hedge has gains, suggestions are, too."""
    meters, millimeters = (points(drive(make(initial=4, loss_factor=factor), 9)) for factor in (1.0, 1000.0))
    np.testing.assert_array_equal(meters[:4], millimeters[:4])
    assert not np.allclose(meters, millimeters, atol=1e-3)


@pytest.mark.parametrize("library", ["skopt", "threadpoolctl"])
def test_without_scikit_optimize_a_sentence_says_what_to_install(monkeypatch, library):
    for name in [name for name in sys.modules if name == "skopt" or name.startswith("skopt.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setitem(sys.modules, "skopt", None)
    with pytest.raises(MissingExtraError) as caught:
        make()
    assert (
        str(caught.value) == "method bayesopt needs scikit-optimize; install it with: pip install 'swim2real[compare]'"
    )
