"""What the small computer in the fish must have: this package's `deploy` without its heavy libraries."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import swim2real
from swim2real.deployment import write_table

HEAVY = (
    "mujoco",
    "numpy",
    "scipy",
    "numba",
    "pydantic",
    "filelock",
    "torch",
    "cv2",
    "av",
    "plotly",
    "PIL",
    "matplotlib",
)

# a program in which the heavy libraries can't be imported, as where they aren't installed; the emulated motor,
# which the dry run starts, inherits it
SITE = f"""
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {HEAVY}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
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


def test_the_heavy_ones_really_are_missing(light):
    code, _, err = light("-c", "import numpy")
    assert code == 1
    assert "No module named 'numpy'" in err


def test_a_dry_run_needs_nothing_heavy(light, tmp_path):
    write_table(tmp_path / "c.csv", [0.0, 0.02], [0.0, 0.5])
    code, out, err = light("-m", "swim2real", "deploy", tmp_path / "c.csv", "--dry-run", "--log", tmp_path / "log.csv")
    assert (code, err) == (0, "")
    assert "Sent" in out
    assert (tmp_path / "log.csv").read_text().count("\n") > 2


@pytest.mark.parametrize("words", [["--help"], ["deploy", "--help"], ["--version"]])
def test_help_needs_nothing_heavy(light, words):
    code, out, err = light("-m", "swim2real", *words)
    assert (code, err) == (0, "")
    assert "swim2real" in out


def test_the_room_imports_the_standard_library_only(light):
    code = (
        "import sys, swim2real.deployment, swim2real.deployment.motor, swim2real.deployment.emulator, "
        "swim2real.deployment.sending\n"
        "print(*sorted({m.partition('.')[0] for m in sys.modules} - set(sys.stdlib_module_names)))"
    )
    found, out, err = light("-I", "-c", f"import sys; sys.path[:0] = {sys.path!r}\n{code}")
    assert found == 0, err
    assert set(out.split()) <= {"swim2real", "__main__", "sitecustomize", "_virtualenv", "_distutils_hack"}
