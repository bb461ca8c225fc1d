"""`evaluate`."""

from __future__ import annotations

import json

from swim2real.calibration import Problem, sensitivities
from swim2real.cli import tables
from swim2real.cli.arguments import Evaluate
from swim2real.cli.calibrate import horizon, threads
from swim2real.cli.subject import robot_for, values_of
from swim2real.objective import evidence
from swim2real.trials import load_reference


def evaluate(a: Evaluate) -> int:
    """Compares parameters with real trials."""
    robot = robot_for(a.parameters)
    reference = load_reference(a.reference)
    problem = Problem(robot, reference, a.protocol, horizon(a.horizon), start=a.start, threads=threads(a.threads))
    values = values_of(a.parameters, problem)
    comparison = problem.evaluate(values)
    found = [s.as_dict() for s in sensitivities(problem, robot.space, values)] if a.sensitivity else None
    if a.json:
        content = evidence(comparison)
        print(json.dumps({**content, "engine": problem.engine.as_dict(), "sensitivity": found}, indent=2))
        return 0
    content = evidence(comparison)
    tables.figures(content, f"{a.parameters} on {a.reference}, protocol {problem.protocol.name}, {problem.engine.name}")
    tables.marker_errors(content, robot.marker_names)
    if found is not None:
        tables.sensitivities(found)
    return 0
