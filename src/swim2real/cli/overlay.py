"""`overlay`."""

from __future__ import annotations

from swim2real.calibration import Problem
from swim2real.cli import tables
from swim2real.cli.arguments import Overlay
from swim2real.cli.calibrate import horizon, threads
from swim2real.cli.subject import robot_for, values_of
from swim2real.pipeline.overlays import write_overlays
from swim2real.trials import load_reference


def overlay(a: Overlay) -> int:
    """Writes films and pictures of simulated over real trials."""
    robot = robot_for(a.parameters)
    reference = load_reference(a.reference)
    problem = Problem(robot, reference, a.protocol, horizon(a.horizon), threads=threads(a.threads))
    values = values_of(a.parameters, problem)
    write_overlays(
        problem.evaluate(values), robot, a.out, a.fps, a.width,
        lambda path: tables.console.print(str(path), soft_wrap=True),
    )  # fmt: skip
    return 0
