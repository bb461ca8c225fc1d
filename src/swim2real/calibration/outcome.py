"""What a run found, kept with it so that a report needs nothing else: figures, and the trials themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from swim2real.calibration.problem import Problem
from swim2real.calibration.run_folder import OUTCOME, RunFolder
from swim2real.calibration.sensitivity import Sensitivity
from swim2real.objective import evidence
from swim2real.objective.evidence import rounded
from swim2real.parameters import Values


def conclude(
    folder: RunFolder, problem: Problem, held_out: Problem | None, values: Values,
    sensitivity: Sequence[Sensitivity] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Simulates the best parameters once more, on held-out trials too, and writes figures and trials.

    Returns:
        The outcome as written: `fit` and `held_out` (figures with per-marker evidence), of swims `from_rest` (how each
        fitted trial's beat swims from rest), `trials` (what was found in each), `sensitivity`, `engine`.
    """
    fit = problem.evaluate(values)
    unseen = None if held_out is None else held_out.evaluate(values)
    outcome: dict[str, Any] = {
        "fit": evidence(fit),
        "held_out": None if unseen is None else evidence(unseen),
        **problem.tried(values),
        "trials": {**problem.examined(), **({} if held_out is None else held_out.examined())},
        "sensitivity": None if sensitivity is None else rounded([s.as_dict() for s in sensitivity]),
        "engine": problem.engine.as_dict(),
        "marker_names": list(problem.robot.marker_names),
    }
    problem.save(folder, fit, unseen)
    folder.write_json(folder.path / OUTCOME, outcome)
    return outcome
