"""The embedded example: what its camera does to a swim, and the whole pipeline on it."""

import json
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from pool import PoolCamera
from swims import film_demo

from films import contents
from markertrack.camera_file import read_camera
from markertrack.following import FrameProgress
from markertrack.points import load_points
from markertrack.quality import check_track
from markertrack.track import MarkerTrack
from pools import hidden_values
from swim2real.calibration import Outcome, reference_fingerprint
from swim2real.cli import main
from swim2real.demo import (
    FREQUENCIES,
    HELD_OUT,
    MORE_FREQUENCIES,
    DemoCallbacks,
    SyntheticCamera,
    demo_settings,
    fit,
    synthetic_reference,
    track,
)
from swim2real.demo import example as room
from swim2real.pipeline import TrackedVideo
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, load_reference
from swim2real.trials.pose_tables import read_dlc
from swimbase.errors import RunError

FREQUENCY = 1.6  # Hz


def filmed(seed: int = 3, frequencies=(FREQUENCY,), seconds: float = 1.5, **camera) -> list[MarkerTrack]:
    made = SyntheticCamera(**camera)
    return [t.track for t in synthetic_reference(FISH, hidden_values(), frequencies, seconds, made, seed, threads=2)]


@pytest.fixture(scope="module")
def plain() -> MarkerTrack:
    """A swim under a plain camera."""
    return filmed()[0]


def test_the_same_seed_films_the_same_trials_and_another_one_others(plain):
    camera = {"noise": 1e-3, "placement": 3e-3, "lost": {"f1_60": (6, 7, 0.5)}}
    (one,), (other,) = filmed(**camera), filmed(**camera)
    np.testing.assert_array_equal(one.positions, other.positions)
    (elsewhere,) = filmed(seed=4)
    assert np.linalg.norm(plain.heads[0] - elsewhere.heads[0]) > 1e-3
    assert np.abs(plain.body - elsewhere.body).max() > 5e-3


def test_trials_are_named_after_their_frequency_and_time_stamped_by_the_camera():
    trials = synthetic_reference(FISH, hidden_values(), (1.25, 2.0), 1.0, SyntheticCamera(fps=30.0), 3, threads=2)
    assert trials.names == ("f1_25", "f2_00")
    assert trials.marker_names == FISH.marker_names
    for trial, frequency in zip(trials, (1.25, 2.0), strict=True):
        assert trial.nominal_frequency == frequency
        np.testing.assert_allclose(trial.track.times, np.arange(31) / 30)
        assert trial.provenance == "synthetic, 30 fps, hidden parameters"


def test_a_plain_camera_films_the_swim_itself_whatever_the_time_step(plain):
    swim = Swim("swim", Actuation(FREQUENCY, 0.0, 0.1), 1.5)
    expected = Simulator(FISH, 2, 1 / 60).simulate(hidden_values(), [swim]).trials[0].track
    assert plain.speed == pytest.approx(expected.speed, rel=0.02)
    np.testing.assert_allclose(np.ptp(plain.body, axis=0), np.ptp(expected.body, axis=0), atol=3e-3)
    assert 1e-9 < np.abs(filmed(timestep=5e-4)[0].body - plain.body).max() < 5e-3


def test_noise_shakes_every_marker_anew_and_misplaced_ones_have_a_static_offset_each(plain):
    difference = filmed(noise=1e-3)[0].positions - plain.positions
    assert difference.std(axis=0) == pytest.approx(np.full((9, 2), 1e-3), rel=0.35)
    assert np.abs(np.diff(difference, axis=0)).mean() == pytest.approx(2e-3 / np.sqrt(np.pi), rel=0.1)
    (track,) = filmed(placement=5e-3)
    lengths = np.linalg.norm(track.positions - plain.positions, axis=2)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(len(lengths), axis=0), atol=1e-9)
    assert 2e-3 < lengths.mean() < 15e-3
    assert len(np.unique(lengths[0].round(9))) == 9
    head = np.linalg.norm(track.positions[:, 1] - track.positions[:, 0], axis=1)
    assert head == pytest.approx(np.full(len(head), FISH.rest_markers[1, 0]), rel=0.02)


