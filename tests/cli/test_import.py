"""`import-tracks` and `import-recording`: pose tables and logs of encoders and motion capture, to a reference."""

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markertrack.camera_file import CameraFile, Length, write_camera
from markertrack.quality import check_track
from markertrack.track import MarkerTrack
from swim2real.cli import main
from swim2real.cli.film import import_tracks
from swim2real.robots.fish import FISH
from swim2real.trials import TrialSet, load_reference, save_reference
from swim2real.trials.pose_tables import write_dlc
from swimbase.errors import ArgumentError, TrialError
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
    defaults = {"to": tmp_path / "reference", "fps": 60.0, "robot": "fish", "camera": None, "frequency": ()}
    return import_tracks(tables, **{**defaults, "controls": (), "sensors": (), **options})


def test_tracks_are_exported_and_imported_again(tmp_path, capsys):
    table = tmp_path / "swim.csv"
    film(table)
    assert imported(tmp_path, table, frequency=(1.5,)) == 0
    with pytest.raises(SystemExit, match="0"):
        main(["export-tracks", str(tmp_path / "reference"), "--to", str(tmp_path / "out"), "--format", "deeplabcut"])
    path = tmp_path / "out" / "swim.csv"
    assert f"{path}: at 60 fps" in capsys.readouterr().out
    assert imported(tmp_path, path, to=tmp_path / "again", frequency=(1.5,)) == 0
    one, other = (load_reference(tmp_path / name)["swim"] for name in ("reference", "again"))
    np.testing.assert_allclose(other.track.times, one.track.times, atol=1e-9)
    np.testing.assert_array_equal(other.track.confidence, one.track.confidence)
    np.testing.assert_allclose(other.track.body, one.track.body, atol=1e-9)


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


def test_midlines_become_trials_of_places_on_them(tmp_path, capsys):
    truth = Swimmer(duration=2.0).track(noise=0, by_hand=False)
    pixels = truth.positions / SCALE * [1, -1] + [1500, 900]
    for k, name in enumerate("xy"):
        np.savetxt(tmp_path / f"swim_{name}.csv", pixels[:, :, k], delimiter=",")
    assert imported(tmp_path, tmp_path / "swim_x.csv", midline=True) == 0
    (trial,) = load_reference(tmp_path / "reference")
    assert trial.midline
    assert trial.provenance == "midlines swim_x.csv, 60 fps"
    np.testing.assert_allclose(trial.track.body * SCALE / trial.meters_per_pixel, truth.body, atol=8e-3)  # it stretches
    assert "nearer to the camera" not in capsys.readouterr().out  # all are seen in one plane


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


@pytest.mark.parametrize(
    ("names", "error", "said"),
    [(("good.csv", "short.csv"), TrialError, r"short\.csv: 2 markers \(M0, M1\); 9 are wanted"),
     (("good.csv", "b/good.csv"), ArgumentError, r"trial of the same name \(good\); rename one")],
)  # fmt: skip
def test_nothing_is_written_when_one_table_is_wrong(tmp_path, names, error, said):
    track = film(tmp_path / "good.csv")
    (tmp_path / "b").mkdir()
    film(tmp_path / "b" / "good.csv")
    write_dlc(MarkerTrack(track.times, track.positions[:, :2]), ("M0", "M1"), tmp_path / "short.csv")
    with pytest.raises(error, match=said):
        imported(tmp_path, *(tmp_path / name for name in names))
    assert not (tmp_path / "reference").exists()


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
    assert (cut.controls.at("motor", cut.track.times) == 2).all()
    assert cut.controls.times == pytest.approx([-0.5, -0.1, 0.0])
    assert cut.provenance == "pose table swim.csv, 60 fps, from 0.5 s to 1.5 s"


PROJECT = Path(__file__).resolve().parents[2]
MARKERS = ("--markers", "pivot=px,pz:mm", "middle=mx,mz:mm", "end=ex,ez:mm")
COLUMNS = ("--controls", "torque=cmd_mNm", "--sensors", "gyro[1]=gyro y (deg/s)")


