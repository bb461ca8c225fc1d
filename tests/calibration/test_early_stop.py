"""What makes evaluations shorter changes nothing about what is accepted."""

from dataclasses import replace

import numpy as np
import pytest
import small_run

from swim2real.calibration import Problem, RunFolder, minimize
from swim2real.objective import evidence
from swim2real.optimizers import BacktrackingLineSearch, ScriptedAdvisor, first_point, streams
from swim2real.simulation import Simulator

DIMENSION = len(small_run.ROBOT.space)
BUDGET = 14
BAD = {"fluid_slender_drag": 9.0, "fluid_kutta_lift": 3.0, "motor_arm_length": 0.045, "hinge_damping_0": 0.01}


def searched(problem, folder, early_stop=False):
    """Record of a line search along random proposals."""
    advisor = ScriptedAdvisor(list(streams(1)[2].random((BUDGET, DIMENSION))))
    search = BacktrackingLineSearch(advisor, first_point(DIMENSION, 1), early_stop=early_stop)
    run = RunFolder(folder)
    with run.locked():
        run.begin({"budget": BUDGET})
        best = minimize(problem, small_run.ROBOT.space, search, BUDGET, run)
    return run.record(), best


@pytest.fixture(scope="module")
def in_full(problem, tmp_path_factory):
    return searched(problem, tmp_path_factory.mktemp("full") / "run")


def accepted(entries):
    best, kept = np.inf, []
    for entry in entries:
        if entry["loss"] < best:
            best = entry["loss"]
            kept.append(entry["index"])
    return kept


@pytest.mark.slow
def test_an_early_stop_accepts_the_same_steps_with_the_same_losses(problem, in_full, tmp_path):
    entries, best = searched(problem, tmp_path / "run", early_stop=True)
    assert accepted(entries) == accepted(in_full[0])
    assert (best["loss"], best["values"]) == (in_full[1]["loss"], in_full[1]["values"])
    stopped = [entry for entry in entries if entry["lower_bound"]]
    assert stopped, "no evaluation stopped early"
    for entry, whole in zip(entries, in_full[0], strict=True):
        assert entry["point"] == whole["point"]
        if entry["lower_bound"]:
            assert entry["loss"] <= whole["loss"]
            assert entry["evidence"]["skipped"] == len(problem.prepared) - len(entry["evidence"]["trials"]) > 0
        else:
            assert (entry["loss"], entry["evidence"]) == (whole["loss"], whole["evidence"])


def test_a_loss_below_the_limit_is_whole(problem):
    whole = problem.evaluate(BAD)
    assert evidence(problem.evaluate(BAD, stop_above=whole.loss)) == evidence(whole)


def test_how_far_an_evaluation_goes_doesnt_depend_on_threads(reference):
    found = [
        problem.evaluate(BAD, stop_above=1e-4)
        for problem in (small_run.make_problem(reference, threads) for threads in (1, 2))
    ]
    assert [one.skipped for one in found] == [1, 1]
    assert found[0].lower_bound
    assert [trial.name for trial in found[0].trials] == ["f1_70"]  # the shortest period
    assert evidence(found[0]) == evidence(found[1])


def test_a_divergence_ends_an_evaluation_as_failed(reference, monkeypatch):
    problem = small_run.make_problem(reference)
    robot = replace(small_run.ROBOT, build=_shaking)
    problem.simulator = Simulator(robot, 2, step="engine")
    found = problem.evaluate(BAD, stop_above=1e-4)
    assert found.divergence is not None
    assert (found.loss, found.lower_bound) == (1.0, False)


def _shaking(values):
    spec = small_run.ROBOT.build(values)
    spec.option.timestep = 0.1
    return spec


@pytest.mark.slow
def test_cycles_instead_of_full_lengths_accept_the_same_steps(reference, tmp_path, new_fluid_law):
    if new_fluid_law:
        pytest.skip("with the fluid law of this engine swims don't repeat exactly")
    simulators = {f"full-{full}": Simulator(small_run.ROBOT, 2, full_length=full) for full in (False, True)}
    (in_cycles, cycles_best), (entries, best) = (
        searched(Problem(small_run.ROBOT, reference, "aligned", simulator=simulator), tmp_path / name)
        for name, simulator in simulators.items()
    )
    assert accepted(entries) == accepted(in_cycles)
    assert best["loss"] == pytest.approx(cycles_best["loss"], abs=2e-4)
    np.testing.assert_allclose([e["loss"] for e in entries], [e["loss"] for e in in_cycles], atol=3e-3)
