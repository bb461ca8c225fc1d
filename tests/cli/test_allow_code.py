"""Files of strangers that name Python: no command runs it before `--allow-code`, however it comes upon the file."""

import json
import shutil
from dataclasses import asdict

import numpy as np
import pytest

from made_robots import ARM, DAMPING, RECORDINGS, ROBOT, made
from run_settings import run_settings
from swim2real import consent
from swim2real.rl.actor import Actor, Linear

TRAINING = {
    "kind": "training", "task": "forward", "robot": "fish", "seed": 0, "env_steps": 400, "exploration": 200,
    "parameters": [{"hull_yaw": 1.0}],
    "disturbances": {"phase": [0, 0], "current": [0, 0], "tendon_friction": 0.0, "estimate": None},
}  # fmt: skip
CODE = f"""
from pathlib import Path
import mujoco
with Path(__file__).with_name("ran").open("a") as file:
    file.write("x")
def model():
    return mujoco.MjSpec.from_string('''{ARM}''')
class Task:
    stages = ()
"""


@pytest.fixture
def stranger(tmp_path, pendulum_folder):
    """A folder with a robot file, a parameters file, a run and a policy, whose code leaves a mark."""
    made(tmp_path, ROBOT.replace("arm.xml", "python:code.py:model"), RECORDINGS, DAMPING)
    (tmp_path / "code.py").write_text(CODE)
    shutil.copytree(pendulum_folder / "tracks", tmp_path / "tracks")
    named = {"robot": "arm", "robot_file": "../arm.toml"}
    parameters = {"format": 1, **named, "parameters": {"damping": 0.1}}
    for name, content in (
        ("run/settings.json", {"format": 1, **asdict(run_settings(**named))}), ("run/best.json", parameters),
        ("robot-policy/settings.json", {**TRAINING, **named}),
        ("task-policy/settings.json", {**TRAINING, "task": "python:../code.py:Task"}),
    ):  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(json.dumps(content))
    layer = Linear(np.zeros((3, 1), np.float32), np.zeros(1, np.float32))
    for policy in ("robot-policy", "task-policy"):
        Actor((), layer, layer).save(tmp_path / policy / "best.npz", {})
    return tmp_path


COMMANDS = (
    "check arm.toml", "track film.mp4 --robot arm.toml --markers p.json --to t", "pick film.mp4 --robot arm.toml",
    "quality tracks --robot arm.toml", "calibrate tracks --robot arm.toml --out new", "evaluate run --reference tracks",
    "evaluate run/best.json --reference tracks", "overlay run --reference tracks --out o",
    "simulate run --frequency 1 --out s.npz", "report run", "view run --film v.mp4", "identify run --reference tracks",
    "ensemble run --reference tracks --out e.json", "next run --reference tracks", "export-model run --out m.xml",
    "train forward --parameters run --out new", "rollout robot-policy", "rollout task-policy",
    "export-commands robot-policy --seconds 1 --out c.csv", "export-commands task-policy --seconds 1 --out c.csv",
)  # fmt: skip
SLOW = ("compare tracks --robot arm.toml --out new", "train forward --robot arm.toml --parameters published --out new")


@pytest.mark.parametrize("words", [*COMMANDS, *(pytest.param(words, marks=pytest.mark.slow) for words in SLOW)])
def test_no_command_runs_code_that_a_file_names(program, stranger, monkeypatch, words):
    monkeypatch.chdir(stranger)
    sentence = program(*words.split()).sentence(2)
    assert "names Python code, which would run with your rights: '" in sentence, sentence
    assert "code.py' (" in sentence
    assert "--allow-code" in sentence
    assert not (stranger / "ran").exists()


def test_once_allowed_it_runs_until_it_changes(program, stranger, monkeypatch):
    monkeypatch.chdir(stranger)
    export = ("export-model", "run", "--out", "m.xml")
    program("--allow-code", *export).done()
    monkeypatch.setattr(consent, "_marks", set())  # as in the next process
    program(*export).done()
    with (stranger / "code.py").open("a") as file:
        file.write("# more\n")
    program(*export).sentence(2)
    program(*export, "--allow-code").done()


def test_an_option_for_one_command_is_none_for_the_next(program, stranger, monkeypatch):
    monkeypatch.chdir(stranger)
    program("report", "run", "--allow-code")
    assert (stranger / "ran").read_text() == "x"
    (stranger / "code.py").write_text(CODE + "\n")
    program("report", "run").sentence(2)
    assert (stranger / "ran").read_text() == "x"


@pytest.mark.parametrize(
    "words", ["init outside.xml --out new.toml", "check outside.toml", "view outside.xml --film v.mp4"]
)
def test_no_command_reads_files_outside_of_a_models_folder(program, tmp_path, monkeypatch, words):
    folder = tmp_path / "model"
    made(folder, ROBOT.replace("arm.xml", "outside.xml"), RECORDINGS, DAMPING,
         model=ARM.replace("<worldbody>", '<include file="../visual.xml"/><worldbody>'), name="outside")  # fmt: skip
    (tmp_path / "visual.xml").write_text("<mujocoinclude><visual/></mujocoinclude>")
    monkeypatch.chdir(folder)
    sentence = program(*words.split()).sentence(2)
    assert f"reads files outside of its folder: '{tmp_path / 'visual.xml'}'" in sentence
    assert "--allow-outside" in sentence
    if words.startswith("check"):
        program(*words.split(), "--allow-outside").done()
        program(*words.split()).done()
