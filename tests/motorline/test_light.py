"""What the small computer in the fish must have: this package's `deploy` without the libraries of the simulator."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import swim2real
from motorline import FISH, CommandTable, write_table

# a program in which only these can be imported beside the standard library, as where nothing else is installed;
# the emulated motor, which the dry run starts, inherits it
SITE = """
import sys

ALLOWED = {*sys.stdlib_module_names, "swim2real", "dynamixel_sdk", "serial", "rich", "tyro",
           "markdown_it", "mdurl", "pygments", "docstring_parser", "typeguard", "typing_extensions", "shtab",
           "sitecustomize", "usercustomize", "_virtualenv", "_distutils_hack", "colorama"}

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in ALLOWED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""

PROGRAM = """
import sys
import emulator, motorline.motors, motorline.sending
print(*sorted({m.partition(".")[0] for m in sys.modules} - set(sys.stdlib_module_names)))
try:
    import numpy
except ModuleNotFoundError:
    print("no numpy")
from swim2real.cli import main
for words in (["--version"], ["--help"], ["deploy", "--help"]):
    try:
        main(words)
    except SystemExit as leaving:
        print("left with", leaving.code)
"""


@pytest.fixture
def light(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(SITE)
    path = os.pathsep.join([str(tmp_path), str(Path(swim2real.__file__).parents[1])])

    def run(*words):
        done = subprocess.run(
            [sys.executable, *map(str, words)],
            capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        return done.returncode, done.stdout, done.stderr

    return run


def test_a_dry_run_needs_the_command_line_and_the_makers_library_only(light, tmp_path):
    write_table(tmp_path / "c.csv", CommandTable.of({FISH: [0.0, 0.5]}))
    code, out, err = light("-m", "swim2real", "deploy", tmp_path / "c.csv", "--dry-run", "--log", tmp_path / "log.csv")
    assert (code, err) == (0, "")
    assert "Sent" in out
    assert (tmp_path / "log.csv").read_text().count("\n") > 2


def test_the_room_imports_the_standard_library_only_and_help_needs_nothing_heavy(light):
    code, out, err = light("-c", PROGRAM)
    assert (code, err) == (0, "")
    modules, numpy, *rest = out.splitlines()
    assert set(modules.split()) <= {"swim2real", "__main__", "sitecustomize", "_virtualenv", "_distutils_hack"}
    assert numpy == "no numpy"
    assert rest.count("left with 0") == 3
