"""The worked example without a camera: an arm whose encoders are recorded, from tables to values."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_worked import BAR, PROJECT, code_of

from swim2real.calibration import Problem
from swim2real.trials import TrialSet

WEAK = {"elbow_damping", "shoulder_friction", "elbow_friction"}  # found within a sixth


@pytest.fixture(scope="module")
def code():
    return code_of("arm")


def test_hidden_parameters_explain_the_recordings_but_for_what_the_model_lacks(code):
    made = code.record()
    problem = Problem(code.ROBOT, TrialSet((made["steps"], made["place"])), horizon=0.8, threads=2)
    hidden, drawing = problem.evaluate_many([code.HIDDEN, code.ROBOT.space.published])
    assert code.COUNT / 4 * 0.3 < hidden.loss < 1e-3
    assert drawing.loss > 5 * hidden.loss
    assert made.marker_names == ()


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_from_tables_to_parameters_as_the_page_says(code, tmp_path):
    """Runs all commands of the README, and holds it to its numbers."""
    (tmp_path / "examples").symlink_to(PROJECT / "examples")
    page = (PROJECT / "examples" / "arm" / "README.md").read_text(encoding="utf-8")
    commands = "\n".join(re.findall(r"```sh\n(.*?)```", page, re.DOTALL))
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-c", commands], cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "lab" / "run"
    found = json.loads((folder / "identified.json").read_text())["parameters"]
    for name, hidden in code.HIDDEN.items():
        assert abs(found[name] / hidden - 1) < (1 / 6 if name in WEAK else BAR), name
    outcome = json.loads((folder / "outcome.json").read_text())
    assert outcome["held_out"]["loss"] < 2e-3
    profiles = json.loads((folder / "identifiability.json").read_text())["profiles"]
    assert {one["verdict"] for one in profiles.values()} == {"identified"}
