"""Findings of a run, kept with it so that a report needs nothing else: figures, and the trials themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from swim2real.calibration.convergence import noise_of
from swim2real.calibration.file_models import Outcome
from swim2real.calibration.loop import Ending
from swim2real.calibration.problem import Problem
from swim2real.calibration.run_folder import OUTCOME, RunFolder
from swim2real.calibration.saved_trials import save_trials
from swim2real.calibration.sensitivity import Sensitivity, Slopes
from swim2real.objective import evidence
from swim2real.objective.comparison import rounded
from swim2real.parameters import Values


def conclude(
    folder: RunFolder, problem: Problem, held_out: Problem | None, values: Values,
    sensitivity: Sequence[Sensitivity] | None = None, ending: Ending = "budget", slopes: Slopes | None = None,
    late: Sequence[str] = (),
) -> Outcome:  # fmt: skip
    """Simulates the best parameters once more, on held-out trials too, and writes figures and trials.

    Args:
        folder: Folder of the run.
        problem: The fitted trials.
        held_out: The held-out trials; None without any.
        values: The best parameters.
        sensitivity: Effect of each parameter on the loss, where it was measured.
        ending: What ended the search.
        slopes: How the residual changes about the best parameters, where the search knows it.
        late: A sentence for each stream that seems late.

    Raises:
        RunError: The folder can't be written.
    """
    fit = problem.evaluate(values)
    on_held_out = None if held_out is None else held_out.evaluate(values)
    swims = problem.check_fit(values)
    content: dict[str, object] = {
        "fit": evidence(fit),
        "held_out": None if on_held_out is None else evidence(on_held_out),
        **({"from_rest": rounded({name: asdict(swim) for name, swim in swims.items()})} if swims else {}),
        "trials": {**problem.examinations(), **({} if held_out is None else held_out.examinations())},
        "sensitivity": None if sensitivity is None else rounded([asdict(s) for s in sensitivity]),
        "engine": problem.engine.as_dict(),
        "marker_names": list(problem.robot.marker_names),
        "evaluations": len(folder.record()),
        "ending": ending,
        "noise": rounded(noise_of(problem.trials, problem.robot.trials.sensors)),
        "ranges": {} if slopes is None else {name: list(ends) for name, ends in slopes.ranges().items()},
        "late": list(late),
    }
    save_trials(folder, fit, on_held_out)
    folder.write_json(OUTCOME, content)
    return Outcome.model_validate(content)
