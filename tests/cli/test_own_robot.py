"""A robot file of one's own: calibrated, studied, tracked, exported, moved elsewhere, and what is suggested."""

import json
import shlex
import shutil
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from program import process

from films import slowed
from made_robots import DAMPING, RECORDINGS, ROBOT, made_of_files
from markertrack.camera_file import CameraFile, Length, write_camera
from markertrack.video import VideoWriter
from run_settings import run_settings
from small_models import PENDULUM
from swim2real.calibration import RunFolder
from swim2real.cli.options import word
from swim2real.parameters import write_parameters
from swim2real.rl.training_run import TrainingRun
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swim2real.simulation import Engine
from swim2real.trials import load_reference
from swimbase.errors import RunError


@pytest.fixture(scope="module")
def calibrated(pendulum_folder, tmp_path_factory) -> tuple[Path, str]:
    """A run that ends while its loss is falling, in a folder beside the robot file's, and what was said of it."""
    folder = tmp_path_factory.mktemp("own")
    shutil.copytree(pendulum_folder, folder, dirs_exist_ok=True)
    done = process(
        "calibrate", folder / "tracks", "--robot", folder / "pendulum.toml", "--out", folder / "run",
        "--method", "least-squares", "--budget", 4, "--horizon", 0.5, "--quiet",
    )  # fmt: skip
    _, err = done.communicate(timeout=60)
    assert done.returncode == 0, err
    return folder / "run", err


@pytest.mark.slow
def test_identify_leaves_values_that_other_commands_take(program, calibrated, tmp_path):
    run, _ = calibrated
    words = ("identify", run, "--reference", run.parent / "tracks", "--rounds", 1, "--quiet")
    program(*words).done()
    found = run / "identified.json"
    assert f"The values at the lowest loss: {found}; export-model, evaluate and train take this" in program.out
    values = json.loads(found.read_text())
    assert values["loss"] < json.loads((run / "best.json").read_text())["loss"]
    program("evaluate", found, "--reference", run.parent / "tracks", "--horizon", 0.5, "--json").done()
    assert program.json["loss"] == pytest.approx(values["loss"])
    program("export-model", found, "--out", tmp_path / "model.xml").done()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert model.joint("elbow").damping[0] == pytest.approx(values["parameters"]["elbow_damping"], rel=1e-5)


def test_tracking_and_its_check_take_a_robot_file_that_calibrate_refuses(program, pendulum_folder, clip, tmp_path):
    shutil.copytree(pendulum_folder, tmp_path, dirs_exist_ok=True)
    robot, tracks = tmp_path / "pendulum.toml", tmp_path / "tracks"
    robot.write_text(robot.read_text(encoding="utf-8").replace("upper = 0.02", "upper = 0.001"), encoding="utf-8")
    refused = program("calibrate", tracks, "--robot", robot, "--out", tmp_path / "run").sentence(2)
    assert "parameter 'shoulder_damping' is 0.002, out of bounds" in refused
    program("quality", tracks, "--robot", robot).done()
    assert "What was recorded" in program.text
    program("pick", clip.video, "--robot", robot, "--out", tmp_path / "page.html").done()
    assert '"pivot"' in (tmp_path / "page.html").read_text(encoding="utf-8")
    points = tmp_path / "points.json"
    points.write_text("[[200, 180], [250, 180]]")
    program("track", clip.video, "--robot", robot, "--markers", points, "--to", tmp_path / "new")
    assert "hold 2 points; expected are 3" in program.err


