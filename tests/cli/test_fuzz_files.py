"""Every file that the program reads, damaged in thousands of ways: it is read, or refused in a sentence."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from markupsafe import Markup

from made_results import made_results, made_run
from markertrack.camera_file import read_camera
from markertrack.points import load_anchors, load_points
from motorline.commands import read_table
from motorline.motors_file import read_motors
from mutations import mutated
from run_settings import record_of
from swim2real import api
from swim2real.advisor.vlm.transcript import Transcript
from swim2real.calibration import RunFolder
from swim2real.cli import main
from swim2real.comparison import make_plan
from swim2real.comparison.plan import read_plan
from swim2real.comparison.results import load_results, write_results
from swim2real.identification.ensemble import make_ensemble, read_ensemble
from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import read_study
from swim2real.optimizers import recorded_advice
from swim2real.parameters import read_parameters, robot_of
from swim2real.report import pages
from swim2real.rl.training_run import TrainingRun
from swim2real.robots import load_robot
from swim2real.robots.robot import Robot
from swim2real.settings import ComparisonSettings, EnsembleSettings
from swim2real.trials import load_reference
from swim2real.trials.pose_tables import read_dlc
from swimbase.errors import Swim2RealError

PROJECT = Path(__file__).resolve().parents[2]
SECONDS, MEMORY = 20.0, 1e9  # s and bytes that any file may cost

NAMES = ("pivot", "middle", "end")


def made(folder: Path) -> Path:
    """Every kind of file, as the program writes them, in a folder with the pendulum, its tracks and a run."""
    reference = load_reference(folder / "tracks")
    robot = load_robot(str(folder / "pendulum.toml"))
    content = make_ensemble([reopen(folder / "run", reference, robot)], EnsembleSettings(within=9.0))
    (folder / "ensemble.json").write_text(json.dumps(content))
    point = {"point": [0.5] * len(robot.space), "loss": 0.01}
    study = {"format": 2, "complete": True, "evaluations": 3, "start": point, "lowest": point, "checked": [point]}
    conditions = reopen(folder / "run", reference, robot).conditions()
    (folder / "run" / "identifiability.json").write_text(json.dumps({**conditions, **study}))
    calls = folder / "run" / "advisor"
    calls.mkdir(exist_ok=True)
    shutil.copy(PROJECT / "examples/vlm-runs/fish-0/advisor/call_0001.json", calls)
    (folder / "camera.json").write_text(json.dumps(CAMERA))
    (folder / "points.json").write_text(json.dumps(POINTS))
    (folder / "corrections.json").write_text(json.dumps(CORRECTIONS))
    rows = "".join(f"{k / 50:.2f},{0.1 * k},{0.02 * k}\n" for k in range(40))
    (folder / "commands.csv").write_text("time_s,wheel_rad_s,tail_rad\n" + rows)
    (folder / "motors.toml").write_text(MOTORS)
    (folder / "poses.csv").write_text(POSES)
    (folder / "compared").mkdir()
    asked = ComparisonSettings(methods=("random", "line-search"), seeds=(0, 1), budget=4, horizon=None)
    make_plan(asked, reference, robot).write(folder / "compared")
    write_results(made_results(made_run("good", 0, [0.2, 0.1] * 4), made_run("bad", 0, [0.3] * 8)), folder / "compared")
    trained = {"kind": "training", "robot": "fish", "task": "forward", "seed": 0, "env_steps": 400,
               "exploration": 200, "parameters": [load_robot("fish").space.published], "disturbances": {}}  # fmt: skip
    (folder / "policy").mkdir()
    (folder / "policy" / "settings.json").write_text(json.dumps(trained))
    return folder


CAMERA = {
    "format": 1,
    "camera_height": 1.2, "principal_point": [320, 240], "lengths": [{"pixels": [[0, 0], [100, 0]], "meters": 0.1}],
    "points": [{"pixel": [0, 0], "meters": [0, 0]}, {"pixel": [100, 0], "meters": [0.1, 0]},
               {"pixel": [100, 100], "meters": [0.1, 0.1]}, {"pixel": [0, 100], "meters": [0, 0.1]}],
    "lens": {"camera_matrix": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "distortion": [0.1, 0, 0, 0, 0]},
}  # fmt: skip
POINTS = {"video": "swim.mp4", "width": 640, "height": 480, "frame": 0,
          "markers": {"pivot": [10, 20], "middle": [100.5, 20], "end": [200, 40]}}  # fmt: skip
CORRECTIONS = {
    "video": "a.mp4", "width": 640, "height": 480,
    "frames": [{"frame": 7, "markers": {"end": [1, 2], "middle": None}}, {"frame": 9, "markers": {}}],
}  # fmt: skip
MOTORS = "[wheel]\nid = 1\nspeed = 6\ndirection = -1\n\n[tail]\nid = 2\nlowest = -1\nhighest = 1.5\nzero = 3.0\n"
POSES = "scorer,a,a,a,a,a,a\nbodyparts,M0,M0,M0,M1,M1,M1\ncoords,x,y,likelihood,x,y,likelihood\n" + "".join(
    f"{k},{k},1,0.9,{k + 5},2,1\n" for k in range(20)
)


def run(words: list[str], folder: Path) -> int:
    """Runs a command in a folder; its exit code."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        main(words)
    except SystemExit as leaving:
        return int(leaving.code or 0)
    finally:
        os.chdir(before)
    return 0


def program(*words: str) -> Callable[[Path], object]:
    return lambda folder: run(list(words), folder)


