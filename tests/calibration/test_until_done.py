"""A search without a budget: cut off by minutes, gone on with, and as the finish of a run that had a budget."""

import contextlib
import json
import shutil

import numpy as np
import pytest
import small_run

from markertrack.track import MarkerTrack
from refused import says
from swim2real.calibration import RunFolder
from swim2real.calibration.convergence import marker_noise, standing
from swim2real.pipeline import calibrate
from swim2real.report import read_run, write_report
from swim2real.report import standing as standing_of
from swim2real.settings import CalibrationSettings
from swimbase.errors import ArgumentError, RunError

SECOND = 1 / 60  # min


def search(reference, out, resume=False, most=None, **settings):
    """A run, interrupted after so many evaluations."""
    chosen = CalibrationSettings(protocol="aligned", **{"threads": 1, **settings})

    def stop(progress):
        if most is not None and progress.done >= most:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt):
        return calibrate(reference, small_run.ROBOT, chosen, out, resume=resume, on_progress=stop, on_warning=None)


def points(out):
    return [entry.point for entry in RunFolder(out).record()]


def test_a_run_with_a_budget_is_finished_and_a_search_that_was_cut_off_goes_on(reference, tmp_path):
    search(reference, tmp_path / "run", budget=4, method="random")
    begun = points(tmp_path / "run")
    assert search(reference, tmp_path / "run", resume=True, minutes=SECOND).ending == "minutes"
    first = points(tmp_path / "run")
    assert search(reference, tmp_path / "run", resume=True, minutes=SECOND, threads=2).ending == "minutes"
    both = points(tmp_path / "run")
    assert both[: len(first)] == first
    assert first[:4] == begun
    assert len(both) > len(first) > 4
    settings = RunFolder(tmp_path / "run").settings()
    assert (settings.method, settings.budget, settings.finish) == ("random", 4, True)
    notes = [entry.note for entry in RunFolder(tmp_path / "run").record()]
    assert [note.source for note in notes[3:6]] == ["random", "first point", "start"]
    best = min(RunFolder(tmp_path / "run").record()[:4], key=lambda entry: entry.loss)
    assert both[4] == best.point


@pytest.mark.slow
def test_a_search_is_the_same_on_any_number_of_cores(reference, tmp_path):
    for threads in (1, 2):
        search(reference, tmp_path / str(threads), most=16, threads=threads)
    assert len(points(tmp_path / "1")) == 16
    assert points(tmp_path / "1") == points(tmp_path / "2")


@pytest.mark.slow
def test_a_method_with_a_budget_is_finished_as_one_command(reference, tmp_path):
    """As if it had been finished later, from the values of another run."""
    search(reference, tmp_path / "before", method="random", budget=2, seed=5)
    begun = tmp_path / "before"
    search(reference, tmp_path / "one", first=str(begun), method="random", budget=4, finish=True, most=12)
    assert RunFolder(tmp_path / "one").record()[0].values == pytest.approx(read_best(begun), rel=1e-12)
    search(reference, tmp_path / "two", first=str(begun), method="random", budget=4)
    shutil.rmtree(begun)  # the values are in the settings
    search(reference, tmp_path / "two", resume=True, most=12)
    assert points(tmp_path / "one") == points(tmp_path / "two")
    assert len(points(tmp_path / "one")) == 12
    settings = [RunFolder(tmp_path / name).settings() for name in ("one", "two")]
    assert [(one.budget, one.finish, one.first) for one in settings] == [(4, True, "file")] * 2


def read_best(run):
    return json.loads((run / "best.json").read_text())["parameters"]


def test_fast_motion_is_no_noise():
    times = np.arange(240) / 60
    swing = 0.2 * np.sin(2 * np.pi * 3 * times[:, None, None] + [[0, 1], [2, 3]])
    track = MarkerTrack(times, swing + np.random.default_rng(0).normal(0, 0.5e-3, swing.shape))
    assert marker_noise([track]) == pytest.approx(0.5e-3 * 2**0.5, rel=0.1)


@pytest.fixture(scope="module")
def cut_off(reference, tmp_path_factory):
    """A search of a second and its outcome. Don't write into its folder."""
    out = tmp_path_factory.mktemp("cut off") / "run"
    return out, search(reference, out, minutes=SECOND)


def test_what_a_search_knows_is_said(reference, cut_off):
    out, outcome = cut_off
    run = RunFolder(out)
    said = standing(run.record(), run.settings(), outcome, small_run.ROBOT.space)
    assert says(said[0], f"cut off after {len(run.record())} evaluations", "--resume goes on")
    *_, scale = standing_of(read_run(out, small_run.ROBOT))
    assert says(scale, "times the noise of the data")
    assert marker_noise([trial.track for trial in reference]) == pytest.approx(0.5e-3 * 2**0.5, rel=0.1)
    assert marker_noise([]) is None
    assert "The search was cut off after" in write_report(out, small_run.ROBOT).read_text()
    done = outcome.model_copy(update={"ending": "done"})
    assert standing(run.record(), run.settings(), done, small_run.ROBOT.space)[0].startswith("the search is done after")


def test_what_ends_a_search_is_either_a_budget_or_minutes(reference, cut_off):
    assert CalibrationSettings().chosen_method == "multi-start"
    assert (CalibrationSettings(budget=5).method, CalibrationSettings(method="cma-es").budget) == ("line-search", 40)
    assert CalibrationSettings(advisor="files").budget == 40
    with pytest.raises(
        ArgumentError, match=r"minutes is 2, which is for a search until it is done; .* budget of 40 ev"
    ):
        CalibrationSettings(advisor="files", minutes=2)
    with pytest.raises(ArgumentError, match="first is 'middle'; it must be auto, model, random, or a parameters file"):
        CalibrationSettings(first="middle")
    with pytest.raises(ArgumentError, match="finish needs a budget"):
        CalibrationSettings(finish=True)
    assert CalibrationSettings(advisor="files", finish=True, minutes=2).budget == 40
    with pytest.raises(ArgumentError, match="minutes is 0 min; it must be finite and above 0"):
        CalibrationSettings(minutes=0)
    with pytest.raises(RunError, match=r"method was .multi-start. and is now .line-search."):
        search(reference, cut_off[0], resume=True, budget=50)
    assert json.loads((cut_off[0] / "settings.json").read_text())["budget"] is None
