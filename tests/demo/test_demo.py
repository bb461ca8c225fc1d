"""The embedded example: what its camera does to a swim, and the whole pipeline on it."""

import json
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from films import contents, tables
from pools import hidden_values
from swim2real.calibration import Outcome, reference_fingerprint
from swim2real.cli import main
from swim2real.demo import (
    DEMO_FREQUENCIES,
    FULL_FREQUENCIES,
    HELD_OUT,
    Camera,
    DemoCallbacks,
    demo_settings,
    film_and_track,
    fit,
    synthetic_reference,
)  # fmt: skip
from swim2real.demo import example as room
from swim2real.errors import ArgumentError, RunError
from swim2real.pipeline import FrameProgress, TrackedVideo
from swim2real.rendering.pool import PoolCamera
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.tracking import check_track
from swim2real.tracking.camera_file import read_camera
from swim2real.tracking.points import load_points
from swim2real.trials import Actuation, TrialSet, load_reference
from swim2real.trials.pose_tables import read_dlc

FREQUENCY = 1.6  # Hz


def film(camera: Camera | None = None, seed: int = 3, frequencies=(FREQUENCY,), seconds: float = 1.5) -> TrialSet:
    return synthetic_reference(FISH, hidden_values(), frequencies, seconds, camera or Camera(), seed, threads=2)


def bodies(trials: TrialSet) -> np.ndarray:
    """Positions in the body frame: what place and heading in the pool don't change."""
    return trials.trials[0].track.body


# the camera


def test_the_same_seed_films_the_same_trials():
    camera = Camera(noise=1e-3, placement=3e-3, lost={"f1_60": (6, 7, 0.5)})
    one, other = film(camera), film(camera)
    np.testing.assert_array_equal(one.trials[0].track.positions, other.trials[0].track.positions)


def test_another_seed_films_another_place_and_phase():
    one, other = film(seed=3), film(seed=4)
    heads = [trials.trials[0].track.heads for trials in (one, other)]
    assert np.linalg.norm(heads[0][0] - heads[1][0]) > 1e-3
    assert np.abs(bodies(one) - bodies(other)).max() > 5e-3


def test_trials_are_named_after_their_frequency_and_time_stamped_by_the_camera():
    trials = film(Camera(fps=30.0), frequencies=(1.25, 2.0), seconds=1.0)
    assert trials.names == ("f1_25", "f2_00")
    assert trials.marker_names == FISH.marker_names
    for trial, frequency in zip(trials, (1.25, 2.0), strict=True):
        assert trial.nominal_frequency == frequency
        np.testing.assert_allclose(trial.track.times, np.arange(31) / 30)
        assert trial.provenance == "synthetic, 30 fps, hidden parameters"


def test_a_plain_camera_films_the_swim_itself():
    track = film().trials[0].track
    swim = Swim("swim", Actuation(FREQUENCY, 0.0, 0.1), 1.5)
    expected = Simulator(FISH, 2, 1 / 60).simulate(hidden_values(), [swim]).trials[0].track
    assert track.speed == pytest.approx(expected.speed, rel=0.02)
    np.testing.assert_allclose(np.ptp(track.body, axis=0), np.ptp(expected.body, axis=0), atol=3e-3)


def test_noise_shakes_every_marker_anew():
    difference = film(Camera(noise=1e-3)).trials[0].track.positions - film().trials[0].track.positions
    assert difference.std(axis=0) == pytest.approx(np.full((9, 2), 1e-3), rel=0.35)
    assert np.abs(np.diff(difference, axis=0)).mean() == pytest.approx(2e-3 / np.sqrt(np.pi), rel=0.1)


def test_misplaced_markers_have_a_static_offset_each():
    difference = film(Camera(placement=5e-3)).trials[0].track.positions - film().trials[0].track.positions
    lengths = np.linalg.norm(difference, axis=2)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(len(lengths), axis=0), atol=1e-9)
    assert 2e-3 < lengths.mean() < 15e-3
    assert len(np.unique(lengths[0].round(9))) == 9


