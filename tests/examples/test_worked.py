"""The worked examples: robots of one's own, whose parameters are hidden in a lab, from films to values."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from swim2real.calibration import Problem
from swim2real.pipeline import calibrate
from swim2real.settings import CalibrationSettings
from swim2real.trials import TrialSet

PROJECT = Path(__file__).resolve().parents[2]
# what each example's trials can't tell
UNTOLD = {"finger": {"air_density"}, "snake": {"joint_damping", "servo_damping"}}
BAR = 0.05  # of a parameter that they tell


@dataclass(frozen=True)
class Example:
    """An example with its recordings, as markers."""

    name: str
    code: ModuleType
    problem: Problem

    @property
    def told(self) -> list[str]:
        return [name for name in self.code.HIDDEN if name not in UNTOLD[self.name]]

    def off(self, values) -> dict[str, float]:
        """By how much values that the trials tell are off, as a share of the hidden ones."""
        return {name: abs(values[name] / self.code.HIDDEN[name] - 1) for name in self.told}


def code_of(name: str) -> ModuleType:
    place = PROJECT / "examples" / name / "make_data.py"
    spec = importlib.util.spec_from_file_location(f"example_{name}", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=UNTOLD)
def example(request) -> Example:
    code = code_of(request.param)
    return Example(request.param, code, Problem(code.ROBOT, code.LAB.record(code.takes()), horizon=1.2))


def test_hidden_parameters_explain_the_recordings_but_for_what_the_model_lacks(example):
    hidden, drawing = example.problem.evaluate_many([example.code.HIDDEN, example.code.ROBOT.space.published])
    noise = example.code.LAB.marker_noise
    assert noise < hidden.loss < 2e-3
    assert drawing.loss > 5 * hidden.loss


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [0, 1])
def test_what_the_trials_tell_is_found_within_sixty_evaluations(example, tmp_path, seed):
    settings = CalibrationSettings(method="least-squares", budget=60, seed=seed)
    recordings = example.code.LAB.record(example.code.takes())
    calibrate(recordings, example.code.ROBOT, settings, tmp_path / "run")
    found = json.loads((tmp_path / "run" / "best.json").read_text())
    assert max(example.off(found["parameters"]).values()) < BAR


def run_page(name: str, folder: Path) -> Path:
    """Runs all commands of an example's README, training for a moment only; the run's folder."""
    (folder / "examples").symlink_to(PROJECT / "examples")
    page = (PROJECT / "examples" / name / "README.md").read_text(encoding="utf-8")
    commands = "\n".join(re.findall(r"```sh\n(.*?)```", page, re.DOTALL))
    for long, short in {
        r"--env-steps \d+ --updates \d+": "--env-steps 1000 --updates 1",
        "--goals 100": "--goals 2",
    }.items():
        commands = re.sub(long, short, commands)  # a policy that has hardly learned
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-c", commands], cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / "lab" / "run"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_from_films_to_parameters_as_the_page_says(example, tmp_path):
    folder = run_page(example.name, tmp_path)
    found = json.loads((folder / "best.json").read_text())
    assert len((folder / "record.jsonl").read_text().splitlines()) <= 60
    assert max(example.off(found["parameters"]).values()) < BAR
    study = json.loads((folder / "identifiability.json").read_text())
    known = {name: one["known"] for name, one in study["intervals"].items()}
    assert {name for name, how in known.items() if how == "undetermined"} == UNTOLD[example.name]
    assert set(study["directions"][-1]["parameters"]) == UNTOLD[example.name]


def test_six_commands_lead_from_a_model_to_a_first_calibration():
    page = (PROJECT / "examples" / "finger" / "README.md").read_text(encoding="utf-8")
    first = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)[1]
    commands = re.findall(r"^swim2real (\w+)", first, re.MULTILINE)
    assert (commands[0], commands[-1]) == ("init", "calibrate")
    assert len(commands) <= 6
    assert "python" not in first
    assert np.all([line.startswith("swim2real ") or line.startswith("  ") for line in first.splitlines()])


# an arm whose encoders are recorded, without a camera

WEAK = {"elbow_damping", "shoulder_friction", "elbow_friction"}  # found within a sixth


def test_hidden_parameters_explain_the_recordings_of_encoders():
    code = code_of("arm")
    made = code.record()
    problem = Problem(code.ROBOT, TrialSet((made["steps"], made["place"])), horizon=0.8, threads=2)
    hidden, drawing = problem.evaluate_many([code.HIDDEN, code.ROBOT.space.published])
    assert code.COUNT / 4 * 0.3 < hidden.loss < 1e-3
    assert drawing.loss > 5 * hidden.loss
    assert made.marker_names == ()


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_from_tables_to_parameters_as_the_page_says(tmp_path):
    code, folder = code_of("arm"), run_page("arm", tmp_path)
    found = json.loads((folder / "identified.json").read_text())["parameters"]
    for name, hidden in code.HIDDEN.items():
        assert abs(found[name] / hidden - 1) < (1 / 6 if name in WEAK else BAR), name
    outcome = json.loads((folder / "outcome.json").read_text())
    assert outcome["held_out"]["loss"] < 2e-3
    study = json.loads((folder / "identifiability.json").read_text())["intervals"]
    for name, hidden in code.HIDDEN.items():
        low, high = study[name]["interval_95"]
        assert low < hidden < high
