"""What the line search makes of advice that is right in direction, wrong in size: a simulated VLM on synthetic fish.

    python experiments/line_search.py --overestimate 1 1.5 2 3 --noise 0.5

Run number i calibrates against hidden fish number i of experiments/recover.py (four of its six trials) with seed i,
with the line search (3 steps) and without it (1 step), from the same first point and with the same draws of the
simulated VLM. Rates count advisor calls, the one that the end of the budget cut off too; 1, 1/2 and 1/4 are shares
among accepted steps. Errors are in mm: at first, after 16 evaluations, at the end, and AUC, the mean of the best so
far. The same command gives the same numbers.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from recover import hidden
from simulated_vlm import SimulatedVlm, VlmErrors

from swim2real.calibration import Problem
from swim2real.optimizers import BacktrackingLineSearch, Evaluation, first_point
from swim2real.robots.fish import FISH

LEFT_OUT = ("f0_94", "f1_31")
# of the paper's discussion: what is taken for one another, and what can't be seen
ALIKE = (tuple(name for name in FISH.space.names if name.startswith(("fluid_", "hinge_stiffness_"))),)
UNSEEN = ("motor_arm_length",)
COLUMNS = (
    "over", "noise", "steps", "calls", "accepted", "1", "1/2", "1/4", "ev/call", "ev/acc.",
    "first", "ev 16", "final", "std", "median", "worst", "AUC",
)  # fmt: skip


def problem_of(number):
    """A hidden fish's values, and its swims to calibrate against."""
    point, reference = hidden(number)
    fitted, _ = reference.split(LEFT_OUT)
    return FISH.space.to_values(point), Problem(FISH, fitted, "aligned", threads=1)


def one_run(problem, space, values, seed, errors, max_steps, budget):
    """Calls, sizes of accepted steps, and best loss so far after each evaluation [m]."""
    advisor = SimulatedVlm(space, values, seed, errors, ALIKE, UNSEEN)
    search = BacktrackingLineSearch(advisor, first_point(len(space), seed), max_steps=max_steps)
    calls, best = 0, []
    for _ in range(budget):
        candidate = search.ask()
        calls += "proposal" in candidate.note
        found = problem.evaluate(space.to_values(candidate.point))
        failed = found.divergence is not None
        search.tell(Evaluation(candidate, found.loss, failed))
        improved = not best or (found.loss < best[-1] and not failed)
        best.append(found.loss if improved else best[-1])
    return {"calls": calls, "accepted": [r.steps[-1].step_size for r in search.rounds if r.accepted], "best": best}


def runs_of_fish(number, cells, habit, scale, budget):
    """All cells for one hidden fish: overestimate, noise, max_steps."""
    values, problem = problem_of(number)
    space = replace(FISH.space, scale=scale)
    return [
        one_run(problem, space, values, number, VlmErrors(over, noise=noise, habit=habit), steps, budget)
        for over, noise, steps in cells
    ]


def summary(cell, runs):
    """One line of the table. Losses in mm."""
    calls, accepted = sum(run["calls"] for run in runs), [size for run in runs for size in run["accepted"]]
    best = 1e3 * np.array([run["best"] for run in runs])
    evaluations = best[:, 1:].size
    shares = [accepted.count(size) / max(len(accepted), 1) for size in (1.0, 0.5, 0.25)]
    final = best[:, -1]
    return dict(zip(COLUMNS, (
        *cell, calls / len(runs), len(accepted) / calls, *shares, evaluations / calls,
        evaluations / max(len(accepted), 1), best[:, 0].mean(), best[:, :16][:, -1].mean(), final.mean(), final.std(),
        np.median(final), final.max(), best.mean(),
    ), strict=True))  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--overestimate", type=float, nargs="+", default=[2.0])
    parser.add_argument("--noise", type=float, nargs="+", default=[VlmErrors().noise])
    parser.add_argument("--max-steps", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--habit", type=float, default=VlmErrors().habit)
    parser.add_argument("--scale", choices=("linear", "log"), default="linear", help="linear is the paper's")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--budget", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1, help="processes; results don't depend on it")
    parser.add_argument("--json", type=Path, help="also write all runs here")
    a = parser.parse_args()
    cells = list(product(a.overestimate, a.noise, a.max_steps))
    with ProcessPoolExecutor(a.workers) as team:
        jobs = [team.submit(runs_of_fish, number, cells, a.habit, a.scale, a.budget) for number in range(a.seeds)]
        by_fish = [job.result() for job in jobs]
    print(" ".join(f"{name:>8s}" for name in COLUMNS))
    rows = [summary(cell, runs) for cell, runs in zip(cells, zip(*by_fish, strict=True), strict=True)]
    formats = ("g", "g", "d", ".1f", ".0%", ".0%", ".0%", ".0%", ".2f", *[".1f"] * 8)
    for row in rows:
        print(" ".join(f"{value:{form}}".rjust(8) for value, form in zip(row.values(), formats, strict=True)))
    if a.json:
        runs = [
            {"fish": number, "cell": cell, **run}
            for number, done in enumerate(by_fish)
            for cell, run in zip(cells, done, strict=True)
        ]
        a.json.write_text(json.dumps({"scale": a.scale, "habit": a.habit, "rows": rows, "runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()
