"""`--robot` where a run, a parameters file or a policy names a robot file that is elsewhere now."""

import json
import shutil

import pytest

from run_settings import run_settings
from swim2real.api import run_robot
from swim2real.calibration import RunFolder
from swim2real.errors import RunError
from swim2real.parameters import write_parameters
from swim2real.rl.training_run import TrainingRun
from swim2real.robots import load_robot
from swim2real.simulation import Engine


@pytest.fixture
def moved(pendulum_folder, tmp_path):
    """What is there of a run whose robot file isn't where it says, the folder of that file, and the reference."""
    elsewhere, run = tmp_path / "elsewhere", tmp_path / "run"
    elsewhere.mkdir()
    run.mkdir()
    for name in ("pendulum.toml", "pendulum.xml"):
        shutil.copy(pendulum_folder / name, elsewhere)
    other = (elsewhere / "pendulum.toml").read_text().replace('"pendulum"', '"other"', 1)
    (elsewhere / "other.toml").write_text(other)
    robot = load_robot(elsewhere / "pendulum.toml")
    gone, engine = tmp_path / "pendulum.toml", Engine.of(robot)
    write_parameters(run / "best.json", robot.name, robot.space.published, engine.name, engine.as_dict(), gone)
    RunFolder(run).begin(run_settings(robot=robot.name, robot_file="../pendulum.toml"))
    return run, elsewhere, pendulum_folder / "tracks"


@pytest.mark.parametrize("command", ["evaluate", "export-model"])
def test_a_robot_file_that_has_moved_is_given(program, moved, tmp_path, command):
    run, elsewhere, tracks = moved
    more = {"evaluate": ("--reference", tracks, "--horizon", 0.2), "export-model": ("--out", tmp_path / "m.xml")}
    words = (command, run, *more[command])
    told = program(*words)
    assert told.code in (1, 2)
    assert "is not there; give its place with --robot" in told.err
    program(*words, "--robot", elsewhere / "pendulum.toml").done()
    assert program(*words, "--robot", elsewhere / "other.toml").code in (1, 2)
    assert "not 'other'; give" in program.err


def test_a_report_is_of_the_robot_that_is_given(moved):
    run, elsewhere = RunFolder(moved[0]), moved[1]
    with pytest.raises(RunError, match="is not there; give its place with --robot"):
        run_robot(run)
    with pytest.raises(RunError, match="is of robot 'pendulum', not 'other'"):
        run_robot(run, elsewhere / "other.toml")
    assert run_robot(run, elsewhere / "pendulum.toml").name == "pendulum"


def test_published_values_are_those_of_the_given_robot(program, moved, tmp_path):
    _, elsewhere, tracks = moved
    program(
        "evaluate", "published", "--robot", elsewhere / "pendulum.toml", "--reference", tracks, "--horizon", 0.2,
        "--json",
    ).done()  # fmt: skip
    assert 0 < program.json["loss"] < 0.1


def test_a_policy_takes_its_robot_from_where_it_is_now(moved, tmp_path):
    _, elsewhere, _ = moved
    settings = {
        "kind": "training", "task": "forward", "robot": "pendulum", "robot_file": "gone.toml", "seed": 0,
        "env_steps": 1, "exploration": 1, "parameters": [{}], "disturbances": {},
    }  # fmt: skip
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    with pytest.raises(RunError, match="is not there; give its place with --robot"):
        _ = TrainingRun.open(tmp_path).robot
    assert TrainingRun.open(tmp_path, robot=str(elsewhere / "pendulum.toml")).robot.name == "pendulum"
    with pytest.raises(RunError, match="is of robot 'pendulum', not 'other'"):
        _ = TrainingRun.open(tmp_path, robot=str(elsewhere / "other.toml")).robot
