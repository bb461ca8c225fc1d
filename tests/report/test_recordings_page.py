"""The page of a run whose trials are recordings: what it shows, and no word of what its robot hasn't."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_pages import line, missing, titles_of, visible

from markertrack.track import MarkerTrack
from recorded import FLOATER, PENDULUM, floater_reference, pendulum_reference
from swim2real.calibration import RunFolder
from swim2real.pipeline import calibrate
from swim2real.report import write_report
from swim2real.report.page import RunPage, page_context
from swim2real.report.run import read_run
from swim2real.robots.robot import Robot
from swim2real.settings import CalibrationSettings
from swim2real.trials import TrialSet

FOREIGN = (
    "swim", "thrust", "beat", "registration", "registered", "eq. 1", "fish", "water", "published", "frequency", "tail",
    "motor angle",
)  # fmt: skip


def blinded(reference: TrialSet) -> TrialSet:
    """The last marker is lost in a few frames of every trial."""
    trials = []
    for trial in reference:
        positions = trial.track.positions.copy()
        positions[20:28, -1] = np.nan
        trials.append(replace(trial, track=MarkerTrack(trial.track.times, positions)))
    return TrialSet(tuple(trials), reference.marker_names)


def settings(hold_out: str, **more) -> CalibrationSettings:
    chosen = {"method": "least-squares", "budget": 4, "threads": 2, "hold_out": (hold_out,)}
    return CalibrationSettings(**{**chosen, **more})


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory) -> Path:
    """A finished run with a sensor, compared in the world. Don't write into it."""
    folder = tmp_path_factory.mktemp("pendulum") / "run"
    calibrate(blinded(pendulum_reference(1e-3)), PENDULUM, settings("b"), folder, sensitivity=True, on_warning=None)
    return folder


@pytest.fixture(scope="module")
def floater(tmp_path_factory) -> Path:
    """A finished run that travels, compared in a frame. Don't write into it."""
    folder = tmp_path_factory.mktemp("floater") / "run"
    calibrate(blinded(floater_reference(1e-3)), FLOATER, settings("fast"), folder, on_warning=None)
    return folder


@pytest.fixture
def copied(pendulum: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(pendulum, tmp_path / "run"))


def page_of(folder: Path, robot: Robot) -> str:
    return visible(write_report(folder, robot).read_text(encoding="utf-8"))


def shown_of(folder: Path, robot: Robot) -> RunPage:
    return page_context(read_run(folder, robot))


def test_a_run_with_a_sensor_shows_all_that_there_is_and_no_word_of_what_it_hasnt(pendulum: Path) -> None:
    shown = page_of(pendulum, PENDULUM)
    outcome = RunFolder(pendulum).outcome()
    error, out_error = (f"{one.sensor_errors['gyro[1]']:.3g} rad/s" for one in (outcome.fit, outcome.held_out))
    words = (
        f"Playback error {1e3 * outcome.fit.loss:.1f} mm", f"held-out trials {out_error}", f"Sensor gyro[1] {error}",
        "An error of 1 rad/s counts as 1 mm.", "4 of 4 evaluations", "Damping of the shoulder.", "gyro[1] (rad/s)",
        "end is lost in 5 % of frames",
    )  # fmt: skip
    assert missing(words, shown) == []
    labels = " ".join(" ".join(titles_of(draw())) for draw in shown_of(pendulum, PENDULUM).charts.values()).lower()
    lower = shown.lower().replace("swim2real", "")
    assert [word for word in FOREIGN if word in lower or word in labels] == []
    assert [word for word in ("speed", "heading", "shape", "progress", "travel") if word in lower] == []


def test_a_robot_that_travels_shows_speed_heading_and_shape(floater: Path) -> None:
    shown = page_of(floater, FLOATER)
    words = (
        "the frame of nose and neck", "velocity_error", "heading_error", "shape_error", "Real speed (mm/s)", "1.60",
    )  # fmt: skip
    assert missing(words, shown) == []
    assert "Playback error" not in shown  # without sensors it is the marker error
    assert "ensor" not in shown


def test_trials_and_errors_are_in_the_units_of_their_headings(pendulum: Path, floater: Path) -> None:
    trials = shown_of(pendulum, PENDULUM).trials
    named = ("Length (s)", "Playback error (mm)", "Marker error (mm)", "Left out (%)", "gyro[1] (rad/s)")
    assert trials.columns == named
    figures = RunFolder(pendulum).outcome().fit.trials["a"]
    assert trials.rows[0][1] == (
        "2.50", f"{1e3 * figures.loss:.1f}", f"{1e3 * figures.aligned_marker_error:.1f}",
        "1.8", f"{figures.sensor_errors['gyro[1]']:.3g}",
    )  # fmt: skip
    error, shape, offset, amplitude = shown_of(floater, FLOATER).errors
    assert [one.key for one in (error, shape)] == ["aligned", "shape"]
    assert error.trials == ("fast", "slow")
    assert error.held_out == (True, False)
    slow = RunFolder(floater).outcome().fit.trials["slow"]
    assert error.values[1] == pytest.approx(slow.aligned_marker_errors)
    assert (offset.values <= error.values + 1e-9).all()
    assert amplitude.values[:, 0] == pytest.approx(0, abs=1e-9)  # the origin of the frame


def test_charts_have_units_and_the_planes_axes(pendulum: Path, floater: Path) -> None:
    expected = ({"sensor-0-0", "sensor-1-0"}, {"progress-0", "progress-1", "error-shape"})
    for folder, robot, own in zip((pendulum, floater), (PENDULUM, FLOATER), expected, strict=True):
        charts = shown_of(folder, robot).charts
        shared = {"convergence", "error-aligned", "error-offset", "error-amplitude"}
        assert set(charts) == shared | own | {f"{kind}-{i}" for kind in ("paths", "off") for i in range(2)}
        for draw in charts.values():
            for title in titles_of(draw()):
                assert re.search(r"\((mm|mm/s|s|rad/s)\)$", title) or title in ("evaluation", "marker"), title
    assert titles_of(shown_of(pendulum, PENDULUM).charts["paths-0"]()) == ("x (mm)", "z (mm)")
    assert titles_of(shown_of(floater, FLOATER).charts["paths-0"]())[0] == "from nose toward neck (mm)"


def test_lost_frames_are_left_out_of_paths_and_errors(pendulum: Path) -> None:
    figures = shown_of(pendulum, PENDULUM).charts
    real, simulated = (line(figures["paths-0"](), f"end, {kind}").get_xdata() for kind in ("real", "simulated"))
    assert np.flatnonzero(np.isnan(real)).tolist() == list(range(20, 28))
    assert np.isfinite(simulated).all()
    end, mean = (line(figures["off-0"](), name).get_ydata() for name in ("end", "mean"))
    assert np.flatnonzero(np.isnan(end)).tolist() == list(range(20, 28))
    assert np.isfinite(mean).all()
    first = [drawn.get_ydata()[0] for drawn in figures["off-0"]().axes[0].lines[:-1]]
    assert mean[0] == pytest.approx(np.mean(first))