def write_log(path, trial, begin=0.0, *, markers=True, gyro=180 / np.pi) -> None:
    """A trial as a log: milliseconds, mNm, degrees and millimeters, and a column of words."""
    lines = ["t_ms,cmd_mNm,gyro y (deg/s)," + ("px,pz,mx,mz,ex,ez," if markers else "") + "state"]
    for time, places in zip(trial.track.times, trial.track.positions, strict=True):
        torque = 1e3 * trial.controls.at("torque", np.array([time]))[0]
        rate = gyro * np.interp(time, trial.sensors.times, trial.sensors.values[:, 0])
        cells = [1e3 * (time + begin), torque, rate, *(1e3 * places.ravel() if markers else ())]
        lines.append(",".join([*map(repr, map(float, cells)), "on"]))
    path.write_text("\n".join(lines))


@pytest.fixture
def reference(pendulum_folder):
    return load_reference(pendulum_folder / "tracks")


@pytest.fixture
def words(pendulum_folder, tmp_path):
    return "--robot", pendulum_folder / "pendulum.toml", "--to", tmp_path / "reference"


def test_logs_become_trials_in_the_models_units(program, reference, words, tmp_path):
    for trial in reference:
        write_log(tmp_path / f"{trial.name}.csv", trial, begin=1.7e6)
    program("import-recording", tmp_path / "a.csv", tmp_path / "b.csv", *words, *COLUMNS, *MARKERS).done()
    assert program.err == ""
    assert "a: 151 rows of" in program.out
    assert "60 Hz" in program.out
    assert "time from 't_ms' in ms" in program.out
    assert "sensor gyro[1] from 'gyro y (deg/s)' in deg/s" in program.out
    found = load_reference(tmp_path / "reference")
    assert found.names == ("a", "b")
    for real in reference:
        made = found[real.name]
        times = real.track.times - real.track.times[0]
        np.testing.assert_allclose(made.track.times, times, atol=1e-6)
        np.testing.assert_allclose(made.track.positions, real.track.positions, atol=1e-9)
        gyro = np.interp(times, real.sensors.times - real.track.times[0], real.sensors.values[:, 0])
        np.testing.assert_allclose(made.sensors.values[:, 0], gyro, rtol=1e-5, atol=1e-5)
        driven = real.controls.at("torque", real.track.times)
        np.testing.assert_allclose(made.controls.at("torque", times + 1e-4), driven)


def test_a_stretch_is_cut_out_and_counted_from_its_beginning(program, reference, words, tmp_path):
    write_log(tmp_path / "a.csv", reference["a"])
    stretch = ("--from", 0.5, "--until", 1.5)
    program("import-recording", tmp_path / "a.csv", *words, *COLUMNS, *MARKERS, *stretch).done()
    (made,) = load_reference(tmp_path / "reference")
    assert (made.track.times[0], made.track.duration) == (0, pytest.approx(1.0, abs=0.02))
    np.testing.assert_allclose(made.track.positions[0], reference["a"].track.positions[30], atol=1e-9)


def test_a_trial_that_was_tracked_keeps_its_track(program, reference, words, tmp_path):
    real = reference["a"]
    moved = replace(real.track, times=real.track.times - real.track.times[0], positions=real.track.positions)
    tracked = replace(real, track=moved, controls=None, sensors=None)
    save_reference(TrialSet((tracked,), reference.marker_names), tmp_path / "reference")
    write_log(tmp_path / "a.csv", real, begin=50.0, markers=False)
    said = program("import-recording", tmp_path / "a.csv", *words, *COLUMNS).sentence(1)
    assert "the controls of trial 'a' aren't on its clock" in said
    assert "--from T says" in said
    program("import-recording", tmp_path / "a.csv", *words, *COLUMNS, "--from", 0).done()
    (made,) = load_reference(tmp_path / "reference")
    np.testing.assert_array_equal(made.track.positions, real.track.positions)
    assert made.controls.times[0] == made.sensors.times[0] == 0
    assert "--until is for new trials" in program(
        "import-recording", tmp_path / "a.csv", *words, *COLUMNS, "--from", 0, "--until", 1
    ).sentence(2)