def test_misplaced_head_markers_keep_their_distance_along_the_head():
    track = film(Camera(placement=5e-3)).trials[0].track
    length = np.linalg.norm(track.positions[:, 1] - track.positions[:, 0], axis=1)
    assert length == pytest.approx(np.full(len(length), FISH.rest_markers[1, 0]), rel=0.02)


def test_another_time_step_makes_nearly_the_same_swim():
    difference = np.abs(bodies(film(Camera(timestep=5e-4))) - bodies(film()))
    assert 1e-9 < difference.max() < 5e-3


def test_a_lost_marker_sits_on_its_neighbor_from_then_on():
    whole, lost = film().trials[0].track, film(Camera(lost={"f1_60": (6, 7, 0.5)})).trials[0].track
    late = whole.times >= 0.5
    gap = np.linalg.norm(lost.positions[:, 6] - lost.positions[:, 7], axis=1)
    assert gap[late].max() < 6e-3 < gap[~late].min()
    others = [marker for marker in range(9) if marker != 6]
    np.testing.assert_array_equal(lost.positions[:, others], whole.positions[:, others])
    np.testing.assert_array_equal(lost.positions[~late], whole.positions[~late])


def test_only_the_named_trial_loses_a_marker():
    trials = film(Camera(lost={"f2_00": (6, 7, 0.0)}), frequencies=(FREQUENCY, 2.0), seconds=1.0)
    gaps = [np.linalg.norm(t.track.positions[:, 6] - t.track.positions[:, 7], axis=1).min() for t in trials]
    assert gaps[1] < 6e-3 < gaps[0]


# the demo


def test_the_hidden_fish_is_within_bounds_and_not_the_published_one():
    hidden = room.hidden_values()
    assert FISH.space.check(hidden) == hidden
    assert hidden == room.hidden_values()
    apart = replace(FISH.space, scale="log").to_cube(hidden) - replace(FISH.space, scale="log").to_cube(
        FISH.space.published
    )
    assert np.abs(apart).max() > 0.2


CAMERA_OF_DEMO = PoolCamera(width=640, height=360, view=1.3, fps=30.0)  # markers have a radius of 4 px
SHORT = {"frequencies": (0.75, 1.5), "seconds": 1.5, "camera": CAMERA_OF_DEMO, "workers": 1}


@dataclass
class Heard:
    """What a demo told."""

    lines: list[str] = field(default_factory=list)
    frames: list[FrameProgress] = field(default_factory=list)
    films: list[tuple[str, TrackedVideo]] = field(default_factory=list)

    @property
    def callbacks(self) -> DemoCallbacks:
        return DemoCallbacks(
            self.lines.append, self.frames.append, lambda name, result: self.films.append((name, result))
        )


@dataclass(frozen=True)
class Demo:
    """A demo with two short films in a small picture and two evaluations."""

    out: Path
    heard: Heard
    outcome: Outcome


@pytest.fixture(scope="session")
def short_demo(tmp_path_factory) -> Demo:
    """Don't write into its folder."""
    out, heard = tmp_path_factory.mktemp("demo") / "out", Heard()
    film_and_track(out, callbacks=heard.callbacks, **SHORT)
    return Demo(out, heard, fit(out, demo_settings(2)))


def test_the_demo_leaves_films_a_reference_and_a_run(short_demo):
    out = short_demo.out
    assert {path.name for path in out.iterdir()} == {"videos", "camera.json", "reference", "run"}
    films = {"f0_75.mp4", "f0_75.points.json", "f1_50.mp4", "f1_50.points.json"}
    assert {path.name for path in (out / "videos").iterdir()} == films
    tracks = {f"{name}.{ending}" for name in ("f0_75", "f1_50") for ending in ("json", "mp4", "pixels.csv")}
    found = {path.name for path in (out / "reference" / "tracks").iterdir()}
    assert {name for name in found if not name.endswith(".review.html")} == tracks
    files = {path.name for path in (out / "run").iterdir()}
    assert {"settings.json", "record.jsonl", "best.json", "outcome.json", "trials.npz"} <= files
    assert json.loads((out / "run" / "outcome.json").read_text()) == short_demo.outcome.to_json()