def _robot(folder: Path) -> Robot:
    return load_robot(str(folder / "pendulum.toml"))


def _resumed(folder: Path) -> object:
    recorded = RunFolder(folder / "run")
    return recorded.settings(), recorded_advice(record_of(recorded)), recorded.outcome()


def _reopened(folder: Path) -> object:
    robot, reference = load_robot(str(folder / "pendulum.toml")), load_reference(folder / "tracks")
    again = reopen(folder / "run", reference, robot, threads=1)
    return make_ensemble([again], EnsembleSettings(within=9.0))


def _commands(folder: Path) -> object:
    table = read_table(folder / "commands.csv")
    limits = {motor.column: motor.limits for motor in read_motors(folder / "motors.toml", table.columns)}
    return table.ramped(20.0).clipped(limits)


REPORT = program("report", "run")
RUN = (REPORT, _resumed, lambda at: api.open_run(at / "run"), _reopened)
QUALITY = program("quality", "tracks", "--robot", "pendulum.toml")
READERS: dict[str, tuple[Callable[[Path], object], ...]] = {
    # of each file, what reads it: commands in this process, or what a command would read before it simulates
    "run/settings.json": (*RUN, program("rollout", "run", "--out", "rolled")),
    "run/record.jsonl": RUN,
    "run/outcome.json": RUN,
    "run/trials.npz": (REPORT,),
    "run/best.json": (
        lambda at: robot_of(at / "run"), lambda at: read_parameters(at / "run", "pendulum", _robot(at).space), RUN[2],
    ),
    "run/identifiability.json": (lambda at: read_study(at / "run/identifiability.json"), _reopened),
    "run/advisor/call_0001.json": (lambda at: Transcript(at / "run").calls, REPORT),
    "ensemble.json": (lambda at: read_ensemble(at / "ensemble.json", _robot(at)),),
    "tracks/reference.json": (lambda at: load_reference(at / "tracks"), QUALITY),
    "tracks/a.csv": (lambda at: load_reference(at / "tracks"), QUALITY),
    "tracks/a.controls.csv": (lambda at: load_reference(at / "tracks"),),
    "tracks/a.sensors.csv": (lambda at: load_reference(at / "tracks"),),
    "pendulum.toml": (_robot,),
    "camera.json": (lambda at: read_camera(at / "camera.json"),),
    "points.json": (lambda at: load_points(at / "points.json", NAMES, 640, 480),),
    "corrections.json": (lambda at: load_anchors(at / "corrections.json", NAMES, 640, 480, "a.mp4"),),
    "commands.csv": (_commands,),
    "motors.toml": (lambda at: read_motors(at / "motors.toml", ("wheel_rad_s", "tail_rad")),),
    "poses.csv": (lambda at: read_dlc(at / "poses.csv", 60.0),),
    "compared/plan.json": (lambda at: read_plan(at / "compared"),),
    # figures take seconds
    "compared/results.json": (*(lambda at: load_results(at / "compared"),) * 24, program("report", "compared")),
    "policy/settings.json": (
        lambda at: TrainingRun.open(at / "policy").robot, lambda at: TrainingRun.open(at / "policy").task,
        program("rollout", "policy", "--out", "rolled"),
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def corpus(pendulum_folder, finished, tmp_path_factory):
    folder = Path(shutil.copytree(pendulum_folder, tmp_path_factory.mktemp("corpus"), dirs_exist_ok=True))
    shutil.copytree(finished, folder / "run")
    return made(folder)


@pytest.fixture(autouse=True)
def _no_charts(monkeypatch):
    """Charts take most of a page's time; these files are read before they are drawn."""
    monkeypatch.setattr(pages, "inline_svg", lambda draw, name: Markup("<svg></svg>"))


def complaint(read: Callable[[Path], object], folder: Path, capsys) -> str:
    """What is wrong in how a damaged file was met; empty where it was read or refused in a sentence."""
    capsys.readouterr()
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read(folder)
    except Swim2RealError as error:
        if not str(error) or len(str(error)) > 3000:
            return f"a sentence of {len(str(error))} characters"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    told = capsys.readouterr().err
    if "unexpected" in told or "Traceback" in told:
        return told[-300:]
    if time.process_time() - began > SECONDS:
        return f"{time.process_time() - began:.0f} s"
    return ""


def fuzzed(name: str, corpus: Path, count: int, capsys) -> list[str]:
    """What was wrong in how a file was met that was damaged so many times."""
    chance = random.Random(name)
    path = corpus / name
    whole = path.read_bytes()
    kept = {other: other.read_bytes() for other in corpus.rglob("*") if other.is_file() and other.suffix != ".lock"}
    problems: list[str] = []
    try:
        for number in range(count):
            data = mutated(name, whole, chance)
            path.write_bytes(data)
            read = READERS[name][number % len(READERS[name])]
            if wrong := complaint(read, corpus, capsys):
                problems.append(f"{name}, {number}: {wrong}")
    finally:
        for other, content in kept.items():
            if not other.is_file() or other.read_bytes() != content:
                other.write_bytes(content)
    return problems


@pytest.mark.parametrize("count", [3, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_refused(name, count, corpus, capsys):
    before = most_memory()
    problems = fuzzed(name, corpus, count, capsys)
    assert not problems, "\n".join(problems)
    assert most_memory() - before < MEMORY


def most_memory() -> float:
    """Bytes that this process has had at most; what came before isn't this test's."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
