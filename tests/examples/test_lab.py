"""The lab, and what `track` makes of its films: of any robot, with what was recorded beside them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lab import Lab, Take
from pool import PoolCamera

from swim2real.pipeline import track_video
from swim2real.robots import load_robot
from swim2real.settings import TrackingSettings
from swim2real.trials import Signals, load_reference
from swimbase.errors import ArgumentError, TrackingError

EXAMPLES = Path(__file__).parents[2] / "examples"
FINGER = load_robot(EXAMPLES / "finger" / "finger.toml")
CAMERA = PoolCamera(
    width=480, height=400, fps=30.0, view=0.32, camera_height=1.5, center=(0.035, -0.05), marker_radius=0.004,
    water_color=(150, 158, 150), caustics=0.0,
)  # fmt: skip


def lab(robot=FINGER, **options) -> Lab:
    return Lab(robot, robot.space.published, lambda spec: None, **options)


def pull(seconds=0.4) -> Take:
    times = np.arange(0.0, seconds, 0.01)
    return Take("pull", seconds, controls=Signals(times, ["winch"], 0.01 + 0.05 * np.maximum(times - 0.1, 0)[:, None]))


@pytest.fixture(scope="module")
def films(tmp_path_factory) -> Path:
    """A folder with a film of 13 frames. Don't write into it."""
    folder = tmp_path_factory.mktemp("films")
    lab(sensor_noise={"pull": 0.1}).film([pull()], CAMERA, 0.008, folder)
    return folder


def tracked(films, to, **options):
    settings = TrackingSettings(camera=films / "camera.json", overlay=False)
    tables = {kind: films / f"pull.{kind}.csv" for kind in ("controls", "sensors")}
    return track_video(films / "pull.mp4", films / "pull.points.json", FINGER, settings, to, **{**tables, **options})


def test_it_holds_its_first_command_until_the_recording_begins():
    (trial,) = lab().move([pull()], 100.0)
    before, after = trial.track.positions[:9, -1], trial.track.positions[-1, -1]
    assert np.ptp(before, axis=0).max() < 1e-4
    assert np.linalg.norm(after - before[0]) > 0.01
    assert trial.track.times[0] == 0.0
    assert trial.sensors is not None
    assert trial.sensors.column("pull")[-1] > trial.sensors.column("pull")[0] > 0


def test_a_camera_without_a_center_and_a_robot_that_is_torn_apart_are_refused(tmp_path):
    with pytest.raises(ArgumentError, match="the camera has no center; give the world point in the middle"):
        lab().film([pull()], replace(CAMERA, center=None), 0.008, tmp_path)
    torn = replace(lab(), differs=lambda spec: setattr(spec.option, "gravity", [0, 0, -1e9]))
    with pytest.raises(ArgumentError, match=r"take 'pull': the simulation diverged .*; ask less of the robot"):
        torn.record([pull()])


@pytest.mark.slow
def test_a_film_from_the_side_becomes_a_trial_with_its_tables(films, tmp_path):
    found = tracked(films, tmp_path / "trials")
    (trial,) = load_reference(tmp_path / "trials")
    (truth,) = lab(sensor_noise={"pull": 0.1}).move([pull()], 30.0)
    np.testing.assert_allclose(trial.track.positions, truth.track.positions, atol=5e-4)
    assert trial.controls is not None
    assert trial.sensors is not None
    np.testing.assert_array_equal(trial.controls.values, pull().controls.values)
    np.testing.assert_allclose(trial.sensors.values, truth.sensors.values)
    assert found.report.usable
    assert found.report.scales.keys() == {"camera file's plane", "palm1–palm2"}
    assert found.report.scale_spread < 0.02


@pytest.mark.slow
def test_it_is_tracked_again_when_a_table_is_another(films, tmp_path):
    assert not tracked(films, tmp_path / "trials").done_before
    assert tracked(films, tmp_path / "trials").done_before
    other = tmp_path / "other.csv"
    other.write_text("time_s,winch\n0,0.01\n", encoding="utf-8")
    assert not tracked(films, tmp_path / "trials", controls=other).done_before
    (trial,) = load_reference(tmp_path / "trials")
    assert trial.controls.values.tolist() == [[0.01]]


def test_markers_of_a_robot_that_bends_anyhow_are_picked(films, tmp_path):
    with pytest.raises(TrackingError, match=r"robot 'finger' can't be found by themselves.*`swim2real pick`"):
        track_video(films / "pull.mp4", "auto", FINGER, TrackingSettings(), tmp_path / "trials")
