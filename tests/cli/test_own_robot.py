"""A robot file and its recordings, from `calibrate` on."""

import json
import shutil
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from program import process

from run_settings import record_of
from swim2real.calibration import RunFolder
from swim2real.calibration.convergence import still_falling
from swim2real.calibration.file_models import RecordedEvaluation
from swim2real.tracking.camera_file import CameraFile, Length, write_camera
from swim2real.trials import load_reference
from swim2real.video import VideoWriter


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
def test_a_run_that_has_not_converged_is_told_and_so_is_its_page(calibrated):
    run, err = calibrated
    entries = [RecordedEvaluation.model_validate(entry) for entry in record_of(run)]
    warning = still_falling(entries, RunFolder(run).settings())
    assert warning
    assert err.endswith(f"swim2real: warning: {warning}\n")
    assert f"Warning: {warning}." in (run / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_identify_leaves_values_that_other_commands_take(program, calibrated, tmp_path):
    run, _ = calibrated
    words = ("identify", run, "--reference", run.parent / "tracks", "--steps", 0, "--polish", 1, "--quiet")
    program(*words).done()
    found = run / "identified.json"
    said = (
        f"The values at the lowest loss: {found}; export-model, evaluate and train take this file in place of the run."
    )
    assert program.out.endswith(f"{said}\n")
    values = json.loads(found.read_text())
    assert values["loss"] < json.loads((run / "best.json").read_text())["loss"]
    program("evaluate", found, "--reference", run.parent / "tracks", "--horizon", 0.5, "--json").done()
    assert program.json["loss"] == pytest.approx(values["loss"])
    program("export-model", found, "--out", tmp_path / "model.xml").done()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert model.joint("elbow").damping[0] == pytest.approx(values["parameters"]["elbow_damping"], rel=1e-5)


@pytest.mark.slow
def test_a_parameters_file_that_has_left_its_robot_file_is_named_with_what_to_do(program, calibrated, tmp_path):
    run, _ = calibrated
    copy = Path(shutil.copy(run / "best.json", tmp_path))
    assert program("export-model", copy, "--out", tmp_path / "model.xml").sentence(2) == (
        f"parameters file '{copy}': its robot file '../pendulum.toml', looked up from the folder of the parameters "
        f"file, is not there; give its place with --robot, or as the parameters file's 'robot_file'"
    )
    content = {**json.loads(copy.read_text()), "robot_file": str(run.parent / "pendulum.toml")}
    copy.write_text(json.dumps(content))
    program("export-model", copy, "--out", tmp_path / "model.xml").done()


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


def test_a_film_of_tags_becomes_a_trial_without_a_click(program, pendulum_folder, tmp_path):
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
    program(*command).done()
    (trial,) = load_reference(tmp_path / "to")
    np.testing.assert_array_equal(trial.track.confidence, 1)
    pixels = trial.track.positions / 1e-3 * [1, -1]
    np.testing.assert_allclose(pixels[5], corners[[2, 0, 1]] + 17 + [15, 5], atol=0.3)  # 2, 4, 9
    program(*command[:6], "--tags", "APRILTAG_16h5", *command[8:])
    assert "the first frame shows 0 tags of APRILTAG_16h5 (none); there must be 3" in program.err
