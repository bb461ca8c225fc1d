"""Robots whose trials are recordings, from a reference to a finished run."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import FLOATER, FLOATER_HIDDEN, PENDULUM, PENDULUM_HIDDEN, floater_reference, pendulum_reference
from run_settings import record_of
from swim2real import pipeline
from swim2real.calibration import RunFolder
from swim2real.optimizers import ScriptedAdvisor
from swim2real.parameters import read_parameters
from swim2real.settings import CalibrationSettings
from swim2real.trials import TrialSet, load_reference, save_reference

calibrate = partial(pipeline.calibrate, on_warning=None)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """As it is read from a folder."""
    folder = tmp_path_factory.mktemp("recordings")
    save_reference(floater_reference(5e-4), folder)
    return load_reference(folder)


def without_seconds(path) -> list[dict]:
    return [{key: value for key, value in entry.items() if key != "seconds"} for entry in record_of(path)]


def settings(method, budget, **more):
    return CalibrationSettings(method=method, budget=budget, threads=2, **more)


@pytest.fixture
def scripted(monkeypatch):
    """An advisor that proposes the same points in every run."""
    points = np.random.default_rng(0).random((20, 3))
    monkeypatch.setattr(pipeline.calibration, "make_advisor", lambda *arguments: ScriptedAdvisor(list(points)))


@pytest.mark.parametrize("method", [
    "least-squares", "line-search",
    *(pytest.param(method, marks=pytest.mark.slow) for method in ("random", "cma-es", "bayesopt", "mujoco-sysid")),
])  # fmt: skip
def test_every_method_runs_and_goes_on(method, reference, tmp_path, scripted):
    calibrate(reference, FLOATER, settings(method, 8), tmp_path / "whole")
    calibrate(reference, FLOATER, settings(method, 5), tmp_path / "parts")
    outcome = calibrate(reference, FLOATER, settings(method, 8), tmp_path / "parts", resume=True).to_json()
    assert without_seconds(tmp_path / "parts") == without_seconds(tmp_path / "whole")
    best = min(entry["loss"] for entry in without_seconds(tmp_path / "whole"))
    assert outcome["fit"]["loss"] == pytest.approx(best)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_hidden_parameters_are_recovered(tmp_path, seed):
    calibrate(floater_reference(1e-4), FLOATER, settings("least-squares", 40, seed=seed), tmp_path / "run")
    found = read_parameters(tmp_path / "run", FLOATER.name, FLOATER.space).values
    assert found == pytest.approx(FLOATER_HIDDEN, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_hidden_parameters_are_recovered_where_the_start_is_unknown(tmp_path, seed):
    """Two recordings of a double pendulum that begin in motion, with half a millimeter of noise."""
    calibrate(
        pendulum_reference(5e-4), PENDULUM, settings("least-squares", 60, horizon=1.0, seed=seed), tmp_path / "run"
    )
    found = read_parameters(tmp_path / "run", PENDULUM.name, PENDULUM.space).values
    assert found == pytest.approx(PENDULUM_HIDDEN, rel=0.02)


@pytest.mark.slow
def test_a_film_of_what_the_robot_cannot_do_ends_by_saying_so_and_what_is_worst(tmp_path):
    reference = pendulum_reference(5e-4)
    first, second = reference
    hasty = MarkerTrack(second.track.times / 2, second.track.positions)
    calibrate(
        TrialSet((first, replace(second, track=hasty)), reference.marker_names), PENDULUM,
        CalibrationSettings(threads=2, horizon=1.0), tmp_path / "run",
    )  # fmt: skip
    outcome = RunFolder(tmp_path / "run").outcome()
    assert (outcome.ending, outcome.verdict.kind) == ("done", "not usable")
    assert re.search(rf"most in trial '{second.name}' by its markers \(\d+\.?\d* mm\)", outcome.verdict.sentence)
    assert re.search(r"\d of \d starts agree, so look at the film", outcome.verdict.sentence)


def first_values(path) -> dict[str, float]:
    return record_of(path)[0]["values"]


def test_recordings_begin_at_the_models_own_values_unless_another_seed_is_given(reference, tmp_path):
    runs = {
        "own": {}, "other": {"seed": 1}, "any": {"first": "random"}, "chosen": {"first": "model", "seed": 1},
    }  # fmt: skip
    for name, options in runs.items():
        calibrate(reference, FLOATER, settings("least-squares", 1, horizon=0.5, **options), tmp_path / name)
    own = FLOATER.space.published
    begun = {name: first_values(tmp_path / name) for name in runs}
    assert begun["own"] == pytest.approx(own)
    assert begun["chosen"] == pytest.approx(own)
    assert begun["other"] != pytest.approx(own, rel=0.1)
    assert begun["any"] != pytest.approx(own, rel=0.1)
    assert [RunFolder(tmp_path / name).settings().first for name in runs] == ["model", "random", "random", "model"]
