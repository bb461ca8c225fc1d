"""The trial to film next: expected volumes, trials that a pendulum's motor or a fish can do, refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import toy

from motorline.commands import FISH as COLUMN
from motorline.commands import read_table
from recorded import PENDULUM, PENDULUM_HIDDEN, PENDULUM_SPACE, blank, recorded, telling
from refused import refusal, says
from run_settings import settings_of
from swim2real.calibration import Problem, RunFolder, minimize
from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import IDENTIFIABILITY, identify
from swim2real.identification.next_trial import (
    FittingSets,
    expected_reduction,
    fitting_sets,
    judged_trials,
    simulated_trial,
    write_next,
)
from swim2real.identification.possible_trials import possible_trials
from swim2real.optimizers import RandomSearch, streams
from swim2real.robots.fish import FISH
from swim2real.settings import IdentifiabilitySettings
from swim2real.trials import Signals, TrialSet
from swimbase.errors import RunError

ROBOT = telling(PENDULUM, start="raised", sensors=())  # its motor follows a table


def trembling() -> TrialSet:
    """A recording of a pendulum that trembles about where it hangs, so that hardly anything of its friction shows."""
    times = np.arange(0.0, 1.2, 0.02)
    torques = Signals(times, ["torque"], np.where(np.arange(60) % 4 < 2, 0.03, -0.03)[:, None])
    hangs = {"shoulder": 0.0, "elbow": 0.0}
    return recorded(ROBOT, PENDULUM_HIDDEN, [blank(ROBOT, "still", 1.2, start=hangs, controls=torques)], 1e-3)


def make_run(folder, reference, robot=ROBOT, start=PENDULUM_HIDDEN):
    problem, space = Problem(robot, reference, threads=2), robot.space
    run = RunFolder(folder)
    with run.locked():
        run.begin(settings_of(problem, reference, budget=2, seed=0))
        minimize(problem, space, RandomSearch(len(space), streams(0)[1], space.to_cube(start)), 2, run)
    return reopen(folder, reference, robot, 2)


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    run = make_run(tmp_path_factory.mktemp("next") / "run", trembling())
    identify(run, IdentifiabilitySettings(rounds=1))
    return run


def test_the_volume_is_that_of_gauss_and_of_nothing_where_nothing_is_told():
    rng = np.random.default_rng(0)
    points = rng.multivariate_normal(np.full(3, 0.5), 0.01 * (np.eye(3) + 0.5), 400)
    slopes, weight = rng.normal(size=(12, 3)), 30.0
    volume, widths = expected_reduction(points, points @ slopes.T, weight)
    before = np.cov(points.T)
    after = np.linalg.inv(np.linalg.inv(before) + weight * slopes.T @ slopes)
    assert volume == pytest.approx(np.sqrt(np.linalg.det(after) / np.linalg.det(before)), rel=1e-9)
    np.testing.assert_allclose(widths, np.sqrt(np.diag(after) / np.diag(before)), rtol=1e-9)
    assert expected_reduction(points, np.zeros((400, 5)), weight)[0] == pytest.approx(1.0)
    points = np.random.default_rng(1).uniform(-1, 1, (500, 1))
    volume, _ = expected_reduction(points, np.abs(points), 1e6)
    assert volume > 0.95
    points = np.random.default_rng(2).random((50, 2)) * [1.0, 0.0]
    volume, widths = expected_reduction(points, points[:, :1], 100.0)
    assert 0 < volume < 1
    assert widths[0] == pytest.approx(volume)
    assert widths[1] == 1.0


def test_of_a_pendulum_that_hung_still_a_new_motion_is_proposed_and_sent(studied, tmp_path):
    sets = fitting_sets(studied)
    possible = possible_trials(studied.problem, studied.space.to_values(sets.lowest))
    judged = list(judged_trials(studied, sets, possible))
    content = write_next(tmp_path / "next", studied, judged)
    best = content["candidates"][0]
    repeat = next(one for one in content["candidates"] if one["label"] == "repeat still")
    assert best["label"].startswith("torque: ")
    assert best["volume"] < 0.5 * repeat["volume"]
    assert 2 ** (-3 / 2) < 1.05 * repeat["volume"] < 0.8  # twice the same, for up to three parameters
    assert set(best["widths"]) == set(PENDULUM_SPACE.names)
    assert json.loads((tmp_path / "next" / "next.json").read_text()) == content
    table = read_table(tmp_path / "next" / "next.csv")
    chosen = next(one for one in possible if one.label == best["label"])
    np.testing.assert_allclose(table.column("torque_Nm"), chosen.columns["torque"])
    assert np.abs(table.column("torque_Nm")).max() <= 0.03
    again = list(judged_trials(studied, sets, possible[:2]))
    assert [one.volume for one in again] == [one.volume for one in judged[:2]]


def test_a_trial_that_cant_be_compared_is_left_out_with_the_reason(studied):
    sets = fitting_sets(studied)
    possible = possible_trials(studied.problem, studied.space.to_values(sets.lowest))[:1]
    still = [replace(possible[0], trial=replace(possible[0].trial, controls=None))]
    assert "has no controls" in next(judged_trials(studied, sets, still)).reason


def test_where_markers_show_the_start_a_trial_begins_there():
    reference = trembling()
    moved = telling(ROBOT, start="markers")
    trials = TrialSet(tuple(replace(one, start={}) for one in reference), reference.marker_names)
    problem = Problem(moved, trials)
    made = simulated_trial(problem, possible_trials(problem, PENDULUM_HIDDEN)[0], PENDULUM_HIDDEN)
    np.testing.assert_allclose(made.trials[0].track.positions[0], trials.trials[0].track.positions[0], atol=2e-3)


def test_without_a_complete_study_of_this_run_it_is_refused(tmp_path, studied):
    run = make_run(tmp_path / "run", trembling())
    assert says(refusal(RunError, fitting_sets, run), "has no study", f"swim2real identify {run.folder.path}")
    study = json.loads((studied.folder.path / IDENTIFIABILITY).read_text())
    for change, words in (
        ({"complete": False}, ("isn't complete", "identify")),
        ({"horizon": 0.1}, ("another horizon", "0.1", "--again")),
        ({"weight": None}, ("'weight' is null", "--again")),
        ({"draws": [[0.5, 0.5, 0.5]]}, ("1 sets", "14 or more")),
        ({"draws": [[0.5, 0.5]]}, ("another number of coordinates", "--again")),
    ):
        (run.folder.path / IDENTIFIABILITY).write_text(json.dumps(study | change))
        assert says(refusal(RunError, fitting_sets, run), IDENTIFIABILITY, *words)
    nothing = Problem(toy.ROBOT, toy.make_reference())
    assert says(refusal(RunError, possible_trials, nothing, toy.HIDDEN), "nothing drives robot 'toy'")


@pytest.mark.slow
def test_beats_of_the_fish_are_sent_as_speeds(pool, tmp_path):
    problem = Problem(FISH, pool)
    point = FISH.space.to_cube(FISH.space.published)
    rng = np.random.default_rng(0)
    sets = FittingSets(np.clip(point + 0.03 * rng.standard_normal((60, len(point))), 0, 1), point, 1e6)
    run = make_run(tmp_path / "run", pool, FISH, FISH.space.published)
    possible = possible_trials(problem, FISH.space.published)
    judged = list(judged_trials(run, sets, possible[:1] + possible[-1:]))
    content = write_next(tmp_path, run, judged)
    assert all(0 < one["volume"] < 1 for one in content["candidates"])
    assert read_table(tmp_path / "next.csv").columns == (COLUMN,)
