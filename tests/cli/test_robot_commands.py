"""`init` and `check`."""

import re
from dataclasses import replace

import numpy as np
import pytest

from made_robots import DAMPING, RECORDINGS, ROBOT, made, parameter
from markertrack.track import MarkerTrack
from small_models import PENDULUM
from swim2real.checks.probing import excitation
from swim2real.robots import load_robot
from swim2real.simulation.playback import PlaybackSimulator
from swim2real.trials import TrialSet, save_reference

PNG = b"\x89PNG\r\n\x1a\n"
DRIVEN = '[recordings.controls]\nservo = "table"\ntorque = {amplitude = 0.5, phase = -1, offset = 0.1}\nmotor = 0.2\n'
UNUSED = parameter("'body \"upper\" mass'", 0.1, 1.0, "value = 0.1")


@pytest.fixture
def model(tmp_path):
    place = tmp_path / "pendulum.xml"
    place.write_text(PENDULUM)
    return place


def test_a_robot_file_is_begun_and_passes_its_check(program, model):
    program("init", model).done()
    out = model.with_suffix(".toml")
    guess = 'camera = "side" is a guess, by where markers move most; change it if it stands elsewhere.'
    begun = f"{out}: 3 markers, 2 parameters (shoulder_damping, elbow_damping), and 6 more as comments. Edit it, then:"
    assert program.text.split() == f"{guess} {begun} swim2real check {out}".split()
    program("check", out, "--threads", 1).done()
    assert re.search(r'shoulder_damping N·m·s/rad 0 to 0.1 0 0 [0-9.]+ joint "shoulder" damping', rows(program))
    assert "Markers at rest, seen from the side, from the model's origin, which must be the camera" in rows(program)
    assert "tip 0.0 -400.0 0.0" in rows(program)
    assert "Moved for 2 s from a pose off its rest." in program.text
    assert "start at rest or where their first stretch fits best, whichever suits them, and are comp" in rows(program)
    assert out.with_suffix(".png").read_bytes().startswith(PNG)
    assert program.text.strip().endswith(str(out.with_suffix(".png")))


def rows(program) -> str:
    """What was printed, with single spaces, and cells of several lines put together."""
    return " ".join(program.text.replace("━", " ").split())


@pytest.mark.slow
def test_a_file_that_is_there_is_not_written_over(program, model):
    out = model.with_suffix(".toml")
    out.write_text("mine")
    says = f"'{out}' is there; give another --out, or --force to write over it"
    assert program("init", model).sentence(2) == says
    assert out.read_text() == "mine"
    program("init", model, "--force").done()
    assert load_robot(out).name == "pendulum"


def test_a_parameter_that_changes_nothing_or_a_bound_that_does_not_compile_fails_the_check(program, tmp_path):
    place = made(tmp_path, ROBOT, RECORDINGS, UNUSED)
    program("check", place)
    assert program.code == 1
    assert (
        "x changes nothing of the model: body 'upper' has no <inertial>, so its mass comes from its geoms"
        in program.text
    )
    place = made(tmp_path, ROBOT, RECORDINGS, parameter("'geom \"rod0\" friction[0]'", 0.1, 2.0))
    program("check", place)
    assert program.code == 1
    assert "x moves no marker" in program.text
    place = made(tmp_path, ROBOT, RECORDINGS, parameter("'joint \"link0\" range[0]'", -40.0, 70.0))
    program("check", place)
    assert program.code == 1
    assert "robot 'arm', x = 70: the model doesn't compile: Error: range[0] should be smaller" in program.text
    assert "x changes nothing" not in program.text
    # what is worth knowing fails nothing
    faint = parameter("'joint \"link1\" stiffness'", 1.99999, 2.00001).replace('"x"', '"faint"')
    strong = parameter("'option gravity[0]'", 0.0, 1e12)
    program("check", made(tmp_path, ROBOT, '[recordings]\nstart = "markers"\n', strong, faint)).done()
    assert "faint hardly shows: it moves the markers by less than 0.01 mm on average" in program.text
    assert "x = 1e+12: excitation: the simulation diverged " in program.text


def test_what_drives_a_trial_is_told(program, tmp_path):
    sensors = '[recordings.sensors]\nangle = {unit = "rad", meters_per_unit = 0.1}\n'
    about = 'frame = ["base", "tip"]\nstart = "up"\n'
    place = made(tmp_path, ROBOT, RECORDINGS, about, DRIVEN, sensors, DAMPING)
    program("check", place, "--out", tmp_path / "picture.png").done()
    told = rows(program)
    assert "servo its column of the trial's controls" in told
    assert "torque 0.5 sin(2π f t - 1) + 0.1, f of the trial" in told
    assert "motor 0.2 in every trial" in told
    assert "damped nothing, so 0" in told
    assert "angle rad 100" in told
    assert "Markers at rest, seen from the side, from marker base [mm]" in told
    assert "recordings that start in keyframe 'up' and are compared in the frame of base and tip." in told
    assert "with sines for tables, from where trials start." in told
    assert (tmp_path / "picture.png").read_bytes().startswith(PNG)
    assert not place.with_suffix(".png").exists()


@pytest.mark.slow
def test_real_trials_are_used_and_must_fit(program, tmp_path):
    place = made(tmp_path, ROBOT, RECORDINGS, DRIVEN, DAMPING)
    robot = load_robot(place)
    trial, player = excitation(robot, 1.0), PlaybackSimulator(robot, 1)
    seen = player.simulate(robot.space.published, [player.request(trial)]).trials[0]
    folder = tmp_path / "reference"
    save_reference(TrialSet((replace(seen, name="a", controls=trial.controls),), robot.marker_names), folder)
    program("check", place, "--reference", folder).done()
    assert "Moved for 2 s as in the trials of the reference (a)." in program.text
    assert "All trials fit: a." in program.text
    assert "Warning" not in program.text
    track = MarkerTrack(seen.track.times, seen.track.positions + np.array([0.6, 0.0]))
    away = TrialSet((replace(seen, name="a", controls=trial.controls, track=track),), robot.marker_names)
    save_reference(away, tmp_path / "away")
    program("check", place, "--reference", tmp_path / "away")
    assert program.code == 1
    assert "Probably wrong: trial 'a': it lies beside the robot by x +600 mm, z +0 mm; check the camera" in rows(
        program
    )
    assert "All trials" not in program.text
    quick = ("--method", "random", "--budget", 1, "--threads", 1, "--quiet")
    program("calibrate", tmp_path / "away", "--robot", place, "--out", tmp_path / "run", *quick)
    assert program.err.startswith("swim2real: warning: trial 'a': it lies beside the robot")
    made(tmp_path, ROBOT, RECORDINGS, DRIVEN.replace("servo", "law"), DAMPING)
    program("check", place, "--reference", folder)
    assert program.code == 1
    assert (
        "trial 'a': the controls don't drive actuator 'law': there is no column 'law'; there are servo" in program.text
    )
    made(tmp_path, ROBOT.replace('"base", "elbow"', '"elbow", "base"'), RECORDINGS, DRIVEN, DAMPING)
    program("check", place, "--reference", folder)
    assert program.code == 1
    assert "robot 'arm' has elbow, base, tip; name them alike, in the same order" in program.text
