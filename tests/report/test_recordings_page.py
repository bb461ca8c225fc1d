"""The page of a run whose trials are recordings: what it shows, and no word of what its robot hasn't."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_pages import check_charts, line, longer, missing, titles_of, visible

from markertrack.track import MarkerTrack
from recorded import FLOATER, PENDULUM, PENDULUM_HIDDEN, floater_reference, pendulum_reference
from swim2real.calibration import Problem, RunFolder, conclude, load_trials
from swim2real.objective import Comparison
from swim2real.optimizers import Proposal, ScriptedAdvisor
from swim2real.pipeline import calibrate
from swim2real.pipeline import calibration as pipeline
from swim2real.report import write_report
from swim2real.report.page import RunPage, page_context
from swim2real.report.pages import inline_svg
from swim2real.report.run import read_run
from swim2real.report.run_charts import common_ranges, paths
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
    calibrate(blinded(pendulum_reference(1e-3)), PENDULUM, settings("b"), folder, sensitivity=True)
    return folder


@pytest.fixture(scope="module")
def floater(tmp_path_factory) -> Path:
    """A finished run that travels, compared in a frame. Don't write into it."""
    folder = tmp_path_factory.mktemp("floater") / "run"
    calibrate(blinded(floater_reference(1e-3)), FLOATER, settings("fast"), folder)
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
        f"Playback error {1e3 * outcome.fit.loss:.1f} mm first evaluation", f"held-out trials {out_error}",
        f"Sensor gyro[1] {error} first evaluation", "An error of 1 rad/s counts as 1 mm.", "sensor_errors.gyro[1]",
        "Mean distance between simulated and real markers at the same times.", "4 of 4 evaluations",
        "Protocol playback", "Convergence", "Real and simulated", "Error of each marker", "Constant offset in numbers",
        "Difference in amplitude in numbers", "Uncalibrated", "Damping of the shoulder.", "Length (s)",
        "gyro[1] (rad/s)", "check the track", "end is lost in 5 % of frames", "held out", "fluid fingerprint",
    )  # fmt: skip
    assert missing(words, shown) == []
    labels = " ".join(" ".join(titles_of(draw())) for draw in shown_of(pendulum, PENDULUM).charts.values()).lower()
    lower = shown.lower().replace("swim2real", "")
    assert [word for word in FOREIGN if word in lower or word in labels] == []
    assert [word for word in ("speed", "heading", "shape", "progress", "travel") if word in lower] == []


def test_a_robot_that_travels_shows_speed_heading_and_shape(floater: Path) -> None:
    shown = page_of(floater, FLOATER)
    words = (
        "in the frame of nose and neck, with the difference in how far they have come", "Velocity error velocity_error",
        "Heading error heading_error", "Shape error shape_error", "mm/s", "°", "Real speed (mm/s)", "1.60",
        "Set frequency (Hz)", "Progress: how far it has come along its line of travel",
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


def test_links_are_drawn_at_four_instants_or_else_the_markers(pendulum: Path) -> None:
    trial = load_trials(RunFolder(pendulum))[0].compared
    for links in (PENDULUM.links, ()):
        robot = replace(PENDULUM, links=links)
        lines = paths(trial, PENDULUM.marker_names, robot, common_ranges([trial])).axes[0].lines
        bodies = [drawn for drawn in lines if drawn.get_marker() == "o"]
        assert len(bodies) == 8
        assert {len(body.get_xdata()) for body in bodies} == {6}
    opacities = [body.get_alpha() for body in bodies[:4]]
    assert opacities == sorted(opacities)


def test_an_interrupted_run_has_what_its_record_has(copied: Path) -> None:
    (copied / "outcome.json").unlink()
    shown = page_of(copied, PENDULUM)
    assert missing(("4 of 4 evaluations are on record", "Marker error in numbers"), shown) == []
    assert [word for word in ("Real and simulated real", "end is lost") if word in shown] == []


def test_a_held_out_trial_that_diverged(copied: Path) -> None:
    class Diverging(Problem):
        def evaluate(self, values) -> Comparison:
            found = super().evaluate(values)
            nowhere = [replace(t, divergence="it grew", simulated=np.nan * t.real) for t in found.trials]
            return Comparison(tuple(nowhere), found.protocol, found.horizon)

    fitted, unseen = blinded(pendulum_reference(1e-3)).split(["b"])
    best = json.loads((copied / "best.json").read_text())["parameters"]
    conclude(RunFolder(copied), Problem(PENDULUM, fitted, threads=2), Diverging(PENDULUM, unseen, threads=2), best)
    said = ("simulation diverged", "held-out trials diverged", "The simulation diverged: it grew.")
    assert missing(said, page_of(copied, PENDULUM)) == []
    figures = shown_of(copied, PENDULUM).charts
    check_charts(inline_svg(figures["paths-1"], "paths-1"))
    assert "off-1" not in figures


def test_rounds_tell_what_the_advisor_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = PENDULUM.space.to_cube(PENDULUM_HIDDEN)
    script = [Proposal(hidden, "The lower arm swings too long.", "More damping."), Proposal(hidden[::-1], "Again.")]
    monkeypatch.setattr(pipeline, "make_advisor", lambda *arguments: ScriptedAdvisor(script))
    calibrate(pendulum_reference(), PENDULUM, settings("b", method="line-search", horizon=0.5), tmp_path / "run")
    said = ("The lower arm swings too long.", "1 of 2 rounds were accepted")
    assert missing(said, page_of(tmp_path / "run", PENDULUM)) == []


def test_long_recordings_are_thinned(pendulum: Path) -> None:
    found = read_run(pendulum, PENDULUM)
    pair = found.saved[0]
    shown = page_context(replace(found, saved=(replace(pair, compared=longer(pair.compared, 2_000, 240)),)))
    lines = [drawn for draw in list(shown.charts.values())[:5] for drawn in draw().axes[0].lines]
    assert max(len(drawn.get_xdata()) for drawn in lines) <= 480
