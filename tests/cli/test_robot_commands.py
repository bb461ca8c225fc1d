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
    for table, part in (
        (UNUSED, "x changes nothing of the model: body 'upper' has no <inertial>"),
        (parameter("'geom \"rod0\" friction[0]'", 0.1, 2.0), "x moves no marker"),
        (parameter("'joint \"link0\" range[0]'", -40.0, 70.0), "robot 'arm', x = 70: the model doesn't compile: "),
    ):
        program("check", made(tmp_path, ROBOT, RECORDINGS, table))
        assert program.code == 1
        assert part in program.text
    # what is worth knowing fails nothing
    faint = parameter("'joint \"link1\" stiffness'", 1.99999, 2.00001).replace('"x"', '"faint"')
    strong = parameter("'option gravity[0]'", 0.0, 1e12)
    program("check", made(tmp_path, ROBOT, '[recordings]\nstart = "markers"\n', strong, faint)).done()
    assert "faint hardly shows" in program.text
    assert "x = 1e+12: excitation: the simulation diverged " in program.text


@pytest.mark.slow
def test_real_trials_are_used_and_must_fit(program, tmp_path):
    place = made(tmp_path, ROBOT, RECORDINGS, DRIVEN, DAMPING)
    robot = load_robot(place)
    trial, player = excitation(robot, 1.0), PlaybackSimulator(robot, 1)
    seen = player.simulate(robot.space.published, [player.request(trial)]).trials[0]
    real, folder = replace(seen, name="a", controls=trial.controls), tmp_path / "reference"
    save_reference(TrialSet((real,), robot.marker_names), folder)
    program("check", place, "--reference", folder).done()
    assert "All trials fit: a." in program.text
    assert "Warning" not in program.text
    track = MarkerTrack(seen.track.times, seen.track.positions + np.array([0.6, 0.0]))
    save_reference(TrialSet((replace(real, track=track),), robot.marker_names), tmp_path / "away")
    program("check", place, "--reference", tmp_path / "away")
    assert program.code == 1
    assert "trial 'a': it lies beside the robot by x +600 mm, z +0 mm" in rows(program)
    quick = ("--method", "random", "--budget", 1, "--threads", 1, "--quiet")
    program("calibrate", tmp_path / "away", "--robot", place, "--out", tmp_path / "run", *quick)
    assert program.err.startswith("swim2real: warning: trial 'a': it lies beside the robot")
    for text, controls, part in (
        (ROBOT, DRIVEN.replace("servo", "law"), "actuator 'law': there is no column 'law'; there are servo"),
        (ROBOT.replace('"base", "elbow"', '"elbow", "base"'), DRIVEN, "robot 'arm' has elbow, base, tip"),
    ):
        program("check", made(tmp_path, text, RECORDINGS, controls, DAMPING), "--reference", folder)
        assert program.code == 1
        assert part in program.text