def test_a_lost_marker_sits_on_its_neighbor_from_then_on_in_the_named_trial(plain):
    (lost,) = filmed(lost={"f1_60": (6, 7, 0.5)})
    late = plain.times >= 0.5
    gap = np.linalg.norm(lost.positions[:, 6] - lost.positions[:, 7], axis=1)
    assert gap[late].max() < 6e-3 < gap[~late].min()
    others = [marker for marker in range(9) if marker != 6]
    np.testing.assert_array_equal(lost.positions[:, others], plain.positions[:, others])
    np.testing.assert_array_equal(lost.positions[~late], plain.positions[~late])
    np.testing.assert_array_equal(filmed(lost={"f2_00": (6, 7, 0.5)})[0].positions, plain.positions)


def test_the_hidden_fish_is_within_bounds_and_its_films_are_small():
    hidden = room.hidden_values()
    assert FISH.space.check(hidden) == hidden == room.hidden_values()
    space = replace(FISH.space, scale="log")
    assert np.abs(space.to_cube(hidden) - space.to_cube(FISH.space.published)).max() > 0.2
    names = {f"f{frequency:.2f}".replace(".", "_") for frequency in (*FREQUENCIES, *MORE_FREQUENCIES)}
    assert {path.stem for path in room.FILMS.glob("*.mp4")} == names
    assert sum(path.stat().st_size for path in room.FILMS.iterdir()) < 4e6


CAMERA_OF_DEMO = PoolCamera(width=640, height=360, view=1.3, fps=30.0)  # markers have a radius of 4 px


@dataclass
class Heard:
    """What a demo told."""

    lines: list[str] = field(default_factory=list)
    frames: list[FrameProgress] = field(default_factory=list)
    films: list[tuple[str, TrackedVideo]] = field(default_factory=list)

    @property
    def callbacks(self) -> DemoCallbacks:
        return DemoCallbacks(self.lines.append, self.frames.append, lambda *found: self.films.append(found))

    @property
    def done_before(self) -> list[tuple[str, bool]]:
        return [(name, result.done_before) for name, result in self.films]


@dataclass(frozen=True)
class Demo:
    """A demo with two short films in a small picture and two evaluations."""

    films: Path
    out: Path
    heard: Heard
    outcome: Outcome

    def again(self, out: Path, heard: Heard | None = None, resume: bool = False) -> None:
        track(out, films=self.films, full=True, resume=resume, workers=1, callbacks=(heard or Heard()).callbacks)


@pytest.fixture(scope="session")
def short_demo(tmp_path_factory) -> Demo:
    """Don't write into its folder."""
    films, out, heard = tmp_path_factory.mktemp("films"), tmp_path_factory.mktemp("demo") / "out", Heard()
    film_demo(films, (0.75, 1.5), 1.5, CAMERA_OF_DEMO)
    track(out, films=films, full=True, workers=1, callbacks=heard.callbacks)
    return Demo(films, out, heard, fit(out, demo_settings(2)))


def test_the_demo_leaves_films_a_reference_and_a_run_and_says_so(short_demo):
    out, heard = short_demo.out, short_demo.heard
    assert {path.name for path in out.iterdir()} == {"videos", "camera.json", "reference", "run"}
    videos = {"f0_75.mp4", "f0_75.points.json", "f1_50.mp4", "f1_50.points.json"}
    assert {path.name for path in (out / "videos").iterdir()} == videos
    tracks = {f"{name}.{ending}" for name in ("f0_75", "f1_50") for ending in ("json", "mp4", "pixels.csv")}
    assert tracks <= {path.name for path in (out / "reference" / "tracks").iterdir()}
    assert json.loads((out / "run" / "outcome.json").read_text()) == short_demo.outcome.to_json()
    settings = json.loads((out / "run" / "settings.json").read_text())
    assert settings["reference_fingerprint"] == reference_fingerprint(load_reference(out / "reference"))
    assert heard.lines == ["Tracking the markers in 2 films of a fish with hidden parameters"]
    assert heard.done_before == [("f0_75", False), ("f1_50", False)]
    assert len(heard.frames) == 2 * 46