@pytest.fixture
def tags(pendulum_folder, tmp_path):
    """A command that tracks a film of three tags, and where they are in its first frame."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
    corners = np.array([[40, 30], [120, 60], [200, 90]])
    with VideoWriter(tmp_path / "pull.mp4", 320, 200, 30) as writer:
        for frame in range(6):
            picture = np.full((200, 320, 3), 220, np.uint8)
            for number, (x, y) in zip((4, 9, 2), corners + [3 * frame, frame], strict=True):  # noqa: RUF005
                picture[y : y + 35, x : x + 35] = cv2.aruco.generateImageMarker(dictionary, number, 35)[:, :, None]
            writer.write(picture, frame / 30)
    length = Length("tape", np.array([[0, 0], [100.0, 0]]), 0.1)
    write_camera(tmp_path / "camera.json", CameraFile(lengths=(length,)))
    command = [
        "track", tmp_path / "pull.mp4", "--robot", pendulum_folder / "pendulum.toml", "--tracker", "aruco", "--tags",
        "5X5_50", "--markers", "auto", "--camera", tmp_path / "camera.json", "--to", tmp_path / "to", "--no-overlay",
    ]  # fmt: skip
    return command, corners


def test_a_film_of_tags_becomes_a_trial_without_a_click(program, tags, tmp_path):
    command, corners = tags
    program(*command).done()
    assert "Next: the same command with --controls TABLE.csv --sensors TABLE.csv" in program.text
    (trial,) = load_reference(tmp_path / "to")
    np.testing.assert_array_equal(trial.track.confidence, 1)
    pixels = trial.track.positions / 1e-3 * [1, -1]
    np.testing.assert_allclose(pixels[5], corners[[2, 0, 1]] + 17 + [15, 5], atol=0.3)  # 2, 4, 9
    program(*command[:6], "--tags", "APRILTAG_16h5", *command[8:])
    assert "the first frame shows 0 tags of APRILTAG_16h5 (none); there must be 3" in program.err


def test_a_film_that_is_longer_than_its_tables_is_named_with_the_rate_that_would_fit(program, tags, tmp_path):
    """Whatever the ratio; with that rate all is well, and a table that is kept keeps its clock."""
    command, robot = tags[0], tags[0][3]
    rows = "".join(f"{k / 100},{np.sin(k)}\n" for k in range(18))
    (tmp_path / "driven.csv").write_text(f"time_s,torque\n{rows}", encoding="utf-8")
    slowed(tmp_path / "pull.mp4", tmp_path / "slow.mp4", 7).replace(tmp_path / "pull.mp4")
    (tmp_path / "read.csv").write_text("time_s,gyro[1]\n0,0.1\n0.17,0.2\n", encoding="utf-8")
    program(*command, "--controls", tmp_path / "driven.csv", "--sensors", tmp_path / "read.csv").done()
    program("quality", tmp_path / "to", "--robot", robot)
    assert program.err == ""
    assert "pull: clocks: track 4.286 Hz by its container, from the first frame of pull.mp4; " in program.text
    assert "controls 100 Hz by its time stamps, from the time 0 of the track" in program.text
    assert "the track lasts 1.17 s, its controls 0.17 s: 6.86 times as long" in program.text
    assert "true rate (--fps) is about 29.4" in " ".join(program.text.split())
    program(*command, "--fps", 30).done()
    program("quality", tmp_path / "to", "--robot", robot)
    assert "track 30 Hz as given, from the first frame of pull.mp4; controls 100 Hz by its time" in program.text
    assert "times as long" not in program.text


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
    if command == "evaluate":
        program(command, "published", *words[2:], "--robot", elsewhere / "pendulum.toml", "--json").done()
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


@pytest.mark.usefixtures("repeatable_swims")
def test_the_published_fish_moves_alike(program, tmp_path):
    out = tmp_path / "fish.xml"
    said = program("export-model", "published", "--out", out)
    assert said.code == 0
    assert "fish.xml: robot 'fish', numbers read back within" in said.out
    model, own = mujoco.MjModel.from_xml_path(str(out)), FISH.build(FISH.space.published).compile()
    ends = []
    for one in (model, own):
        data = mujoco.MjData(one)
        data.ctrl[:] = 6.0
        mujoco.mj_step(one, data, 500)
        ends.append(data.sensordata.copy())
    np.testing.assert_allclose(*ends, atol=1e-4)  # m, half a second


def test_a_robot_files_meshes_are_found_from_anywhere(program, tmp_path):
    robot = load_robot(made_of_files(tmp_path, ROBOT, RECORDINGS, DAMPING))
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    content = {"format": 1, "robot": "arm", "robot_file": "../arm.toml", "parameters": {"damping": 0.25}}
    (folder / "best.json").write_text(json.dumps(content))
    program("export-model", folder, "--out", folder / "out.xml").done()
    model = mujoco.MjModel.from_xml_path(str(folder / "out.xml"))
    assert model.joint("link0").damping[0] == pytest.approx(0.25)
    assert model.nmesh == robot.build({"damping": 0.25}).compile().nmesh == 1


def test_a_suggested_command_quotes_a_path_and_a_draft_has_no_name_of_a_built_in_robot(program, tmp_path):
    model = tmp_path / "a fish.xml"
    model.write_text(PENDULUM.replace('<mujoco model="pendulum"', '<mujoco model="fish"'))
    told = program("init", model).done().out
    assert shlex.split(told.partition("then: ")[2]) == ["swim2real", "check", str(model.with_suffix(".toml"))]
    assert 'name = "my-fish"' in model.with_suffix(".toml").read_text()
    assert word("a b") == "'a b'"


def test_a_robot_with_the_name_of_a_built_in_one_is_told_of(program, caplog, pendulum_folder, tmp_path, monkeypatch):
    robot = tmp_path / "fish.toml"
    robot.write_text((pendulum_folder / "pendulum.toml").read_text().replace('name = "pendulum"', 'name = "fish"', 1))
    shutil.copy(pendulum_folder / "pendulum.xml", tmp_path)
    program("quality", pendulum_folder / "tracks", "--robot", robot).done()
    (told,) = (record.getMessage() for record in caplog.records)
    assert f"robot file '{robot}' has the name 'fish' of the robot that comes with swim2real" in told
    assert "give it another 'name'" in told
    caplog.clear()
    monkeypatch.chdir(tmp_path)
    program("quality", pendulum_folder / "tracks", "--robot", "fish")
    assert "for your file say 'fish.toml'" in caplog.records[0].getMessage()
