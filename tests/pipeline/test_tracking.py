"""From videos to a reference folder: what is written, going on after an end, several videos at a time, bad input."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pool import Glare

import swim2real
from films import CAMERA, Shot, contents, named, parts, shoot, tables
from markertrack import film as room
from markertrack.camera_file import CameraFile, write_camera
from markertrack.points import save_points
from markertrack.quality import DOUBTFUL, check_track
from markertrack.track import MarkerTrack
from swim2real.pipeline import TrackedVideo, track_video, track_videos
from swim2real.robots.fish import FISH
from swim2real.settings import TrackingSettings
from swim2real.trials import Trial, load_reference
from swim2real.trials.pose_tables import read_dlc
from swimbase.errors import ArgumentError, TrialError, VideoError

NAMES = FISH.marker_names
FAST = TrackingSettings(overlay=False)


def tracked(shot: Shot, folder: Path, settings: TrackingSettings = FAST, **options) -> tuple[Trial, TrackedVideo]:
    """The trial that a film becomes, with what is known about the camera."""
    settings = replace(settings, camera=settings.camera or shot.camera)
    found = track_video(shot.video, shot.points, FISH, settings, folder, **options)
    return load_reference(folder)[shot.name], found


def pixels(folder: Path, name: str, fps: float = 30.0) -> MarkerTrack:
    track, names = read_dlc(folder / "tracks" / f"{name}.pixels.csv", fps)
    assert names == NAMES
    return track


class DriftingTracker:
    """A tracker that takes no time: the markers drift by half a pixel a frame from where they were picked."""

    def start(self, image, points, time):
        self._points = points.copy()
        return self._points.copy(), np.ones(len(points))

    def follow(self, image, time):
        self._points += [0.5, 0.0]
        return self._points.copy(), np.ones(len(self._points))


@pytest.fixture
def quick_tracker(monkeypatch):
    monkeypatch.setattr(room, "MarkerTracker", lambda *_: DriftingTracker())


@pytest.fixture(scope="module")
def done(shot, tmp_path_factory) -> Path:
    """Reference folder of the tracked film. Copy nothing into it."""
    folder = tmp_path_factory.mktemp("done") / "reference"
    tracked(shot, folder, TrackingSettings())
    return folder


def test_a_film_becomes_a_trial_in_meters(shot, done):
    trial = load_reference(done)["f1_50"]
    assert trial.track.frame_count == 37
    np.testing.assert_allclose(trial.track.times, shot.times, atol=1e-6)
    assert (trial.track.confidence > 0.5).all()
    errors = shot.errors(trial)
    assert errors.mean() < 0.5e-3
    assert errors.max() < 2e-3
    assert trial.nominal_frequency == 1.5
    height = float(FISH.marker_heights[0])
    at_head = CAMERA.meters_per_pixel * (1 - height / CAMERA.camera_height)
    assert trial.meters_per_pixel == pytest.approx(at_head, rel=2e-3)
    version = swim2real.__version__
    assert trial.provenance == f"video f1_50.mp4, 640x360, h264, detection tracker, swim2real {version}"
    assert trial.video is not None
    assert trial.video.samefile(shot.video)


def test_the_report_says_what_was_done_and_found(shot, done):
    track = pixels(done, "f1_50")
    assert shot.pixel_errors(track).max() < 1
    assert shot.pixel_errors(track).mean() < 0.25
    report = json.loads((done / "tracks" / "f1_50.json").read_text())
    expected = {
        "trial": "f1_50", "video": "f1_50.mp4", "width": 640, "height": 360, "fps": 30.0, "codec": "h264",
        "rotation": 0, "frames": 37, "tracker": "detection", "points_from": "file", "usable": True, "findings": [],
        "lost_share": [0.0] * 9, "filled_share": [0.0] * 9,
    }  # fmt: skip
    assert expected.items() <= report.items()
    np.testing.assert_allclose(report["points"], shot.filmed.truth.positions[0], atol=1e-3)
    assert all(0.5 < confidence <= 1 for confidence in report["confidence"])
    files = {"reference.json", "f1_50.csv", "tracks/f1_50.json", "tracks/f1_50.mp4", "tracks/f1_50.pixels.csv"}
    assert set(contents(done)) - {".lock"} == files


def test_a_marker_that_is_hidden_is_lost_there_and_nowhere_else(tmp_path):
    """M4 and M5 are below glare for 0.3 s, M7 for two frames."""
    glares = (Glare(0.45, 0.75, over=(4, 5)), Glare(0.985, 1.05, over=(7,)))
    made = shoot(tmp_path, camera=replace(CAMERA, glares=glares))
    trial, found = tracked(made, tmp_path / "reference")
    hidden = made.filmed.hidden
    assert hidden[:, [4, 5]].sum() >= 16
    known = trial.track.confidence >= DOUBTFUL
    assert not known[hidden].any()
    assert made.errors(trial)[known].max() < 3e-3
    assert known[~hidden].mean() > 0.98
    assert known[:, :4].all()
    gap = hidden[:, 7]
    assert 1 <= gap.sum() <= 3
    assert made.errors(trial)[gap, 7].max() < 5e-3  # a short gap is filled
    quality = check_track(trial.track, FISH.rest_markers)
    assert quality.lost[gap, 7].all()
    assert found.report.filled_share[7] >= gap.mean() - 1e-9
    assert found.report.filled_share[4] < 0.1  # of a long gap nothing is
    np.testing.assert_allclose(found.report.lost_share, quality.lost_share, atol=1e-8)
    assert not found.report.usable
    assert {line[:13] for line in found.report.findings} >= {f"M{m} is lost in" for m in (4, 5, 7)}


@pytest.mark.usefixtures("quick_tracker")
def test_the_frequency_is_the_arguments_or_the_names(clip, tmp_path):
    for name, frequency, nominal in (("f1_50", 1.4, 1.4), ("f0_00", None, None)):
        trial, _ = tracked(named(clip, tmp_path, name), tmp_path / "reference", frequency=frequency)
        assert trial.nominal_frequency == nominal
    for wrong in (0.0, float("nan")):
        with pytest.raises(ArgumentError, match=f"frequency is {wrong:g} Hz; it must be finite and above 0"):
            tracked(clip, tmp_path / "other", frequency=wrong)
    assert not (tmp_path / "other").exists()


def test_a_film_that_is_done_isnt_tracked_again(shot, done):
    before = contents(done)
    stamps = {path: path.stat().st_mtime_ns for path in done.rglob("*")}
    seen = []
    _, found = tracked(shot, done, TrackingSettings(), on_progress=seen.append)
    assert found.done_before
    assert found.report.model_dump() == json.loads((done / "tracks" / "f1_50.json").read_text())
    assert seen == []
    assert contents(done) == before
    assert {path: path.stat().st_mtime_ns for path in done.rglob("*")} == stamps


@pytest.fixture(scope="module")
def untouched(clip, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("untouched") / "reference"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(room, "MarkerTracker", lambda *_: DriftingTracker())
        tracked(clip, folder)
    return folder


@pytest.fixture
def there(clip, untouched, tmp_path) -> Path:
    """A reference folder with a tracked film, to change."""
    folder = Path(shutil.copytree(untouched, tmp_path / "reference"))
    assert tracked(clip, folder)[1].done_before
    return folder


@pytest.mark.usefixtures("quick_tracker")
def test_other_points_settings_and_films_track_again(clip, there, tmp_path):
    moved = tmp_path / "moved.json"
    save_points(moved, clip.filmed.truth.positions[0] + 0.5, NAMES, clip.video.name, 640, 360)
    _, found = tracked(replace(clip, points=moved), there)
    assert not found.done_before
    np.testing.assert_allclose(found.report.points, clip.filmed.truth.positions[0] + 0.5, atol=1e-3)
    assert not tracked(clip, there, replace(FAST, smooth=True))[1].done_before
    assert tracked(clip, there, replace(FAST, smooth=True))[1].done_before
    write_camera(tmp_path / "camera.json", CameraFile(camera_height=3.0))
    assert not tracked(clip, there, replace(FAST, camera=tmp_path / "camera.json"))[1].done_before
    assert not tracked(clip, there, frequency=1.4)[1].done_before
    trial, found = tracked(shoot(tmp_path / "other", "f1_25", seconds=0.1, seed=2), there)
    assert not found.done_before
    assert trial.track.frame_count == 4
    assert len(load_reference(there)) == 1


@pytest.mark.usefixtures("quick_tracker")
@pytest.mark.parametrize("gone", ["reference.json", "tracks/f1_25.json"])
def test_what_was_taken_away_is_made_again(clip, there, gone):
    """A process that is killed just before the last file is written leaves it away, too."""
    before = tables(there)
    (there / gone).unlink()
    assert not tracked(clip, there)[1].done_before
    assert tables(there) == before
    for content in ("[]", "{"):
        (there / "tracks" / "f1_25.json").write_text(content)
        assert not tracked(clip, there)[1].done_before


@pytest.mark.usefixtures("quick_tracker")
def test_a_track_that_cant_be_replaced_stays(clip, there, tmp_path):
    before = tables(there)
    index = (there / "reference.json").read_bytes()
    (there / "reference.json").write_text("{}")
    moved = tmp_path / "moved.json"
    save_points(moved, clip.filmed.truth.positions[0] + 1.0, NAMES, clip.video.name, 640, 360)
    with pytest.raises(TrialError, match="'format' is missing"):
        tracked(replace(clip, points=moved), there)
    (there / "reference.json").write_bytes(index)
    assert tracked(clip, there)[1].done_before
    assert tables(there) == before


@pytest.mark.usefixtures("quick_tracker")
def test_an_interruption_leaves_no_half_files(shot, tmp_path):
    def interrupt(progress):
        if progress.done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tracked(shot, tmp_path / "reference", TrackingSettings(), on_progress=interrupt)
    assert contents(tmp_path / "reference") == {}


def films(*shots: Shot, **options):
    settings = options.pop("settings", replace(FAST, camera=shots[0].camera))
    folder = options.pop("folder")
    points = options.pop("points", [shot.points for shot in shots])
    return track_videos([shot.video for shot in shots], points, FISH, settings, folder, **options)


@pytest.mark.slow
def test_one_and_two_processes_write_the_same_files_and_answer_in_the_order_of_the_videos(shot, clip, tmp_path):
    bad = replace(clip, video=tmp_path / "bad.mp4")
    bad.video.write_text("these are words\n" * 40)
    told = {}
    for workers in (1, 2):
        folder, order, progress = tmp_path / str(workers), [], []
        found = films(
            shot, bad, clip, folder=folder, workers=workers, frequencies=[None, None, 1.4], on_progress=progress.append,
            on_done=lambda name, result, order=order: order.append((name, result)),
        )  # fmt: skip
        assert dict(order) == dict(zip(("f1_50", "bad", "f1_25"), found, strict=True))
        assert {p.name for p in progress} >= {"f1_50"}
        long, wrong, short = found
        assert isinstance(wrong, VideoError)
        assert str(bad.video) in str(wrong)
        assert [one.report.frames for one in (long, short)] == [37, 7]
        told[workers] = [{**result.report.model_dump(), "seconds": None} for result in (long, short)], str(wrong)
        reference = load_reference(folder)
        assert reference.names == ("f1_25", "f1_50")
        assert [trial.nominal_frequency for trial in reference] == [1.4, 1.5]
        assert parts(folder) == []
    assert told[1] == told[2]
    assert len(tables(tmp_path / "1")) == 4
    assert tables(tmp_path / "1") == tables(tmp_path / "2")
    index = "reference.json"
    assert contents(tmp_path / "1")[index] == contents(tmp_path / "2")[index]