@pytest.mark.parametrize(("options", "code", "says"), [
    ((), 2, "no columns of the markers pivot, middle, end, and there is no trial 'a'"),
    (MARKERS, 2, "no column 'torque' for actuator 'torque', so say --controls torque=COLUMN"),
    ((*MARKERS, *COLUMNS[:2]), 2, "so say --sensors gyro[1]=COLUMN"),
    ((*MARKERS, "--controls", "torque=cmd_Nm"), 2, "no column 'cmd_Nm' for actuator 'torque'; did you mean"),
    ((*MARKERS, *COLUMNS[:3], "gyro[1]=cmd_mNm"), 2, "'mNm' is a unit of torque, and 'rad/s' one of angular"),
    ((*MARKERS[:3], "end=ex", *COLUMNS), 2, "say end=XCOLUMN,YCOLUMN"),
    ((*MARKERS, *COLUMNS, "--time", "px:s"), 1, "times must rise"),
    ((*MARKERS, *COLUMNS, "--time", "state"), 1, "line 2, column 10: 'on' is not a number"),
])  # fmt: skip
def test_what_is_wrong_is_told_and_nothing_is_written(program, reference, words, tmp_path, options, code, says):
    write_log(tmp_path / "a.csv", reference["a"])
    assert says in program("import-recording", tmp_path / "a.csv", *words, *options).sentence(code)
    assert not (tmp_path / "reference").exists()


def test_units_that_are_probably_others_and_missing_rows_are_told(program, reference, words, tmp_path):
    write_log(tmp_path / "a.csv", reference["a"])
    lines = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text("\n".join(lines[:50] + lines[70:]))
    other = (*COLUMNS[:3], "gyro[1]=gyro y (deg/s):rad/s")
    program("import-recording", tmp_path / "a.csv", *words, *other, *MARKERS)
    assert program.code == 1
    assert "rows are missing for 0.35 s from 0.800 s on" in program.out
    assert "look like degrees in place of radians" in program.err
    assert "the trials are written all the same" in program.err


def test_the_example_of_the_docs(program, tmp_path, monkeypatch):
    text = (PROJECT / "docs/your-robot.md").read_text("utf-8").replace("\\\n", " ")
    (line,) = re.findall(r"^swim2real (import-recording .*?)(?: #.*)?$", text, flags=re.MULTILINE)
    for name in ("arm.xml", "arm.toml"):
        shutil.copy(PROJECT / "examples/arm" / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    times = np.arange(0, 1, 0.01)
    swing = 20 * np.sin(2 * np.pi * times)
    rows = np.stack([1e3 * times, swing, -swing, 0.9 * swing, -0.8 * swing], axis=1)
    for name in ("steps", "chirp"):
        table = "\n".join(",".join(map(repr, row)) for row in rows.tolist())
        Path(f"{name}.csv").write_text(f"t_ms,cmd1_deg,cmd2_deg,q1,q2\n{table}\n")
    program(*shlex.split(line)).done()
    assert program.err == ""
    trial = load_reference("trials")["steps"]
    assert trial.sensors.names == ("shoulder_angle", "elbow_angle")
    np.testing.assert_allclose(trial.sensors.column("shoulder_angle"), np.deg2rad(0.9 * swing), atol=1e-12)
    np.testing.assert_allclose(trial.controls.column("elbow_servo"), np.deg2rad(-swing), atol=1e-12)


def test_logs_in_place_of_a_reference_are_told_of_it(program, reference, pendulum_folder, tmp_path):
    write_log(tmp_path / "a.csv", reference["a"])
    said = program("quality", tmp_path, "--robot", pendulum_folder / "pendulum.toml").sentence(1)
    assert "line 1: it names columns ('t_ms')" in said
    assert "`swim2real import-recording` makes a reference" in said
