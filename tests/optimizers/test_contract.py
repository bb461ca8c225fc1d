"""The ask/tell contract, for every optimizer."""

import sys

import numpy as np
import pytest
from driving import drive, notes, points
from scipy.optimize import least_squares as scipys

from refused import refusal, says
from swim2real.optimizers import (
    BacktrackingLineSearch,
    BayesianOptimization,
    Candidate,
    CmaEs,
    Evaluation,
    LeastSquares,
    MultiStart,
    Optimizer,
    ProposalSearch,
    RandomSearch,
    ScriptedAdvisor,
    first_point,
    streams,
)
from swim2real.optimizers.callback import CallbackSolver
from swim2real.optimizers.contract import cube_point
from swim2real.optimizers.staged import Stage, Staged
from swimbase.errors import MissingExtraError, OptimizerError

D = 5


def scripted(seed: int) -> ScriptedAdvisor:
    return ScriptedAdvisor(list(streams(seed)[2].random((40, D))))


def random_search(seed: int) -> Optimizer:
    return RandomSearch(D, streams(seed)[1], first_point(D, seed))


def line_search(seed: int) -> Optimizer:
    return BacktrackingLineSearch(scripted(seed), first_point(D, seed))


def proposal_search(seed: int) -> Optimizer:
    return ProposalSearch(scripted(seed), first_point(D, seed))


def bayesopt(seed: int, **settings) -> Optimizer:
    return BayesianOptimization(D, streams(seed)[1], first_point(D, seed), **{"initial": 23, **settings})


def least_squares(seed: int, **settings) -> Optimizer:
    return LeastSquares(first_point(D, seed), streams(seed)[1], **settings)


def multi_start(seed: int) -> Optimizer:
    return MultiStart([first_point(D, seed), np.full(D, 0.5)], streams(seed)[1])


def callback_solver(seed: int) -> Optimizer:
    def solve(first, residuals) -> None:
        scipys(lambda x: residuals(x[None])[0], first, bounds=(0, 1), max_nfev=5)

    return CallbackSolver(first_point(D, seed), streams(seed)[1], solve, "solver")


def staged(seed: int) -> Optimizer:
    stages = Stage("scanned", (0, 1), 1.0, "scan"), Stage("searched", (2, 3, 4), 3.0)
    return Staged(first_point(D, seed), stages, 30, RandomSearch, streams(seed)[1], {})


def cma_es(seed: int, **settings) -> Optimizer:
    return CmaEs(**{"dimension": D, "rng": streams(seed)[1], **settings})


MAKERS = [random_search, line_search, proposal_search, bayesopt, least_squares, multi_start, callback_solver, staged]
marks = {bayesopt: pytest.mark.slow}
every = pytest.mark.parametrize(
    "make", [pytest.param(make, id=make.__name__, marks=marks.get(make, ())) for make in (*MAKERS, cma_es)]
)


def residual(point: np.ndarray) -> np.ndarray:
    return point - 0.3


@every
def test_asking_and_telling_take_turns(make):
    optimizer = make(0)
    middle = Candidate(cube_point(np.full(D, 0.5)))
    assert says(refusal(OptimizerError, optimizer.tell, Evaluation(middle, 1.0)), "tell() without a candidate", "ask()")
    candidate = optimizer.ask()
    assert says(refusal(OptimizerError, optimizer.ask), "ask() was called twice", "tell()")
    other = Evaluation(Candidate(cube_point(1 - candidate.point)), 0.1)
    assert says(refusal(OptimizerError, optimizer.tell, other), "another candidate than the one that was asked last")
    vector = residual(candidate.point)
    right = Evaluation(candidate, 0.5, residual=vector, stages=(vector,))
    optimizer.tell(right)
    assert says(refusal(OptimizerError, optimizer.tell, right), "without a candidate")
    optimizer.ask()


@every
def test_candidates_lie_in_the_unit_cube_and_are_read_only(make):
    told = drive(make(3), 30, residual)
    assert points(told).shape == (30, D)
    assert np.all((points(told) >= 0) & (points(told) <= 1))
    assert not any(one.candidate.point.flags.writeable for one in told)


@every
@pytest.mark.parametrize("seed", [0, 12345])
def test_the_seed_alone_makes_a_run_and_numpys_global_state_is_left_alone(make, seed):
    runs, states = [], []
    for other in (1, 2):
        np.random.seed(other)  # noqa: NPY002
        states.append(np.random.get_state()[1])  # noqa: NPY002
        runs.append(drive(make(seed), 20, residual))
        np.testing.assert_array_equal(np.random.get_state()[1], states[-1])  # noqa: NPY002
    assert points(runs[0]).tobytes() == points(runs[1]).tobytes()
    assert notes(runs[0]) == notes(runs[1])
    assert not np.array_equal(points(drive(make(seed + 1), 5, residual)), points(runs[0])[:5])


