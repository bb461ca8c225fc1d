"""The floor: how well the parameters can fit at all, whatever it takes to find them.

    python experiments/floor.py --reference tracks --comparison runs/table --budget 2000 --out runs/floor

Goes on from where the line search of a comparison has ended: CMA-ES (sigma 0.1 on the logarithmic cube) from each
seed's best point with half of the budget, then from the best of these with the rest. Every evaluation counts.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import cma
import numpy as np

from swim2real.calibration import Problem
from swim2real.parameters import read_parameters, write_parameters
from swim2real.robots import load_robot
from swim2real.simulation import Simulator
from swim2real.trials import load_reference

FIGURES = ("aligned_marker_error", "shape_error", "velocity_error", "marker_error")


def descend(problem, space, start, sigma, budget, seed):
    """Best point, its loss and the evaluations spent, from a start."""
    rng = np.random.default_rng(seed)
    options = {
        "bounds": [0, 1], "seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape), "verbose": -9,
        "maxfevals": budget, "tolfun": 1e-7, "popsize": 12,
    }  # fmt: skip
    search = cma.CMAEvolutionStrategy(np.clip(start, 0.01, 0.99), sigma, options)
    best, spent = (np.inf, np.asarray(start)), 0
    while not search.stop() and spent + search.popsize <= budget:
        points = search.ask()
        found = problem.evaluate_many([space.to_values(point) for point in points])
        losses = [comparison.loss for comparison in found]
        search.tell(points, losses)
        spent += len(points)
        best = min([best, *zip(losses, points, strict=True)], key=lambda pair: pair[0])
        print(f"  {spent:5d}: {1e3 * best[0]:.2f} mm, sigma {search.sigma:.3f}", flush=True)
    return best[1], best[0], spent


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reference", type=Path, required=True)
    parser.add_argument("--comparison", type=Path, required=True)
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--parameters", default="fish")
    parser.add_argument("--out", type=Path, default=Path("runs/floor"))
    a = parser.parse_args()
    robot = load_robot(a.parameters)
    space = replace(robot.space, scale="log")
    simulator = Simulator(robot)
    problem = Problem(robot, load_reference(a.reference), simulator=simulator)
    runs = sorted((a.comparison / "runs" / "aligned" / "line-search").glob("seed-*"))
    starts = []
    for run in runs:
        name = json.loads((run / "best.json").read_text())["robot"]
        values = read_parameters(run, name, load_robot(name).space).values
        starts.append(space.to_cube({**space.published, **values}))
    each, ends, spent = a.budget // 2 // len(starts), [], 0
    for number, (run, start) in enumerate(zip(runs, starts, strict=True)):
        print(f"{run.name}:")
        point, loss, used = descend(problem, space, start, 0.1, each, number)
        ends.append((loss, number, point))
        spent += used
    loss, number, point = min(ends)
    print(f"on from {runs[number].name}:")
    further, lower, used = descend(problem, space, point, 0.05, a.budget - spent, len(starts))
    spent += used
    if lower < loss:
        loss, point = lower, further
    values = space.to_values(point)
    figures = problem.evaluate(values).figures()
    a.out.mkdir(parents=True, exist_ok=True)
    engine = simulator.engine
    write_parameters(a.out / "best.json", robot.name, values, engine.name, engine.as_dict(), loss=loss)
    result = {
        "evaluations": spent, "ends_mm": {runs[i].name: round(1e3 * end, 2) for end, i, _ in ends},
        **{name: round(1e3 * figures[name], 2) for name in FIGURES},
        "trials": {
            name: {key: round(1e3 * trial[key], 2) for key in FIGURES[:3]} for name, trial in figures["trials"].items()
        },
    }  # fmt: skip
    (a.out / "floor.json").write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
