"""A server that is killed loses nothing: what was clicked, tracked and searched is in the folder."""

import http.client
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import pytest
from live_page import FILM, Served

from swim2real import load_reference, open_run
from swim2real.demo.example import FILMS
from swim2real.pipeline import calibrate
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings
from swim2real.ui.project import Project

KINDS = ("points", "corrections")
FIT = {"reference": "reference", "robot": "fish", "values": FISH.space.published}


@contextmanager
def killed(folder: Path) -> Iterator[Served]:
    """A server of its own process, which is killed at the end."""
    command = [sys.executable, "-m", "swim2real", "ui", str(folder), "--no-browser"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            served = Served(Project(folder), line[line.index("http://") :].strip())
            served.kill = process.kill
            yield served
        finally:
            process.send_signal(signal.SIGKILL)


def reaches(served: Served, done: int) -> None:
    """Waits until the job is so far."""
    until = time.monotonic() + 250
    while (job := served.call("job"))["running"] and job["done"] < done:
        assert time.monotonic() < until, job
        time.sleep(0.05)
    assert job["running"], job


def ended(served: Served) -> str:
    """What came of the job, once it has ended."""
    until = time.monotonic() + 250
    while (job := served.call("job"))["running"]:
        assert time.monotonic() < until, job
        time.sleep(0.2)
    return job["fault"] or job["said"]


@pytest.mark.slow
def test_a_killed_server_loses_nothing(tmp_path):
    folder = tmp_path / "pool"
    folder.mkdir()
    for name in (FILM, "camera.json"):
        shutil.copy(FILMS / name, folder / name)
    points = json.loads((FILMS / "f0_50.points.json").read_text())["markers"]
    with killed(folder) as server:
        server.call("mark", {"film": FILM, "robot": "fish", "kind": "points", "frame": 0, "put": points})
    assert json.loads((folder / "f0_50.points.json").read_text())["markers"] == points

    with killed(folder) as server:
        server.call("track", {"film": FILM, "robot": "fish"})
        reaches(server, 30)
    with killed(folder) as server:
        (film,) = server.call("project")["films"]
        assert (film["points"], film["trial"]) == (True, None)
        server.call("track", {"film": FILM, "robot": "fish"})
        assert "241 frames" in ended(server)
        server.call("search", {**FIT})
        reaches(server, 3)

    before = open_run(folder / "fit-1").losses
    assert len(before) >= 3
    with killed(folder) as server:
        (run,) = server.call("project")["runs"]
        assert (run["path"], run["usable"], run["verdict"]) == ("fit-1", True, None)
        about = server.call("fit", {"reference": "reference", "robot": "fish", "run": "fit-1", "begin": "fit-1"})
        assert about["values"] == open_run(folder / "fit-1").values
    settings = CalibrationSettings(budget=len(before) + 2)
    calibrate(load_reference(folder / "reference"), FISH, settings, folder / "fit-1", resume=True)
    after = open_run(folder / "fit-1")
    assert after.losses[: len(before)] == before
    assert after.outcome is not None


@pytest.mark.slow
def test_kills_while_it_saves_leave_all_that_it_has_answered(tmp_path):
    shutil.copy(FILMS / FILM, tmp_path / FILM)
    draw, numbers, answered = random.Random(0), count(1), dict[tuple[str, int, str], int]()
    for _ in range(8):
        with killed(tmp_path) as server, suppress(OSError, http.client.HTTPException):
            for number in numbers:
                kind, frame, name = draw.choice(KINDS), 0, f"M{draw.randrange(9)}"
                frame = 0 if kind == "points" else draw.randrange(50)
                put = {name: [float(number), 1.0]}
                server.call("mark", {"film": FILM, "robot": "fish", "kind": kind, "frame": frame, "put": put})
                answered[kind, frame, name] = number
                if number % 20 == 10:
                    threading.Timer(draw.uniform(0, 0.1), server.kill).start()
        for kind in KINDS:
            content = json.loads((tmp_path / f"f0_50.{kind}.json").read_text())
            frames = {one["frame"]: one["markers"] for one in content.get("frames", [content])}
            for (of, frame, name), last in answered.items():
                assert of != kind or last <= frames[frame][name][0] <= number
    assert number > 80
