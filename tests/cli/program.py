"""Calls the program, in this process or as its own."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import swim2real
from pool_work import alive
from swim2real.cli import main


class Program:
    """Calls the program in this process."""

    def __init__(self, capsys):
        self._capsys = capsys
        self.code, self.out, self.err = None, "", ""

    def __call__(self, *words: object) -> "Program":
        self._capsys.readouterr()
        with pytest.raises(SystemExit) as leaving:
            main([str(word) for word in words])
        self.code = leaving.value.code
        self.out, self.err = self._capsys.readouterr()
        return self

    def done(self) -> "Program":
        assert self.code == 0, self.err
        return self

    @property
    def json(self):
        return json.loads(self.out)

    @property
    def text(self) -> str:
        """What was printed, without the boxes and line breaks of a terminal's width."""
        return plain(self.out)

    def sentence(self, code: int) -> str:
        """The one line that a refusal must be."""
        assert self.code == code, self.err
        assert self.out == ""
        lines = self.err.splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("swim2real: ")
        return lines[0].removeprefix("swim2real: ")


def pendulum_words(folder: Path) -> list[str]:
    """The words that calibrate the pendulum."""
    return ["calibrate", str(folder / "tracks"), "--robot", str(folder / "pendulum.toml")]


def plain(text: str) -> str:
    return re.sub(r"[\s│╭╮╰╯─]+", " ", text)


def process(*words: object, **options) -> subprocess.Popen:
    """Starts the program as its own process; Ctrl-C works there even when it is switched off here."""
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); import swim2real.__main__"
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        env={**os.environ, "PYTHONPATH": str(Path(swim2real.__file__).parents[1]), "PYTHONIOENCODING": "utf-8"},
        **options,
    )  # fmt: skip


def until(condition: Callable[[], object], started: subprocess.Popen) -> None:
    """Waits until something is there that a process makes."""
    deadline = time.monotonic() + 120
    while not condition():
        assert started.poll() is None, started.communicate()[1]
        assert time.monotonic() < deadline, "it doesn't get on"
        time.sleep(0.01)


def interrupted(words: list[object], begun: Callable[[], object], workers: int = 0) -> list[str]:
    """Lines of errors of a command that gets Ctrl-C when it has begun; of so many workers at least none works on."""
    started = process(*words, start_new_session=True)
    try:
        until(begun, started)
        threads = Path(f"/proc/{started.pid}/task").glob("*/children")
        children = [int(child) for path in threads for child in path.read_text().split()]
        os.killpg(started.pid, signal.SIGINT)
        out, err = started.communicate(timeout=60)
    finally:
        started.kill()
        started.wait()
    assert (started.returncode, out) == (1, ""), err
    assert "Traceback" not in err
    assert len(children) >= workers or not Path("/proc/self/task").exists()
    deadline = time.monotonic() + 30  # a busy machine takes a moment to bury them
    while any(alive(pid) for pid in children):
        assert time.monotonic() < deadline, "processes work on"
        time.sleep(0.05)
    return err.splitlines()


CTRL_C = pytest.mark.skipif(sys.platform == "win32", reason="no Ctrl-C to send")
