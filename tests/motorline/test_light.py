"""A motor's computer: Python and the maker's library, without the libraries of the simulator."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import swim2real
from emulator import Emulator
from motorline import FISH, CommandTable, write_table

# a program in which only these can be imported beside the standard library, as where nothing else is installed
SITE = """
import os, sys

ALLOWED = {*sys.stdlib_module_names, *os.environ["INSTALLED"].split(), "motorline", "swimbase",
           "sitecustomize", "usercustomize", "_virtualenv", "_distutils_hack"}

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in ALLOWED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""
SDK = "dynamixel_sdk serial"
COMMAND_LINE = "swim2real lazy_loader packaging rich tyro markdown_it mdurl pygments docstring_parser typeguard \
typing_extensions shtab colorama"

PROGRAM = """
import sys
from motorline import Motors, read_motors, read_table, send, write_table
import motorline.__main__
print(*sorted({m.partition(".")[0] for m in sys.modules} - set(sys.stdlib_module_names)))
try:
    from motorline import Bus
except Exception as error:
    print(error)
try:
    import numpy
except ModuleNotFoundError:
    print("no numpy")
"""
HELP = """
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

    def run(installed, *words):
        done = subprocess.run(
            [sys.executable, *map(str, words)],
            capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": path, "INSTALLED": installed},
        )  # fmt: skip
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture
def table(tmp_path):
    write_table(tmp_path / "c.csv", CommandTable.of({FISH: [0.0, 0.5]}))
    return tmp_path / "c.csv"


def test_it_imports_the_standard_library_only(light):
    code, out, err = light("", "-c", PROGRAM)
    assert (code, err) == (0, "")
    modules, bus, numpy = out.splitlines()
    mine = {"motorline", "swimbase"}
    assert mine <= set(modules.split()) <= mine | {"__main__", "sitecustomize", "_virtualenv", "_distutils_hack"}
    assert bus == "the motor needs dynamixel-sdk; install it with: pip install dynamixel-sdk"
    assert numpy == "no numpy"


def test_a_dry_run_needs_the_standard_library_only(light, table):
    code, out, err = light("", "-m", "motorline", table, "--dry-run", "--ramp", 10)
    assert code == 0
    rows = ("0.0,1,Goal Velocity (104),0", "0.02,1,Goal Velocity (104),21", "0.04,1,Goal Velocity (104),14")
    assert out.splitlines()[:4] == ["time_s,id,register,value", *rows]
    assert "Nothing was sent: it would be 5 commands, 0.10 s, 5 values" in err


def test_sending_needs_the_makers_library_only(light, table, tmp_path):
    with Emulator() as emulator:
        words = ("-m", "motorline", table, "--port", emulator.port)
        code, out, err = light(SDK, *words, "--log", tmp_path / "log.csv", "--max-speed", "1.5")
        assert (code, err) == (0, "")
        assert light("", *words)[::2] == (
            1,
            "motorline: the motor needs dynamixel-sdk; install it with: pip install dynamixel-sdk\n",
        )
    assert "fastest 0.50 rad/s (limit 1.50)" in out
    assert "Sent" in out
    assert (tmp_path / "log.csv").read_text().count("\n") > 2


def test_its_command_line_refuses_and_explains(light, table):
    assert light("", "-m", "motorline", table)[::2] == (
        2,
        "motorline: give either --port (as /dev/ttyUSB0) or --dry-run\n",
    )
    code, out, _ = light("", "-m", "motorline", "--help")
    assert code == 0
    words = " ".join(out.split())
    assert "commands Table of commands." in words
    assert "--max-speed MAX_SPEED Refuse faster commands of the single motor [rad/s]; by default 7.29" in words
    assert "--clip Limit commands instead of refusing them." in words


def test_deploy_and_the_help_of_the_other_command_line_need_nothing_heavy(light, table):
    assert light(COMMAND_LINE, "-m", "swim2real", "deploy", table, "--dry-run")[0] == 0
    code, out, err = light(COMMAND_LINE, "-c", HELP)
    assert (code, err) == (0, "")
    assert out.count("left with 0") == 3
