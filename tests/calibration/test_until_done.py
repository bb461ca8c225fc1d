"""A search until it is done: what ends it otherwise, how it goes on, and as the finish of a run that had a budget."""

import contextlib
import json
import shutil
import time

import numpy as np
import pytest
import small_run

from markertrack.track import MarkerTrack
from refused import says
from swim2real.calibration import Problem, RunFolder
from swim2real.calibration.convergence import marker_noise, standing
from swim2real.pipeline import calibrate
from swim2real.report import write_report
from swim2real.settings import CalibrationSettings
from swimbase.errors import ArgumentError, RunError

SECOND = 1 / 60  # min


def search(reference, out, resume=False, most=None, **settings):
    """A run, interrupted after so many evaluations."""
    chosen = CalibrationSettings(protocol="aligned", **{"threads": 1, **settings})

    def stop(progress):
        if most is not None and progress.done >= most and not progress.replayed:
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
    assert [note.source for note in notes[3:6]] == ["random", "first point", "spread"]
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


def test_a_loaded_machine_changes_nothing_but_the_seconds(reference, tmp_path, monkeypatch):
    search(reference, tmp_path / "quiet", budget=14)
    evaluate = Problem.evaluate

    def slowly(problem, values):
        time.sleep(0.1)
        return evaluate(problem, values)

    monkeypatch.setattr(Problem, "evaluate", slowly)
    search(reference, tmp_path / "loaded", budget=14)
    entries = [
        [entry.model_dump(exclude={"seconds"}) for entry in RunFolder(tmp_path / name).record()]
        for name in ("quiet", "loaded")
    ]
    assert entries[0] == entries[1]
    assert sum(entry.seconds for entry in RunFolder(tmp_path / "loaded").record()) > 0.5


def test_a_budget_bounds_a_search_and_leaves_its_method(reference, tmp_path):
    assert search(reference, tmp_path / "run", budget=5).ending == "budget"
    search(reference, tmp_path / "run", resume=True, most=13)
    search(reference, tmp_path / "whole", most=13)
    assert points(tmp_path / "run") == points(tmp_path / "whole")
    settings = RunFolder(tmp_path / "run").settings()
    assert (settings.method, settings.budget, settings.finish, settings.search) == ("multi-start", None, False, 2)


@pytest.mark.parametrize(("ended", "ending"), [({"minutes": SECOND / 10}, "minutes"), ({"most": 3}, "interrupted")])
def test_a_search_that_minutes_or_a_person_ended_isnt_finished(reference, tmp_path, ended, ending):
    search(reference, tmp_path / "run", **ended)
    outcome = RunFolder(tmp_path / "run").outcome()
    assert (outcome.ending, outcome.conclusion) == (ending, "")
    assert outcome.verdict.kind != "good"
    assert "--resume" in outcome.verdict.sentence
    assert outcome.verdict.title in write_report(tmp_path / "run", small_run.ROBOT).read_text()


def test_a_record_of_before_is_replayed(reference, tmp_path):
    """Without an advisor that leads."""
    search(reference, tmp_path / "run", budget=3)
    path = tmp_path / "run" / "settings.json"
    settings = json.loads(path.read_text())
    del settings["search"]
    path.write_text(json.dumps(settings))
    search(reference, tmp_path / "run", resume=True, budget=20)
    assert len(points(tmp_path / "run")) == 20
    assert RunFolder(tmp_path / "run").settings().search == 1


def test_what_a_search_knows_is_said(reference, tmp_path):
    outcome = search(reference, tmp_path / "run", minutes=SECOND)
    run = RunFolder(tmp_path / "run")
    said = standing(run.record(), run.settings(), outcome, small_run.ROBOT.space)
    assert says(said[0], f"isn't finished after {len(run.record())} evaluations", "--resume goes on")
    assert says(outcome.verdict.sentence, "times the noise of the data")
    assert marker_noise([trial.track for trial in reference]) == pytest.approx(0.5e-3 * 2**0.5, rel=0.1)
    assert marker_noise([]) is None
    assert "The search isn&#39;t finished after" in write_report(tmp_path / "run", small_run.ROBOT).read_text()
    done = outcome.model_copy(update={"ending": "done"})
    assert standing(run.record(), run.settings(), done, small_run.ROBOT.space)[0].startswith("the search is done after")


def test_settings_that_end_a_search_are_checked(reference, tmp_path):
    assert (CalibrationSettings().chosen_method, CalibrationSettings().minutes) == ("multi-start", None)
    assert (CalibrationSettings(budget=5).method, CalibrationSettings(method="cma-es").budget) == ("multi-start", 40)
    assert (CalibrationSettings(advisor="files", minutes=2).budget, CalibrationSettings(probes=1).budget) == (40, 40)
    with pytest.raises(ArgumentError, match="first is 'middle'; it must be auto, model, random, or a parameters file"):
        CalibrationSettings(first="middle")
    with pytest.raises(ArgumentError, match="finish needs a budget"):
        CalibrationSettings(finish=True)
    with pytest.raises(ArgumentError, match="minutes is 0 min; it must be finite and above 0"):
        CalibrationSettings(minutes=0)
    search(reference, tmp_path / "run", most=2)
    with pytest.raises(RunError, match=r"method was .multi-start. and is now .random."):
        search(reference, tmp_path / "run", resume=True, method="random", budget=50)
