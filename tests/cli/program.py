"""Calls the program, in this process or as its own."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import swim2real
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