def test_the_demo_tells_what_it_does(short_demo):
    heard, videos = short_demo.heard, short_demo.out / "videos"
    assert heard.lines == [
        "Filming 2 swims of a fish with hidden parameters, 1.5 s each",
        f"{videos / 'f0_75.mp4'}: filmed",
        f"{videos / 'f1_50.mp4'}: filmed",
        "Tracking the markers",
    ]
    assert [(name, result.done_before) for name, result in heard.films] == [("f0_75", False), ("f1_50", False)]
    assert len(heard.frames) == 2 * 46


def test_the_demos_trials_come_from_its_films(short_demo):
    for trial, frequency in zip(load_reference(short_demo.out / "reference"), (0.75, 1.5), strict=True):
        assert trial.nominal_frequency == frequency
        assert trial.provenance.startswith(f"video {trial.name}.mp4, 640x360, h264, detection tracker")
        assert trial.track.frame_count == 46
        assert 0.02 < trial.track.speed < 0.5


def test_glare_hides_two_markers_in_the_last_film_only(short_demo):
    clear, glared = (check_track(t.track, FISH.rest_markers) for t in load_reference(short_demo.out / "reference"))
    assert clear.usable
    assert set(glared.lost_markers()) >= {4, 5}
    assert 0.05 < glared.lost_share[4] < 0.25


def test_points_are_clicked_as_a_person_would(short_demo):
    for name in ("f0_75", "f1_50"):
        clicks = load_points(short_demo.out / "videos" / f"{name}.points.json", FISH.marker_names, 640, 360).points
        track, _ = read_dlc(short_demo.out / "reference" / "tracks" / f"{name}.pixels.csv", 30.0)
        off = np.linalg.norm(clicks - track.positions[0], axis=1)
        assert 0.4 < off.mean() < 2.5


def test_the_camera_file_has_the_height_above_the_heads_markers(short_demo):
    height = CAMERA_OF_DEMO.camera_height - FISH.marker_heights[0]
    assert read_camera(short_demo.out / "camera.json").camera_height == pytest.approx(height)


def test_the_demos_run_belongs_to_the_reference_that_it_leaves(short_demo):
    settings = json.loads((short_demo.out / "run" / "settings.json").read_text())
    assert settings["reference_fingerprint"] == reference_fingerprint(load_reference(short_demo.out / "reference"))


def test_the_demo_evaluates_on_the_trial_that_it_left_out(short_demo):
    assert HELD_OUT in {f"f{frequency:.2f}".replace(".", "_") for frequency in DEMO_FREQUENCIES}
    assert set(DEMO_FREQUENCIES) < set(FULL_FREQUENCIES)
    assert tuple(short_demo.outcome.held_out.trials) == (HELD_OUT,)
    assert tuple(short_demo.outcome.fit.trials) == ("f1_50",)
    assert 0 < short_demo.outcome.held_out.aligned_marker_error < 1
    assert len(short_demo.outcome.sensitivity) == len(FISH.space)


def test_the_hidden_parameters_are_in_no_file(short_demo):
    for path in short_demo.out.rglob("*"):
        content = path.read_bytes() if path.is_file() else b""
        for name, value in room.hidden_values().items():
            assert repr(value)[:10].encode() not in content, f"{name} in {path}"


def test_a_second_demo_into_the_same_folder_is_refused(short_demo):
    before = contents(short_demo.out)
    says = f"'{short_demo.out}' holds a demo already; remove it, choose another --out or go on with --resume"
    with pytest.raises(RunError) as caught:
        film_and_track(short_demo.out, **SHORT)
    assert str(caught.value) == says
    assert contents(short_demo.out) == before


