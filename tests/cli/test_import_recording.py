"""Logs of controllers, encoders and motion capture, to a reference."""

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swim2real.trials import TrialSet, load_reference, save_reference

PROJECT = Path(__file__).resolve().parents[2]
MARKERS = ("--markers", "pivot=px,pz:mm", "middle=mx,mz:mm", "end=ex,ez:mm")
COLUMNS = ("--controls", "torque=cmd_mNm", "--sensors", "gyro[1]=gyro y (deg/s)")


def write_log(path, trial, begin=0.0, *, markers=True, gyro=180 / np.pi) -> None:
    """A trial as a log: milliseconds, mNm, degrees and millimeters, and a column of words."""
    lines = ["t_ms,cmd_mNm,gyro y (deg/s)," + ("px,pz,mx,mz,ex,ez," if markers else "") + "state"]
    for time, places in zip(trial.track.times, trial.track.positions, strict=True):
        torque = 1e3 * trial.controls.held("torque", np.array([time]))[0]
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
        np.testing.assert_allclose(
            made.controls.held("torque", times + 1e-4), real.controls.held("torque", real.track.times)
        )


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


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        ((), 2, "no columns of the markers pivot, middle, end, and there is no trial 'a' that was tracked"),
        (MARKERS, 2, "no column 'torque' for actuator 'torque', so say --controls torque=COLUMN"),
        ((*MARKERS, "--controls", "torque=cmd"), 2, "no column 'cmd' for actuator 'torque'; did you mean 'cmd_mNm'?"),
        ((*MARKERS, "--controls", "tork=cmd_mNm"), 2, "'tork' is no actuator that robot 'pendulum' takes from a table"),
        ((*MARKERS, *COLUMNS[:3], "gyro[1]=cmd_mNm"), 2, "'mNm' is a unit of torque, and 'rad/s' one of angular"),
        ((*MARKERS[:2], *COLUMNS), 2, "no columns for the markers middle, end; say --markers NAME=XCOLUMN,YCOLUMN"),
        ((*MARKERS[:3], "end=ex", *COLUMNS), 2, "say end=XCOLUMN,YCOLUMN or end=XCOLUMN,YCOLUMN:UNIT"),
        ((*MARKERS, *COLUMNS, "--time", "px:s"), 1, "times must rise"),
        ((*MARKERS, *COLUMNS, "--time", "state"), 1, "line 2, column 10: 'on' is not a number"),
    ],
)
def test_what_is_wrong_is_told_and_nothing_is_written(program, reference, words, tmp_path, options, code, says):
    write_log(tmp_path / "a.csv", reference["a"])
    assert says in program("import-recording", tmp_path / "a.csv", *words, *options).sentence(code)
    assert not (tmp_path / "reference").exists()


def test_units_that_are_probably_others_and_missing_rows_are_told(program, reference, words, tmp_path):
    write_log(tmp_path / "a.csv", reference["a"])
    lines = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text("\n".join(lines[:50] + lines[70:]))
    other = (*COLUMNS[:3], "gyro[1]=gyro y (deg/s):rad/s")
    program("import-recording", tmp_path / "a.csv", *words, *other, *MARKERS).done()
    assert "rows are missing for 0.35 s from 0.800 s on" in program.err
    assert "that looks like degrees in place of radians" in program.err
    assert "say NAME=COLUMN:UNIT" in program.err


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
    wrong = line.replace("cmd1_deg", "cmd1_deg:rad")
    program(*shlex.split(wrong)).done()
    assert "commands of actuator 'shoulder_servo' reach 20, and it takes" in program.err


def test_logs_in_place_of_a_reference_are_told_of_it(program, reference, pendulum_folder, tmp_path):
    write_log(tmp_path / "a.csv", reference["a"])
    said = program("quality", tmp_path, "--robot", pendulum_folder / "pendulum.toml").sentence(1)
    assert "line 1: it names columns ('t_ms')" in said
    assert "`swim2real import-recording` makes a reference" in said
