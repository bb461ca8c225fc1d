from pathlib import Path

import pytest
from program import Program, pendulum_words

from recorded import PENDULUM_HIDDEN, PENDULUM_SPACE, PENDULUM_XML, pendulum_reference
from swim2real.cli import main
from swim2real.trials import save_reference

PENDULUM = """
format = 1
name = "pendulum"
description = "A damped double pendulum with a motor at its shoulder."
model = "pendulum.xml"
camera = "side"
markers = ["pivot", "middle", "end"]
[recordings]
start = "fitted"
[recordings.controls]
torque = "table"
[recordings.sensors]
"gyro[1]" = {unit = "rad/s", meters_per_unit = 0.001}
[[parameters]]
name = "shoulder_damping"
unit = "N·m·s/rad"
lower = 0.0005
upper = 0.02
scale = "log"
meaning = "Damping of the shoulder."
targets = 'joint "shoulder" damping'
[[parameters]]
name = "elbow_damping"
unit = "N·m·s/rad"
lower = 0.0002
upper = 0.01
scale = "log"
meaning = "Damping of the elbow."
targets = 'joint "elbow" damping'
"""


@pytest.fixture(autouse=True)
def no_terminal(monkeypatch):
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def program(capsys) -> Program:
    return Program(capsys)


@pytest.fixture(scope="session")
def pendulum_folder(tmp_path_factory) -> Path:
    """With a robot file and a reference. Don't write into it."""
    folder = tmp_path_factory.mktemp("pendulum")
    values = {**PENDULUM_SPACE.published, "lower_mass": PENDULUM_HIDDEN["lower_mass"]}
    (folder / "pendulum.xml").write_text(PENDULUM_XML.format(**values))
    (folder / "pendulum.toml").write_text(PENDULUM, encoding="utf-8")
    save_reference(pendulum_reference(1e-3), folder / "tracks")
    return folder


@pytest.fixture(scope="session")
def finished(pendulum_folder, tmp_path_factory) -> Path:
    """A finished run of four evaluations. Copy it before changing it."""
    run = tmp_path_factory.mktemp("finished") / "run"
    words = ["--out", str(run), "--budget", "4", "--method", "line-search", "--sensitivity", "--quiet"]
    with pytest.raises(SystemExit) as leaving:
        main([*pendulum_words(pendulum_folder), *words])
    assert leaving.value.code == 0
    return run