@pytest.mark.parametrize("there", ["videos", "camera.json", "reference", "run"])
def test_a_folder_that_holds_something_of_the_kind_is_refused(tmp_path, there):
    (tmp_path / there).mkdir()
    with pytest.raises(RunError, match="holds a demo already"):
        film_and_track(tmp_path, **SHORT)
    assert [path.name for path in tmp_path.rglob("*")] == [there]


def test_a_folder_that_cant_be_made_is_told(tmp_path):
    file = tmp_path / "file"
    file.write_text("mine")
    with pytest.raises(RunError, match=r"can't write folder '.*file/videos': Not a directory"):
        film_and_track(file, **SHORT)
    assert file.read_text() == "mine"


@pytest.mark.slow
def test_an_interrupted_demo_goes_on_with_what_is_missing(short_demo, tmp_path):
    out, heard = Path(shutil.copytree(short_demo.out, tmp_path / "out")), Heard()
    for gone in ("videos/f1_50.mp4", "reference/tracks/f1_50.json"):
        (out / gone).unlink()
    (out / "videos" / "part_f1_50.mp4.part").write_text("half")
    film_and_track(out, resume=True, callbacks=heard.callbacks, **SHORT)
    assert [line for line in heard.lines if "filmed" in line] == [f"{out / 'videos' / 'f1_50.mp4'}: filmed"]
    assert [(name, result.done_before) for name, result in heard.films] == [("f0_75", True), ("f1_50", False)]
    for folder in ("videos", "reference"):
        assert tables(out / folder) == tables(short_demo.out / folder)
    assert contents(out / "videos") == contents(short_demo.out / "videos")
    outcome = fit(out, demo_settings(3))
    record = (out / "run" / "record.jsonl").read_text().splitlines()
    assert record[:2] == (short_demo.out / "run" / "record.jsonl").read_text().splitlines()
    assert len(record) == 3
    assert outcome.fit.loss <= short_demo.outcome.fit.loss


def test_a_demo_that_is_done_is_only_read(short_demo):
    before, heard = contents(short_demo.out), Heard()
    film_and_track(short_demo.out, resume=True, callbacks=heard.callbacks, **SHORT)
    assert [(name, result.done_before) for name, result in heard.films] == [("f0_75", True), ("f1_50", True)]
    assert contents(short_demo.out) == before


@pytest.mark.parametrize(("budget", "seed", "says"), [(0, 0, "budget is 0"), (-1, 0, "budget is -1"), (1, -1, "seed")])
def test_wrong_settings_are_refused(budget, seed, says):
    with pytest.raises(ArgumentError, match=says):
        demo_settings(budget, seed)


def test_the_program_refuses_a_second_demo(short_demo, capsys):
    with pytest.raises(SystemExit) as leaving:
        main(["demo", "--out", str(short_demo.out)])
    assert leaving.value.code == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"swim2real: '{short_demo.out}' holds a demo already; ")
    assert len(err.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_whole_demo_finds_the_hidden_fish(tmp_path, capsys):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as leaving:
        main(["demo", "--out", str(out), "--quiet"])
    assert leaving.value.code == 0
    assert capsys.readouterr() == ("", "")
    assert (out / "run" / "report.html").is_file()
    assert load_reference(out / "reference").names == ("f0_50", "f0_75", "f1_00", "f1_25")
    outcome = json.loads((out / "run" / "outcome.json").read_text())
    assert outcome["fit"]["aligned_marker_error"] < 25e-3
    assert outcome["held_out"]["aligned_marker_error"] < 40e-3
    assert len(outcome["sensitivity"]) == len(FISH.space)
    assert len((out / "run" / "record.jsonl").read_text().splitlines()) == 30
