"""`evaluate`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from swim2real.calibration import Problem, examine, sensitivities
from swim2real.cli import tables
from swim2real.cli.arguments import Evaluate
from swim2real.cli.calibrate import horizon, threads
from swim2real.objective import evidence
from swim2real.parameters import read_parameters
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator
from swim2real.trials import load_reference

PUBLISHED = "published"


def evaluate(a: Evaluate) -> int:
    """Compares parameters with real trials."""
    simulator = Simulator(FISH, threads(a.threads))
    values = values_of(a.parameters, simulator)
    reference = load_reference(a.reference)
    problem = Problem(FISH, examine(reference, FISH), simulator, a.protocol, horizon(a.horizon))
    comparison = problem.evaluate(values)
    found = [s.as_dict() for s in sensitivities(problem, FISH.space, values)] if a.sensitivity else None
    if a.json:
        content = evidence(comparison)
        print(json.dumps({**content, "engine": simulator.engine.as_dict(), "sensitivity": found}, indent=2))
        return 0
    content = evidence(comparison)
    tables.figures(content, f"{a.parameters} on {a.reference}, protocol {a.protocol}, {simulator.engine.name}")
    tables.marker_errors(content, FISH.marker_names)
    if found is not None:
        tables.sensitivities(found)
    return 0


def values_of(path: Path, simulator: Simulator) -> dict[str, float]:
    """Parameters of a run folder or file, or the published ones; says so when they were found with other physics."""
    if str(path) == PUBLISHED:
        return FISH.space.published
    file = read_parameters(path, FISH.name, FISH.space)
    note = None
    if file.physics is not None:
        note = simulator.engine.difference(file.physics)
    elif file.engine is not None and file.engine != simulator.engine.name:
        note = f"made with {file.engine}; this is {simulator.engine.name}, whose fluid forces may differ"
    if note:
        print(f"swim2real: warning: {file.path} was {note}", file=sys.stderr)
    return file.values
