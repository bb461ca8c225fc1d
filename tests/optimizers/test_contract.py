"""The ask/tell contract, for every optimizer."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.optimize import least_squares as scipys

from swim2real.errors import OptimizerError
from swim2real.optimizers import (
    BacktrackingLineSearch,
    BayesianOptimization,
    Candidate,
    CmaEs,
    Evaluation,
    LeastSquares,
    Optimizer,
    RandomSearch,
    ScriptedAdvisor,
    first_point,
    streams,
)
from swim2real.optimizers.callback import CallbackSolver
from swim2real.optimizers.contract import cube_point

D = 5


def scripted(seed: int) -> ScriptedAdvisor:
    return ScriptedAdvisor(list(streams(seed)[2].random((40, D))))


def random_search(seed: int) -> Optimizer:
    return RandomSearch(D, streams(seed)[1], first_point(D, seed))


def line_search(seed: int) -> Optimizer:
    return BacktrackingLineSearch(scripted(seed), first_point(D, seed))


def bayesopt(seed: int) -> Optimizer:
    return BayesianOptimization(D, streams(seed)[1], first_point(D, seed), initial=23)


def least_squares(seed: int) -> Optimizer:
    return LeastSquares(first_point(D, seed), streams(seed)[1])


def callback_solver(seed: int) -> Optimizer:
    def solve(first, residuals) -> None:
        scipys(lambda x: residuals(x[None])[0], first, bounds=(0, 1), max_nfev=5)

    return CallbackSolver(first_point(D, seed), streams(seed)[1], solve, "solver")


def cma_es(seed: int) -> Optimizer:
    return CmaEs(D, streams(seed)[1])


MAKERS = [random_search, line_search, bayesopt, least_squares, callback_solver]


def _parameters(makers: Sequence[Callable[[int], Optimizer]]) -> pytest.MarkDecorator:
    marks = {bayesopt: pytest.mark.slow}
    parameters = [pytest.param(make, id=make.__name__, marks=marks.get(make, ())) for make in makers]
    return pytest.mark.parametrize("make", parameters)


every = _parameters([*MAKERS, cma_es])
from_the_first_point = _parameters(MAKERS)


def loss_of(candidate: Candidate) -> float:
    return float(np.square(candidate.point - 0.3).sum())


def evaluate(candidate: Candidate, failed: bool = False) -> Evaluation:
    residual = np.ones(D) if failed else candidate.point - 0.3
    return Evaluation(candidate, 1.0 if failed else loss_of(candidate), failed, residual=residual)


def drive(optimizer: Optimizer, count: int, failed: Callable[[int], bool] = lambda i: False) -> np.ndarray:
    points = []
    for i in range(count):
        candidate = optimizer.ask()
        points.append(candidate.point)
        optimizer.tell(evaluate(candidate, failed(i)))
    return np.array(points)


@every
def test_asking_twice_is_refused(make):
    optimizer = make(0)
    optimizer.ask()
    with pytest.raises(
        OptimizerError, match=r"^ask\(\) was called twice; tell\(\) the evaluation of the last candidate"
    ):
        optimizer.ask()


@every
def test_telling_without_asking_is_refused(make):
    optimizer = make(0)
    with pytest.raises(OptimizerError, match=r"^tell\(\) without a candidate; ask\(\) for one first$"):
        optimizer.tell(Evaluation(Candidate(cube_point(np.full(D, 0.5))), 1.0))
    candidate = optimizer.ask()
    optimizer.tell(evaluate(candidate))
    with pytest.raises(OptimizerError, match="without a candidate"):
        optimizer.tell(evaluate(candidate))


@every
def test_telling_of_another_candidate_is_refused_and_the_right_one_still_counts(make):
    optimizer = make(0)
    candidate = optimizer.ask()
    other = Candidate(cube_point(1 - candidate.point))
    with pytest.raises(OptimizerError, match="evaluation of another candidate than the one that was asked last"):
        optimizer.tell(Evaluation(other, 0.1))
    optimizer.tell(evaluate(candidate))
    optimizer.ask()


@every
def test_candidates_lie_in_the_unit_cube_and_are_read_only(make):
    optimizer = make(3)
    for _ in range(30):
        candidate = optimizer.ask()
        assert candidate.point.shape == (D,)
        assert np.all((candidate.point >= 0) & (candidate.point <= 1))
        with pytest.raises(ValueError, match="read-only"):
            candidate.point[0] = 0.0
        optimizer.tell(evaluate(candidate))


@every
@pytest.mark.parametrize("seed", [0, 1, 12345])
def test_one_seed_gives_one_run(make, seed):
    np.testing.assert_array_equal(drive(make(seed), 20), drive(make(seed), 20))


@every
def test_different_seeds_differ(make):
    assert not np.array_equal(drive(make(0), 5), drive(make(1), 5))


@from_the_first_point
def test_the_run_begins_at_the_first_point_and_says_so(make):
    candidate = make(7).ask()
    np.testing.assert_array_equal(candidate.point, first_point(D, 7))
    assert candidate.note == {"source": "first point"}


@pytest.mark.slow
@every
def test_failed_evaluations_are_lived_with(make):
    points = drive(make(0), 25, failed=lambda i: i % 3 != 1)
    assert points.shape == (25, D)
    assert drive(make(0), 25, failed=lambda i: True).shape == (25, D)


@every
def test_numpys_global_random_state_is_left_alone(make):
    np.random.seed(42)  # noqa: NPY002
    expected = np.random.random(3)  # noqa: NPY002
    np.random.seed(42)  # noqa: NPY002
    drive(make(0), 10)
    np.testing.assert_array_equal(np.random.random(3), expected)  # noqa: NPY002


@every
def test_numpys_global_random_state_has_no_say(make):
    np.random.seed(1)  # noqa: NPY002
    one = drive(make(0), 10)
    np.random.seed(2)  # noqa: NPY002
    np.testing.assert_array_equal(drive(make(0), 10), one)


@pytest.mark.parametrize("loss", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("failed", [True, False])
def test_a_loss_that_is_not_finite_is_refused(loss, failed):
    with pytest.raises(OptimizerError, match=rf"^the loss is {loss}; a failed evaluation needs a finite one, too$"):
        Evaluation(Candidate(cube_point([0.5])), loss, failed)


def test_the_first_point_depends_on_the_seed_alone():
    np.testing.assert_array_equal(first_point(16, 3), first_point(16, 3))
    assert not np.array_equal(first_point(16, 3), first_point(16, 4))
    starts = [make(3).ask().point for make in MAKERS]
    for start in starts:
        np.testing.assert_array_equal(start, first_point(D, 3))
    assert not np.any(np.isin(drive(random_search(3), 20)[1:], first_point(D, 3)))  # its own stream


def test_streams_are_independent_and_repeat():
    first, optimizer, advisor = (stream.random(4).tolist() for stream in streams(0))
    assert len({tuple(first), tuple(optimizer), tuple(advisor)}) == 3
    assert [stream.random(4).tolist() for stream in streams(np.int64(0))] == [first, optimizer, advisor]


@pytest.mark.parametrize("seed", [-1, 1.0, True, None, "0"])
def test_a_seed_that_is_no_whole_number_is_refused(seed):
    with pytest.raises(OptimizerError) as caught:
        streams(seed)
    assert str(caught.value) == f"seed is {seed!r}; it must be a whole number from 0 on"


@pytest.mark.parametrize(
    ("point", "dimension", "message"),
    [
        ([0.5, 1.2], None, "a point must lie in the unit cube, got coordinates from 0.5 to 1.2"),
        ([np.nan, 0.2], None, "a point must lie in the unit cube, got coordinates from nan to nan"),
        ([0.5, 0.5], 3, "a point has shape (2,); expected (3,)"),
        ([[0.5]], None, "a point has shape (1, 1); expected (d,)"),
    ],
)
def test_points_outside_the_cube_are_refused(point, dimension, message):
    with pytest.raises(OptimizerError) as caught:
        cube_point(point, dimension)
    assert str(caught.value) == message
