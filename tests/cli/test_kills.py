"""The long commands killed at random moments, five times each, and gone on with.

What comes out is what an uninterrupted run gives, but for fields of time, and nobody works on.
"""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import numpy as np
import pytest
from pool import PoolCamera
from program import process
from swims import film_demo

import swim2real

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="no /proc to find processes in"),
]

KILLS = 5
GRACE = 10.0  # s within which everybody who worked for a killed process has ended
OF_TIME = {"seconds", "created", "steps_per_second", "learner_share", "simulator_share"}
LEFT_OUT = {".html", ".lock", ".pdf", ".png"}  # pages and figures are made of the files that are compared
TIMED = {"progress.jsonl"}  # of a training: where its time went


def working(mark: str) -> list[int]:
    """Processes that have a mark in their environment, which children inherit."""
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (path / "environ").read_bytes() and ") Z " not in (path / "stat").read_text():
                found.append(int(path.name))
        except OSError:
            continue
    return found


def timeless(content):
    """JSON without its fields of time, and sentences without the time that is left."""
    if isinstance(content, str):
        return re.sub("about .* more at this pace", "", content)
    if isinstance(content, dict):
        return {key: timeless(value) for key, value in content.items() if key not in OF_TIME}
    return [timeless(value) for value in content] if isinstance(content, list) else content


def contents(folder: Path) -> dict[str, object]:
    """What all files of a folder say."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_dir() or path.suffix in LEFT_OUT or path.name in (*TIMED, ".lock") or "tensorboard" in name:
            continue
        if path.suffix == ".json":
            found[name] = timeless(json.loads(path.read_text(encoding="utf-8")))
        elif path.suffix == ".jsonl":
            found[name] = [timeless(json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                found[name] = {key: (array.dtype.str, array.shape, array.tobytes()) for key, array in arrays.items()}
        else:
            found[name] = path.read_bytes()
    return found


def survives(
    command: str, words, out: Path, monkeypatch, resume: str = "", begun: str = "settings.json", start=process
) -> None:
    """Runs a command once in peace and once with kills, at moments that its name draws, and compares.

    `words` makes the command of a folder; `resume` is the option with which it goes on once `begun` is in the folder.
    """
    began = time.monotonic()
    peaceful = start(*words(out / "peace"))
    _, err = peaceful.communicate(timeout=600)
    assert peaceful.returncode == 0, err
    duration = time.monotonic() - began
    killed, rng, place, given = 0, random.Random(command), out / "killed", out / "given"
    if place.exists():  # what the command begins with
        shutil.copytree(place, given)
    for _ in range(3 * KILLS):
        mark = uuid.uuid4().hex
        monkeypatch.setenv("SWIM2REAL_TEST", mark)
        more = [resume] if resume and (place / begun).exists() else []
        started = start(*words(place), *more)
        if killed < KILLS:
            try:  # a first part of the time is spent on imports
                started.wait(duration * rng.uniform(0.3, 0.9))
            except subprocess.TimeoutExpired:
                os.kill(started.pid, signal.SIGKILL)
                killed += 1
        _, err = started.communicate(timeout=600)
        deadline = time.monotonic() + GRACE
        while working(mark) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not working(mark), "processes work on for one that was killed"
        assert started.returncode in (0, -signal.SIGKILL), err
        if started.returncode == 0 and killed == KILLS:
            break
        if started.returncode == 0:  # it was quicker than the one in peace: anew, and sooner
            duration *= 0.8
            shutil.rmtree(place)
            if given.exists():
                shutil.copytree(given, place)
    assert killed >= KILLS
    assert not [path for path in place.rglob("*.part") if "html" not in path.name]
    peace, war = contents(out / "peace"), contents(place)
    assert set(peace) == set(war), set(peace) ^ set(war)
    for name, content in peace.items():
        assert war[name] == content, name


SMALL_DEMO = """
from pathlib import Path
from swim2real import demo, settings
from swim2real.cli import main
demo.track.__kwdefaults__["films"] = Path({films!r})
settings.IdentifiabilitySettings.__init__.__defaults__ = (1, 0)
main()
"""
SMALL = PoolCamera(width=640, height=360, view=1.3, fps=30.0)


def small_demo(films: Path):
    """A starter of `demo` with short films in a small picture and few rounds, for which it has no options."""
    if not films.exists():
        film_demo(films, (0.75, 1.25), 1.5, SMALL)
    code = SMALL_DEMO.format(films=str(films))
    return lambda *words: subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(Path(swim2real.__file__).parents[1])},
    )  # fmt: skip


def calibration(folder: Path, *more: object):
    return lambda out: [
        "calibrate", folder / "tracks", "--robot", folder / "pendulum.toml", "--out", out, "--horizon", 1, "--quiet",
        *more,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("method", "budget"), [("line-search", 40), ("bayesopt", 15), ("cma-es", 150), ("least-squares", 60)]
)
def test_calibrate(method, budget, pendulum_folder, tmp_path, monkeypatch):
    words = calibration(pendulum_folder, "--method", method, "--budget", budget)
    survives(f"calibrate {method}", words, tmp_path, monkeypatch, "--resume")


def test_compare_with_two_workers(pendulum_folder, tmp_path, monkeypatch):
    def words(out):
        return [
            "compare", pendulum_folder / "tracks", "--robot", pendulum_folder / "pendulum.toml", "--out", out,
            "--methods", "random", "cma-es", "--seeds", "0:2", "--budget", 20, "--horizon", 1, "--workers", 2,
            "--quiet",
        ]  # fmt: skip

    survives("compare", words, tmp_path, monkeypatch)


def test_identify(pendulum_folder, tmp_path, monkeypatch):
    for name in ("peace", "killed"):
        made = process(*calibration(pendulum_folder, "--method", "random", "--budget", 3)(tmp_path / name))
        made.communicate(timeout=300)
        assert made.returncode == 0

    def words(out):
        return ["identify", out, "--reference", pendulum_folder / "tracks", "--rounds", 2, "--quiet"]

    survives("identify", words, tmp_path, monkeypatch)


def test_track_with_two_workers(shot, clip, tmp_path, monkeypatch):
    def words(out):
        return [
            "track", shot.video, clip.video, "--to", out, "--markers", shot.points, clip.points,
            "--camera", shot.camera, "--workers", 2, "--quiet",
        ]  # fmt: skip

    survives("track", words, tmp_path, monkeypatch)


def test_train(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")

    def words(out):
        return [
            "train", "forward", "--parameters", "published", "--env-steps", 2000, "--exploration", 200, "--updates", 1,
            "--checkpoint-every", 200, "--out", out, "--quiet",
        ]  # fmt: skip

    survives("train", words, tmp_path, monkeypatch, "--resume")


def test_demo(tmp_path, monkeypatch):
    def words(out):
        return ["demo", "--out", out, "--budget", 10, "--quiet"]

    start = small_demo(tmp_path / "films")
    survives("demo", words, tmp_path, monkeypatch, "--resume", "videos", start)
