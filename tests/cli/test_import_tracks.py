from pathlib import Path

import numpy as np
import pytest

from swim2real.cli.film import import_tracks
from swim2real.errors import ArgumentError, TrialError
from swim2real.robots.fish import FISH
from swim2real.tracking import check_track
from swim2real.tracking.camera_file import CameraFile, Length, write_camera
from swim2real.trials import MarkerTrack, load_reference
from swim2real.trials.pose_tables import write_dlc
from swimmers import Swimmer

SCALE = 1e-3  # m per pixel


def film(path: Path, names=FISH.marker_names, swimmer=None) -> MarkerTrack:
    """A pose table of a swim, and the swim."""
    track = (swimmer or Swimmer(duration=2.0)).track(noise=0, by_hand=False)
    order = [int(name[1:]) if name in FISH.marker_names else i for i, name in enumerate(names)]
    pixels = track.positions[:, order] / SCALE * [1, -1] + [1500, 900]
    write_dlc(MarkerTrack(track.times, pixels), names, path, "net")
    return track


def assert_same_shape(trial, truth):
    found = trial.track.body * SCALE / trial.meters_per_pixel
    np.testing.assert_allclose(found, truth.body, atol=1e-5)


def imported(tmp_path, *tables, **options):
    defaults = {
        "to": tmp_path / "reference",
        "fps": 60.0,
        "robot": "fish",
        "camera": None,
        "controls": (),
        "sensors": (),
        "frequency": (),
    }
    return import_tracks(tables, **{**defaults, **options})


def test_pose_tables_become_trials_in_meters(tmp_path, capsys):
    first, second = tmp_path / "slowDLC_net_100.csv", tmp_path / "fast.csv"
    truth = film(first)
    film(second, swimmer=Swimmer(2.0, duration=2.0))
    assert imported(tmp_path, first, second, frequency=(1.0, 2.5)) == 0
    reference = load_reference(tmp_path / "reference")
    assert reference.names == ("fast", "slow")
    assert [trial.nominal_frequency for trial in reference] == [2.5, 1.0]
    slow = reference["slow"]
    assert slow.meters_per_pixel == pytest.approx(SCALE, rel=0.01)  # the formula's head bends a little
    assert slow.provenance == "pose table slowDLC_net_100.csv, 60 fps"
    assert_same_shape(slow, truth)
    assert check_track(slow.track, FISH.rest_markers).usable
    said = capsys.readouterr().out
    assert f"slow: 121 frames, 2.00 s, {1e3 * slow.meters_per_pixel:.4f} mm per pixel" in said
    assert "slow: M2 and M8 stand up to 50 mm nearer to the camera than M0" in said
    assert f"swim2real quality {tmp_path / 'reference'}" in said


def test_a_camera_file_sets_the_scale(tmp_path):
    table = tmp_path / "swim.csv"
    film(table)
    write_camera(tmp_path / "camera.json", CameraFile(lengths=(Length("tape", np.array([[0, 0], [300.0, 400]]), 0.6),)))
    imported(tmp_path, table, camera=tmp_path / "camera.json")
    (trial,) = load_reference(tmp_path / "reference")
    assert trial.meters_per_pixel == pytest.approx(1.2e-3)
    assert trial.nominal_frequency is None
    assert trial.provenance == "pose table swim.csv, 60 fps, camera camera.json"


def test_markers_are_found_by_name_else_taken_in_order(tmp_path, capsys):
    shuffled = tuple(f"M{i}" for i in (3, 1, 4, 0, 5, 8, 2, 6, 7))
    truth = film(tmp_path / "shuffled.csv", shuffled)
    others = tuple("abcdefghi")
    film(tmp_path / "others.csv", others)
    imported(tmp_path, tmp_path / "shuffled.csv", tmp_path / "others.csv")
    for trial in load_reference(tmp_path / "reference"):
        assert_same_shape(trial, truth)
    said = capsys.readouterr().out
    assert "others: markers are taken in the table's order: M0 is a, M1 is b" in said
    assert "shuffled: markers" not in said


def test_nothing_is_written_when_one_table_is_wrong(tmp_path):
    good, short = tmp_path / "good.csv", tmp_path / "short.csv"
    track = film(good)
    write_dlc(MarkerTrack(track.times, track.positions[:, :2]), ("M0", "M1"), short)
    with pytest.raises(TrialError) as caught:
        imported(tmp_path, good, short)
    assert str(caught.value) == f"{short}: 2 markers (M0, M1); robot 'fish' has 9 ({', '.join(FISH.marker_names)})"
    assert not (tmp_path / "reference").exists()


def test_two_tables_of_one_name_are_refused(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        film(tmp_path / folder / "swim.csv")
    with pytest.raises(ArgumentError, match=r"^two tables would make a trial of the same name \(swim\); rename one$"):
        imported(tmp_path, tmp_path / "a" / "swim.csv", tmp_path / "b" / "swim.csv")


def test_tables_that_were_recorded_beside_the_tracks_go_with_them(tmp_path, capsys):
    for name in ("swim.csv", "other.csv"):
        film(tmp_path / name)
    commands = [tmp_path / "first.csv", tmp_path / "second.csv"]
    for speed, table in enumerate(commands):
        table.write_text(f"time_s,motor\n0,{speed}\n", encoding="utf-8")
    tracks = (tmp_path / "swim.csv", tmp_path / "other.csv")
    assert imported(tmp_path, *tracks, controls=tuple(commands)) == 0
    trials = load_reference(tmp_path / "reference")
    assert [float(trials[name].controls.values[0, 0]) for name in ("swim", "other")] == [0.0, 1.0]
    assert trials["swim"].sensors is None
    with pytest.raises(ArgumentError, match="--sensors has 1 values for 2 tables; give one for each, or none"):
        imported(tmp_path, *tracks, sensors=tuple(commands[:1]))


def test_a_stretch_of_a_table_becomes_a_trial_from_time_0(tmp_path):
    film(tmp_path / "swim.csv")
    (tmp_path / "first.csv").write_text("time_s,motor\n0,1\n0.4,2\n", encoding="utf-8")
    imported(tmp_path, tmp_path / "swim.csv")
    (whole,) = load_reference(tmp_path / "reference")
    options = {"begin": (0.5,), "until": (1.5,), "controls": (tmp_path / "first.csv",)}
    imported(tmp_path, tmp_path / "swim.csv", to=tmp_path / "cut", **options)
    (cut,) = load_reference(tmp_path / "cut")
    np.testing.assert_allclose(cut.track.times, np.arange(61) / 60, atol=1e-9)
    moved = cut.track.positions / cut.meters_per_pixel - whole.track.positions[30:91] / whole.meters_per_pixel
    assert np.ptp(moved.reshape(-1, 2), axis=0).max() < 1e-6
    assert (cut.controls.times.tolist(), cut.controls.values.tolist()) == ([0.0], [[2.0]])
    assert cut.provenance == "pose table swim.csv, 60 fps, from 0.5 s to 1.5 s"