@pytest.mark.parametrize("make", MAKERS)
def test_the_run_begins_at_the_first_point_and_says_so(make):
    candidate = make(7).ask()
    np.testing.assert_array_equal(candidate.point, first_point(D, 7))
    assert candidate.note == {"source": "first point"}


@pytest.mark.slow
@every
@pytest.mark.parametrize("failed", [lambda i: i % 3 != 1, lambda i: True], ids=["most", "all"])
def test_failed_evaluations_are_lived_with(make, failed):
    assert points(drive(make(0), 25, residual, failed)).shape == (25, D)


@pytest.mark.parametrize("make", [least_squares, multi_start, callback_solver])
def test_methods_that_need_residuals_say_so(make):
    optimizer = make(0)
    assert optimizer.needs_residual
    said = refusal(OptimizerError, optimizer.tell, Evaluation(optimizer.ask(), 0.1))
    assert says(said, "without ", " residual, which ", " needs")
    if make is not callback_solver:
        optimizer = make(0)
        optimizer.tell(Evaluation(optimizer.ask(), 1.0, failed=True))  # one that failed needs none
        assert optimizer.ask().note.items() >= {"source": "start", "start": 2}.items()


def test_random_search_samples_evenly_and_streams_are_independent():
    sampled = points(drive(random_search(3), 600))
    assert not np.any(np.isin(sampled[1:], first_point(D, 3)))  # a stream of its own
    np.testing.assert_allclose(sampled.mean(axis=0), 0.5, atol=0.05)
    np.testing.assert_allclose(sampled.std(axis=0), np.sqrt(1 / 12), atol=0.02)
    first, optimizer, advisor = (stream.random(4).tolist() for stream in streams(0))
    assert len({tuple(first), tuple(optimizer), tuple(advisor)}) == 3
    assert [stream.random(4).tolist() for stream in streams(np.int64(0))] == [first, optimizer, advisor]


@pytest.mark.parametrize("loss", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("failed", [True, False])
def test_a_loss_that_is_not_finite_is_refused(loss, failed):
    said = refusal(OptimizerError, Evaluation, Candidate(cube_point([0.5])), loss, failed)
    assert says(said, f"the loss is {loss}", "finite")


@pytest.mark.parametrize("seed", [-1, 1.0, True, None, "0"])
def test_a_seed_that_is_no_whole_number_is_refused(seed):
    assert says(refusal(OptimizerError, streams, seed), f"seed is {seed!r}", "a whole number from 0 on")


@pytest.mark.parametrize(
    ("point", "dimension", "part"),
    [([0.5, 1.2], None, "from 0.5 to 1.2"), ([np.nan, 0.2], None, "from nan to nan"),
     ([0.5, 0.5], 3, "(2,); expected (3,)"), ([[0.5]], None, "(1, 1); expected (d,)")],
)  # fmt: skip
def test_points_outside_the_cube_are_refused(point, dimension, part):
    assert part in refusal(OptimizerError, cube_point, point, dimension)


def searched(seed: int, **settings) -> Optimizer:
    return BacktrackingLineSearch(scripted(seed), first_point(D, seed), **settings)


@pytest.mark.parametrize(
    ("make", "settings", "parts"),
    [
        (least_squares, {"difference": 0.6}, ("difference is 0.6", "0.5")), (least_squares, {"radius": 2}, ("radius",)),
        (bayesopt, {"initial": 0}, ("initial is 0", "1")), (bayesopt, {"loss_factor": np.inf}, ("loss_factor is inf",)),
        (cma_es, {"dimension": 1}, ("dimension is 1", "2")), (cma_es, {"population": 3}, ("population is 3", "4")),
        (cma_es, {"sigma": np.nan}, ("sigma is nan", "1")), (searched, {"max_steps": 0}, ("max_steps is 0", "1")),
        (searched, {"decrease_factor": 1.0}, ("decrease_factor is 1.0", "between 0 and 1")),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused(make, settings, parts):
    assert says(refusal(OptimizerError, make, 0, **settings), *parts)


@pytest.mark.parametrize(
    ("make", "missing", "library"),
    [(bayesopt, ["skopt"], "scikit-optimize"), (bayesopt, ["skopt", "threadpoolctl"], "scikit-optimize"),
     (cma_es, ["cma"], "pycma")],
)  # fmt: skip
def test_without_its_library_a_method_says_what_to_install(monkeypatch, make, missing, library):
    for name in [name for name in sys.modules if name.partition(".")[0] == "skopt"]:
        monkeypatch.delitem(sys.modules, name)
    for name in missing:
        monkeypatch.setitem(sys.modules, name, None)
    assert says(refusal(MissingExtraError, make, 0), library, "pip install 'swim2real[compare]'")
