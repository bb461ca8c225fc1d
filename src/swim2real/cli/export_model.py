"""`export-model`."""

from __future__ import annotations

import mujoco

from swim2real.cli import tables
from swim2real.cli.robot_arguments import ExportModel
from swim2real.cli.subject import PUBLISHED, robot_for
from swim2real.errors import ArgumentError, RobotError
from swim2real.parameters import read_parameters
from swim2real.robots.compiled import largest_difference


def export_model(a: ExportModel) -> int:
    """Writes the model of calibrated parameters, reads it back and compares."""
    robot = robot_for(a.parameters)
    known = str(a.parameters) == PUBLISHED
    values = robot.space.published if known else read_parameters(a.parameters, robot.name, robot.space).values
    spec = robot.build(values)
    if robot.source is not None:  # assets are found from anywhere
        for folder in ("meshdir", "texturedir"):
            setattr(spec, folder, str((robot.source.parent / spec.modelfiledir / getattr(spec, folder)).resolve()))
    model = spec.compile()
    try:
        a.out.write_text(spec.to_xml(), encoding="utf-8")
    except OSError as error:
        raise ArgumentError(f"--out '{a.out}' can't be written: {error.strerror or error}") from error
    try:
        name, gap = largest_difference(model, mujoco.MjSpec.from_file(str(a.out)).compile())
    except ValueError as error:
        raise RobotError(f"MuJoCo can't read its own '{a.out}' back: {error}") from error
    exact = "all numbers read back the same" if not gap else f"numbers read back within {gap:.1g}, relative ({name})"
    tables.console.print(f"{a.out}: robot '{robot.name}', {exact}", soft_wrap=True)
    return 0
