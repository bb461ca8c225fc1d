"""What `import swim2real` offers."""

import inspect
import subprocess
import sys

import mujoco
import numpy as np
import pytest

import swim2real
from recorded import PENDULUM, pendulum_reference
from swim2real.robots.fish import FISH


@pytest.mark.parametrize("name", swim2real.__all__)
def test_every_name_is_there_and_says_what_it_is(name):
    assert inspect.getdoc(getattr(swim2real, name))
    assert name in dir(swim2real)


def test_the_names_are_sorted_and_others_are_refused():
    assert swim2real.__all__ == sorted(swim2real.__all__)
    with pytest.raises(AttributeError, match="attribute robot_from_file"):
        swim2real.robot_from_file  # noqa: B018


def test_importing_it_imports_nothing_else():
    code = "import sys, swim2real; print(*[m for m in sys.modules if m.startswith('swim2real.') or m == 'numpy'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, "")


def test_a_run_and_swims_from_settings_to_what_they_leave(tmp_path):
    reference = pendulum_reference(1e-3)
    settings = swim2real.CalibrationSettings(method="random", budget=3, threads=1)
    outcome = swim2real.calibrate(reference, PENDULUM, settings, tmp_path / "run", on_warning=None)
    assert isinstance(outcome, swim2real.Outcome)
    compared = swim2real.evaluate(PENDULUM.space.published, reference, PENDULUM)
    assert isinstance(compared, swim2real.Comparison)
    assert compared.loss > 0
    (swim,) = swim2real.simulate(FISH.space.published, FISH, [1.5], seconds=0.1, from_rest=True, threads=1)
    assert swim.track.frame_count == 7


@pytest.fixture(scope="module")
def reference():
    return pendulum_reference(1e-3)


@pytest.fixture(scope="module")
def run(reference, tmp_path_factory):
    """A run that its callback has stopped, what it heard, and its outcome."""
    heard: list[swim2real.Progress] = []

    def hear(progress: swim2real.Progress) -> None:
        heard.append(progress)
        if len(heard) == 5:
            progress.stop()

    folder = tmp_path_factory.mktemp("stopped") / "run"
    settings = swim2real.CalibrationSettings(horizon=0.5, threads=1)
    return folder, heard, swim2real.calibrate(reference, PENDULUM, settings, folder, on_progress=hear, on_warning=None)


def test_a_callback_sees_the_values_and_can_stop_a_run_that_still_concludes(run, reference):
    folder, heard, outcome = run
    assert len(heard) == outcome.evaluations == 5
    assert outcome.ending == "stopped"
    assert "it was stopped" in outcome.verdict.sentence
    assert outcome.values == heard[-1].values == min(heard, key=lambda one: one.best).values
    assert heard[-1].error == pytest.approx(outcome.fit.error, rel=1e-6)
    table = outcome.to_dataframe()
    assert list(table.index) == list(PENDULUM.space.names)
    assert dict(table["value"]) == outcome.values
    assert list(table.columns) == ["value", "low", "high"]
    settings = swim2real.CalibrationSettings(horizon=0.5, threads=1)
    goes_on = swim2real.calibrate(
        reference, PENDULUM, settings, folder, resume=True, on_warning=None,
        on_progress=lambda progress: progress.stop() if progress.done >= 6 else None,
    )  # fmt: skip
    assert (goes_on.evaluations, goes_on.ending) == (6, "stopped")


def test_what_is_shown_in_a_notebook_is_short_and_escaped(run, reference):
    *_, outcome = run
    for thing, words in (
        (reference, ("TrialSet of 2 trials", "3 markers")), (reference.trials[0], ("Trial a", "frames")),
        (PENDULUM, ("Robot pendulum", "3 parameters")), (outcome, ("Outcome", "after 5 evaluations")),
    ):  # fmt: skip
        assert len(repr(thing)) < 200
        assert all(word in repr(thing) for word in words), repr(thing)
    for thing in (reference, PENDULUM, outcome):
        page = thing._repr_html_()
        assert page.count("<tr>") > 2
        assert "<Trial" not in page


def test_results_are_tables_of_pandas(reference):
    tracks = reference.to_dataframe()
    first = reference.trials[0]
    assert len(tracks) == sum(one.track.confidence.size for one in reference)
    for column, name in enumerate(("x", "y")):
        series = tracks.loc[first.name][name].unstack("marker")[list(reference.marker_names)]
        np.testing.assert_array_equal(series, first.track.positions[..., column])
    compared = swim2real.evaluate(PENDULUM.space.published, reference, PENDULUM)
    figures = compared.to_dataframe()
    assert list(figures.index) == list(reference.names)
    assert figures["aligned_marker_error"].mean() == pytest.approx(compared.figure("aligned_marker_error"))
    assert all(kind.kind in "fiub" or name == "divergence" for name, kind in figures.dtypes.items()), figures.dtypes


@pytest.mark.parametrize(
    ("setting", "value", "said"),
    [("budget", "12", "budget is '12'; it must be a whole number"),
     ("horizon", "4", "horizon is '4'; it must be a number"),
     ("minutes", [1], r"minutes is \[1\]; it must be a number"),
     ("threads", "2", "threads is '2'; it must be")],
)  # fmt: skip
def test_a_wrong_type_is_a_sentence(setting, value, said):
    with pytest.raises(swim2real.Swim2RealError, match=said):
        swim2real.CalibrationSettings(**{setting: value})


def test_recordings_are_played_back_checked_and_exported(reference, tmp_path):
    made = swim2real.simulate(PENDULUM.space.published, PENDULUM, reference, threads=1)
    assert made.names == reference.names
    assert all(a.track.frame_count == b.track.frame_count for a, b in zip(made, reference, strict=True))
    assert swim2real.check(PENDULUM, reference) == ()
    path = tmp_path / "pendulum.xml"
    name, gap = swim2real.export_model(PENDULUM.space.published, PENDULUM, path)
    assert mujoco.MjModel.from_xml_path(str(path)).nu == 1
    assert gap < 1e-5, name


def test_a_log_becomes_a_trial(tmp_path):
    readings = [sensor.name for sensor in PENDULUM.trials.sensors]
    columns = ["time", "torque", *readings, *(f"{name}_{axis}" for name in PENDULUM.marker_names for axis in "xz")]
    times = np.linspace(0, 1, 51)
    rest = PENDULUM.rest_markers.ravel()
    lines = [",".join(map(str, [t, 0.0, *[0.0] * len(readings), *(rest + 0.01 * np.sin(6 * t))])) for t in times]
    log = tmp_path / "log.csv"
    log.write_text("\n".join([",".join(columns), *lines]))
    (one,) = swim2real.import_recording([log], PENDULUM, tmp_path / "logs")
    assert (one.trial.name, one.rows) == ("log", 51)
    assert swim2real.load_reference(tmp_path / "logs").names == ("log",)


@pytest.mark.slow
def test_a_run_is_studied_and_the_next_trial_proposed(run, reference):
    folder, *_ = run
    settings = swim2real.IdentifiabilitySettings(rounds=1)
    study = swim2real.identify(folder, reference, settings, robot=PENDULUM, threads=1)
    assert set(study.intervals) == set(PENDULUM.space.names)
    table = study.to_dataframe()
    assert list(table.index) == list(study.intervals)
    assert (table["low"] <= table["median"]).all()
    assert (table["median"] <= table["high"]).all()
    found = swim2real.next_trial(folder, reference, robot=PENDULUM, threads=1)
    assert found["candidates"][0]["volume"] <= found["candidates"][-1]["volume"]
    assert (folder / "next" / "next.csv").is_file()