def test_the_demos_trials_come_from_its_films_with_glare_in_the_last(short_demo):
    trials = load_reference(short_demo.out / "reference").trials
    for trial, frequency in zip(trials, (0.75, 1.5), strict=True):
        assert trial.nominal_frequency == frequency
        assert trial.provenance.startswith(f"video {trial.name}.mp4, 640x360, h264, detection tracker")
        assert trial.track.frame_count == 46
        assert 0.02 < trial.track.speed < 0.5
    clear, glared = (check_track(trial.track, FISH.rest_markers) for trial in trials)
    assert clear.usable
    assert set(glared.lost_markers()) >= {4, 5}
    assert 0.05 < glared.lost_share[4] < 0.25


def test_points_are_clicked_and_the_camera_measured_as_by_a_person(short_demo):
    for name in ("f0_75", "f1_50"):
        clicks = load_points(short_demo.out / "videos" / f"{name}.points.json", FISH.marker_names, 640, 360).points
        track, _ = read_dlc(short_demo.out / "reference" / "tracks" / f"{name}.pixels.csv", 30.0)
        assert 0.4 < np.linalg.norm(clicks - track.positions[0], axis=1).mean() < 2.5
    height = CAMERA_OF_DEMO.camera_height - FISH.marker_heights[0]
    assert read_camera(short_demo.out / "camera.json").camera_height == pytest.approx(height)


def test_the_demo_evaluates_on_the_trial_that_it_left_out_and_hides_its_parameters(short_demo):
    assert HELD_OUT in {f"f{frequency:.2f}".replace(".", "_") for frequency in FREQUENCIES}
    assert tuple(short_demo.outcome.held_out.trials) == (HELD_OUT,)
    assert tuple(short_demo.outcome.fit.trials) == ("f1_50",)
    assert 0 < short_demo.outcome.held_out.aligned_marker_error < 1
    for path in short_demo.out.rglob("*"):
        content = path.read_bytes() if path.is_file() else b""
        for name, value in room.hidden_values().items():
            assert repr(value)[:10].encode() not in content, f"{name} in {path}"


def test_a_second_demo_into_the_same_folder_is_refused_and_one_that_is_done_only_read(short_demo, capsys):
    before, heard = contents(short_demo.out), Heard()
    with pytest.raises(SystemExit) as leaving:
        main(["demo", "--out", str(short_demo.out)])
    assert leaving.value.code == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"swim2real: '{short_demo.out}' holds a demo already; ")
    short_demo.again(short_demo.out, heard, resume=True)
    assert heard.done_before == [("f0_75", True), ("f1_50", True)]
    assert contents(short_demo.out) == before


@pytest.mark.parametrize("there", ["videos", "camera.json", "reference", "run"])
def test_a_folder_that_holds_something_of_the_kind_or_cant_be_made_is_refused(short_demo, tmp_path, there):
    (tmp_path / there).mkdir()
    with pytest.raises(RunError, match="holds a demo already; remove it, choose another --out or go on with --resume"):
        short_demo.again(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == [there]
    (tmp_path / "file").write_text("mine")
    with pytest.raises(RunError, match=r"can't write folder '.*file': .*a file and no folder"):
        short_demo.again(tmp_path / "file")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_whole_demo_finds_the_hidden_fish(tmp_path, capsys):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as leaving:
        main(["demo", "--out", str(out), "--budget", "30", "--seed", "0", "--quiet"])
    assert leaving.value.code == 0
    shown, told = capsys.readouterr()
    assert told == ""
    assert re.search(r"\d+ of 16 hidden values lie inside\.", shown)
    assert len(shown.splitlines()) <= 25
    assert (out / "run" / "report.html").is_file()
    assert load_reference(out / "reference").names == ("f0_50", "f0_75", "f1_00", "f1_25")
    outcome = json.loads((out / "run" / "outcome.json").read_text())
    assert outcome["fit"]["aligned_marker_error"] < 25e-3
    assert outcome["held_out"]["aligned_marker_error"] < 40e-3
    study = json.loads((out / "run" / "identifiability.json").read_text())
    assert list(study["intervals"]) == list(FISH.space.names)
    assert len((out / "run" / "record.jsonl").read_text().splitlines()) == 30
