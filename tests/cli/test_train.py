"""`train`, `rollout` and `export-commands` as they are used."""

import io
import json
import os
import re
import signal
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from program import process, until

from markertrack.track import MarkerTrack
from swim2real.cli import main
from swim2real.objective.expected_run import read_expected_run
from swim2real.rl.assessment import Wave
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swim2real.trials import Trial, TrialSet, save_reference

EXAMPLES = Path(__file__).parents[2] / "examples"
SHORT = (
    "--parameters", "published", "--env-steps", 400, "--exploration", 200, "--updates", 1, "--checkpoint-every", 200,
)  # fmt: skip


@pytest.fixture(autouse=True, scope="module")
def short_evaluations():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        patch.setattr("swim2real.rl.assessment.constant_waves", lambda: [Wave(1.0)])
        patch.setattr("swim2real.rl.assessment.sine_waves", lambda actuators: [Wave(1.0, 2.0)])
        yield


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short forward run, and what it printed."""
    out = tmp_path_factory.mktemp("train") / "run"
    printed, err = io.StringIO(), io.StringIO()
    with redirect_stdout(printed), redirect_stderr(err), pytest.raises(SystemExit) as leaving:
        main([str(word) for word in ("train", "forward", *SHORT, "--out", out)])
    assert leaving.value.code == 0, err.getvalue()
    return out, printed.getvalue(), err.getvalue()


def test_train_says_how_it_goes_and_what_came_of_it(run):
    out, printed, err = run
    assert "evaluated: return" in err
    assert "400/400" in err
    assert printed.startswith(f"{out}: 400 steps, 1 updates, ")
    assert re.search(r"learning took \d+ % of the time, simulating at the same time \d+ %", printed)
    settings = json.loads((out / "settings.json").read_text())
    assert {"mujoco", "stable-baselines3", "torch", "swim2real"} <= set(settings["versions"])
    assert settings["reference"] == "published"
    page = (out / "training.html").read_text()
    assert "Episode return over environment steps" in page
    assert 'http-equiv="refresh"' not in page  # the run has ended


@pytest.mark.slow
def test_rollout_writes_figures_a_film_and_a_page(run, program, tmp_path):
    pytest.importorskip("av")
    out, _, _ = run
    found = program("rollout", out, "--episodes", 2, "--out", tmp_path, "--closed-loop", "--json").done().json
    assert found["policy"]["episodes"] == 2
    assert found["constant"]["best_distance"] > 0.1
    assert found["sine"]["farthest"] == {"amplitude": 1.0, "frequency": 2.0, "lag": 0.0}
    assert set(found["loops"]) == {"nominal", "open", "closed", "tracked"}
    assert (tmp_path / "rollout.mp4").stat().st_size > 1000
    page = (tmp_path / "training.html").read_text()
    assert "data:video/mp4;base64," in page
    assert "Open and closed loop" in page
    assert 'src="http' not in page


@pytest.mark.slow
def test_export_commands_writes_a_table_that_deploy_takes(run, program, tmp_path):
    out, _, _ = run
    table, beside = tmp_path / "commands.csv", tmp_path / "commands.expected.json"
    about = program("export-commands", out, "--seconds", 1, "--out", table, "--json").done().json
    lines = table.read_text().splitlines()
    assert lines[0] == "time_s,velocity_rad_s"
    assert len(lines) - 1 == about["commands"] >= 50
    assert about["expected"] == str(beside)
    program("deploy", table, "--dry-run").done()
    expected = read_expected_run(beside)
    film = np.stack([expected.x.expected, expected.y.expected], axis=1)[:, None] + [[-0.1, 0.0], [0.04, 0.0]]
    track = MarkerTrack(np.arange(len(film)) / 50, film)
    save_reference(TrialSet((Trial("run-1", track),), ("M0", "M1")), tmp_path / "real")
    compared = program("evaluate", beside, "--reference", tmp_path / "real", "--json").done().json["runs"][0]
    told, *_, measured = compared["figures"]["forward"]
    assert measured == pytest.approx(told, abs=2e-3)
    program("export-commands", out, "--seconds", 1, "--out", tmp_path / "commands.npz").done()
    with np.load(tmp_path / "commands.npz") as arrays:
        assert (list(arrays["names"]), list(arrays["units"]), arrays["times"][1]) == (["motor"], ["rad/s"], 0.02)
        np.testing.assert_array_equal(arrays["commands"][:, 0], [float(line.split(",")[1]) for line in lines[1:]])
    said = program("export-commands", out, "--seconds", 1, "--out", tmp_path / "commands.txt").sentence(2)
    assert "it must end in .csv" in said


def test_what_is_wrong_is_said(run, program, tmp_path):
    out, _, _ = run
    assert "it already holds" not in program("rollout", tmp_path).sentence(1)
    assert "already holds a run" in program("train", "forward", *SHORT, "--out", out, "--quiet").sentence(1)
    assert "--goals is for tasks with goals; this policy's is forward" in program(
        "rollout", out, "--goals", 3
    ).sentence(2)
    assert "must divide 200" in program(
        "train", "forward", "--parameters", "published", "--out", tmp_path / "x", "--environments", 3
    ).sentence(2)


def test_no_policy_is_trained_in_what_swims_backward_from_rest_unless_asked_for(run, program, tmp_path, caplog):
    out, _, _ = run
    path = tmp_path / "short-arm.json"
    values = {**FISH.space.published, "motor_arm_length": 0.01}
    path.write_text(json.dumps({"format": 1, "robot": "fish", "parameters": values}))
    refused = program("train", "forward", "--parameters", path, "--out", tmp_path / "new", "--quiet").sentence(2)
    assert "swims tail first at 1.16 Hz; train no policy in it" in refused
    assert refused.endswith("; --anyway trains all the same")
    assert not (tmp_path / "new").exists()
    program("train", "forward", "--parameters", path, "--out", out, "--quiet", "--anyway")
    assert f"'{path}': unusable: from rest, where a policy and the robot begin, this fit" in caplog.text
    assert "already holds a run" in program.err


@pytest.mark.slow
def test_several_seeds_are_trained_in_folders_of_their_own(tmp_path):
    started = process("train", "forward", *SHORT, "--seeds", "0:2", "--workers", 2, "--out", tmp_path / "runs")
    _, err = started.communicate(timeout=240)
    assert started.returncode == 0, err
    assert "seed 1: " in err
    for k in (0, 1):
        assert json.loads((tmp_path / f"runs/seed-{k}/settings.json").read_text())["seed"] == k
        assert json.loads((tmp_path / f"runs/seed-{k}/outcome.json").read_text())["complete"]
        assert (tmp_path / f"runs/seed-{k}/training.html").is_file()


@pytest.mark.slow
def test_ctrl_c_leaves_checkpoints_of_several_seeds(tmp_path):
    long = ("--parameters", "published", "--env-steps", 40000, "--exploration", 200, "--updates", 1)
    started = process("train", "forward", *long, "--seeds", "0:3", "--workers", 2, "--out", tmp_path)
    until(lambda: all((tmp_path / f"seed-{k}/settings.json").exists() for k in (0, 1)), started)
    time.sleep(3)
    os.kill(started.pid, signal.SIGINT)
    _, err = started.communicate(timeout=60)
    assert started.returncode == 1
    assert "seeds 0, 1, 2 aren't done; the same command with --resume goes on" in err
    for k in (0, 1):
        step = json.loads((tmp_path / f"seed-{k}/outcome.json").read_text())["step"]
        assert list((tmp_path / f"seed-{k}/checkpoints").glob(f"step-{step:09d}/replay.npz"))
    assert not (tmp_path / "seed-2").exists()


@pytest.mark.slow
def test_a_robot_file_and_a_task_of_ones_own_train_roll_out_and_are_exported(program, tmp_path):
    finger, out = EXAMPLES / "finger/finger.toml", tmp_path / "policies/tip"
    values = dict(load_robot(finger).space.published)
    parameters = tmp_path / "finger.json"
    parameters.write_text(json.dumps(
        {"format": 1, "robot": "finger", "robot_file": os.path.relpath(finger, tmp_path), "parameters": values}
    ))  # fmt: skip
    task = f"python:{EXAMPLES / 'finger/reach.py'}:Reach"
    program(
        "train", task, "--parameters", parameters, "--env-steps", 400, "--exploration", 200, "--updates", 1,
        "--checkpoint-every", 400, "--out", out, "--quiet",
    ).done()  # fmt: skip
    settings = json.loads((out / "settings.json").read_text())
    assert not os.path.isabs(settings["task"].split(":")[1])
    assert not os.path.isabs(settings["robot_file"])
    found = program("rollout", out, "--episodes", 2, "--no-film", "--json").done().json
    assert found["policy"]["goal_distance"] > 0
    program("export-commands", out, "--seconds", 1, "--out", tmp_path / "tip.csv").done()
    assert (tmp_path / "tip.csv").read_text().startswith("time_s,winch_m\n0.00,")
    refused = program("deploy", tmp_path / "tip.csv", "--dry-run").sentence(2)
    assert "winch_m" in refused
