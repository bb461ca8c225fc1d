"""What an import costs, and what it may not touch."""

import socket
import subprocess
import sys

import pytest

EXTRAS = (
    "plotly", "torch", "pydantic_ai", "openai", "anthropic", "google", "genai_prices", "cma", "skopt", "sklearn",
    "distributed", "dask", "gymnasium", "stable_baselines3", "dynamixel_sdk", "imageio", "tabulate",
)  # fmt: skip
CORE = ("mujoco", "scipy", "numpy", "numba", "jinja2", "matplotlib", "PIL", "av", "cv2", "pooch", "requests", "pandas")
HEAVY = (*CORE, *EXTRAS)


def loaded_by(statement: str) -> set[str]:
    """The heavy libraries that a statement brings into a fresh interpreter."""
    code = f"import sys\n{statement}\nprint(*[name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.parametrize("statement", ["import swim2real", "import swim2real.cli"])
def test_the_package_and_its_command_line_bring_nothing_heavy(statement):
    assert not loaded_by(statement)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("modules", "library"),
    [
        ("swim2real.trials, swim2real.objective, swim2real.optimizers", "mujoco"),
        ("markertrack.video, markertrack.tracking.markers, markertrack.tracking.tracker", "mujoco"),
        # the package; its trackers are modules of it
        ("swim2real.report, swim2real.rl, swim2real.viewing, swim2real.rendering, markertrack.quality", "cv2"),
    ],
)
def test_rooms_without_a_camera_or_an_engine_need_none(modules, library):
    assert library not in loaded_by(f"import {modules}")


@pytest.mark.slow
@pytest.mark.parametrize("modules", [
    "swim2real.pipeline", "swim2real.demo",
    "swim2real.comparison, swim2real.report, swim2real.advisor",
    "swim2real.cli.subject, swim2real.cli.progress",
    "markertrack.video, markertrack.overlay",
    "swim2real.cli.robot_check, swim2real.cli.tables",
])  # fmt: skip
def test_without_extras_it_can_be_imported(modules):
    assert not loaded_by(f"import {modules}") & set(EXTRAS)


HELP = """
import contextlib, io
from swim2real.cli.main import COMMANDS, main
for group in COMMANDS.values():
    for name in group:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
            main([name, "--help"])
"""


def test_no_help_brings_anything_heavy():
    assert not loaded_by(HELP)


@pytest.mark.parametrize("call", ["connect", "connect_ex"])
def test_no_test_reaches_another_machine(call, only_this_machine):
    with socket.socket() as one, pytest.raises(OSError, match=r"a test must not reach '203\.0\.113\.1'"):
        getattr(one, call)(("203.0.113.1", 80))
    with pytest.raises(OSError, match=r"a test must not reach 'example\.org'"):
        socket.getaddrinfo("example.org", 80)
    assert only_this_machine == ["203.0.113.1", "example.org"]  # which would fail the test afterwards
    only_this_machine.clear()
