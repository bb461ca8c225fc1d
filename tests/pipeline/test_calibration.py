"""Calibration as scripts use it: settings, first points, protocols, held-out trials, resuming."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from pools import LOGARITHMIC, NAMES
from refused import refusal, says
from run_settings import record_of as record
from swim2real import pipeline
from swim2real.advisor import PhysicsAdvisor
from swim2real.api import compare
from swim2real.calibration import Problem, RunFolder
from swim2real.optimizers import (
    BacktrackingLineSearch,
    BayesianOptimization,
    CmaEs,
    LeastSquares,
    MultiStart,
    RandomSearch,
    Sequel,
    Staged,
    first_point,
)
from swim2real.optimizers.callback import CallbackSolver
from swim2real.pipeline import make_optimizer
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings, ComparisonSettings
from swim2real.trials import Trial, TrialSet
from swimbase.errors import ArgumentError, RunError, TrialError

calibrate = partial(pipeline.calibrate, on_warning=None)
PHYSICS = PhysicsAdvisor(FISH, LOGARITHMIC, 0)

KINDS = {
    "line-search": BacktrackingLineSearch, "random": RandomSearch, "cma-es": CmaEs,
    "bayesopt": BayesianOptimization, "least-squares": LeastSquares, "multi-start": MultiStart,
    "mujoco-sysid": CallbackSolver,
    "staged": Staged,
}  # fmt: skip


def without_seconds(path) -> list[dict]:
    return [{key: value for key, value in entry.items() if key != "seconds"} for entry in record(path)]


def test_trials_of_another_robot_are_refused_with_what_to_type(tmp_path):
    names = ("nose", "mid", "tail")
    track = MarkerTrack(np.arange(30) / 60, np.zeros((30, 3, 2)))
    others = TrialSet((Trial("one", track),), names)
    for begin in (
        lambda: calibrate(others, FISH, CalibrationSettings(), tmp_path / "run"),
        lambda: compare(others, FISH, ComparisonSettings(), tmp_path / "compared"),
        lambda: Problem(FISH, others),
    ):
        said = refusal(TrialError, begin)
        assert says(said, "3 markers (nose, mid, tail)", "robot 'fish' has 9", "give --robot FILE.toml")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"method": "guessing"}, ("'guessing'", "line-search")), ({"advisor": "oracle"}, ("'oracle'", "physics")),
        ({"protocol": "strict"}, ("'strict'", "motion")), ({"scale": "cubic"}, ("'cubic'", "log")),
        ({"max_steps": 0}, ("max_steps is 0", "1")), ({"horizon": float("nan")}, ("horizon is nan s", "0")),
        ({"probes": 2, "method": "random"}, ("probes", "not random")), ({"threads": -1}, ("threads is -1", "0")),
        ({"seed": 1.5}, ("seed is 1.5", "whole number")), ({"seed": True}, ("seed is True", "whole number")),
    ],
    ids=str,
)  # fmt: skip
def test_wrong_settings_are_named(changes, parts):
    assert says(refusal(ArgumentError, CalibrationSettings, **changes), *parts)


def test_the_physics_advisor_leads_multi_start_where_a_response_is_known():
    optimizer = make_optimizer(CalibrationSettings(seed=17), FISH, LOGARITHMIC)
    assert isinstance(optimizer, Sequel)
    np.testing.assert_array_equal(optimizer.ask().point, first_point(len(LOGARITHMIC), 17))
    unknown = replace(FISH, trials=replace(FISH.trials, response=None))
    assert isinstance(make_optimizer(CalibrationSettings(seed=17), unknown, LOGARITHMIC), MultiStart)


@pytest.mark.parametrize(("method", "kind"), KINDS.items())
def test_each_method_has_its_optimizer_which_begins_at_the_first_point_of_the_seed(method, kind):
    optimizer = make_optimizer(CalibrationSettings(method=method, seed=17), FISH, LOGARITHMIC, PHYSICS, led=False)
    assert isinstance(optimizer, kind)
    if method != "cma-es":
        np.testing.assert_array_equal(optimizer.ask().point, first_point(len(LOGARITHMIC), 17))


def test_stages_run_and_keep_their_plan(pool, tmp_path):
    calibrate(pool, FISH, CalibrationSettings(method="staged", budget=8, threads=2), tmp_path)
    sources = [entry["note"].get("stage") for entry in record(tmp_path)]
    assert sources[0] is None
    assert "stiffness" in sources
    with pytest.raises(ArgumentError, match=r"budget was 8 and is now 9; .*begun anew"):
        calibrate(pool, FISH, CalibrationSettings(method="staged", budget=9, threads=2), tmp_path, resume=True)


def test_a_damaged_proposal_on_record_is_told(pool, tmp_path):
    calibrate(pool, FISH, CalibrationSettings(budget=2), tmp_path / "run")
    entries = record(tmp_path / "run")
    del entries[1]["note"]["proposal"]["point"]
    (tmp_path / "run" / "record.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    with pytest.raises(RunError, match=r"record.jsonl, line 2: 'note.proposal.point' is missing"):
        calibrate(pool, FISH, CalibrationSettings(budget=3), tmp_path / "run", resume=True)


def test_held_out_trials_arent_fitted_but_evaluated(pool, tmp_path):
    chosen = CalibrationSettings(method="random", budget=1, hold_out=(NAMES[0],))
    outcome = calibrate(pool, FISH, chosen, tmp_path / "run").to_json()
    assert tuple(outcome["fit"]["trials"]) == (NAMES[1],)
    assert tuple(outcome["held_out"]["trials"]) == (NAMES[0],)
    assert set(outcome["trials"]) == set(NAMES)
    (entry,) = record(tmp_path / "run")
    assert tuple(entry["evidence"]["trials"]) == (NAMES[1],)
    assert RunFolder(tmp_path / "run").settings().hold_out == (NAMES[0],)


def test_an_unknown_trial_to_hold_out_is_named(pool, tmp_path):
    with pytest.raises(TrialError, match=r"no trial is named 'f1_61'; .* did you mean 'f1_60'\?"):
        calibrate(pool, FISH, CalibrationSettings(hold_out=("f1_61",)), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def begun(pool, tmp_path_factory):
    """A run of random search with one evaluation. Nothing may change it."""
    path = tmp_path_factory.mktemp("begun") / "run"
    calibrate(pool, FISH, CalibrationSettings(method="random", budget=1), path)
    return path


def test_a_run_is_begun_once_and_goes_on_with_its_own_reference(begun, pool):
    before = (begun / "record.jsonl").read_bytes()
    with pytest.raises(RunError, match="holds a run already; go on with --resume"):
        calibrate(pool, FISH, CalibrationSettings(method="random", budget=1), begun)
    with pytest.raises(RunError, match='method was "random" and is now "multi-start"'):
        calibrate(pool, FISH, CalibrationSettings(budget=2), begun, resume=True)
    other = TrialSet((replace(pool.trials[0], name="f1_21"), pool.trials[1]), pool.marker_names)
    with pytest.raises(RunError, match="can't go on: it was made with other trials"):
        calibrate(other, FISH, CalibrationSettings(method="random", budget=2), begun, resume=True)
    assert (begun / "record.jsonl").read_bytes() == before
