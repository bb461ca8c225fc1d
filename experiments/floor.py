"""The floor: how well the parameters can fit at all, whatever it takes to find them.

    python experiments/floor.py --reference tracks --start runs/words/best.json --budget 2000 --out runs/floor
    python experiments/floor.py --reference tracks --start runs/words/best.json --robot fish-extended --out runs/floor

CMA-ES on the logarithmic cube, from a calibration's end. The robot may have more parameters than the start: they begin
a little off their published values. Every evaluation counts.
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
from swim2real.trials import load_reference

FIGURES = ("motion_error", "aligned_marker_error", "velocity_error", "yaw_error", "sway_error")
OFF = 0.35  # of its range, where a parameter begins that the start doesn't have


def beginning(space, start):
    """Point of the cube for values of some parameters; the others lie off their published values."""
    known = {p.name: float(np.clip(start.get(p.name, p.published), p.lower, p.upper)) for p in space}
    point, added = space.to_cube(known), np.array([p.name not in start for p in space])
    return np.where(added, np.where(point < 0.5, point + OFF, point - OFF), point)


def descend(problem, start, budget, sigma, seed):
    """Best loss and point from a start."""
    space, rng = problem.robot.space, np.random.default_rng(seed)
    options = {
        "bounds": [0, 1], "seed": np.nan, "randn": lambda *shape: rng.standard_normal(shape), "verbose": -9,
        "tolfun": 1e-7, "popsize": 14,
    }  # fmt: skip
    search, best, spent = cma.CMAEvolutionStrategy(start, sigma, options), (np.inf, start), 0
    while not search.stop() and spent + search.popsize <= budget:
        points = [np.array(start) if spent == i == 0 else point for i, point in enumerate(search.ask())]
        found = problem.evaluate_many([space.to_values(point) for point in points])
        losses = [comparison.loss for comparison in found]
        search.tell(points, losses)
        spent += len(points)
        best = min([best, *zip(losses, points, strict=True)], key=lambda pair: pair[0])
        print(f"  {spent:5d}: {1e3 * best[0]:.2f} mm, sigma {search.sigma:.3f}", flush=True)
    return best


def table_row(name, figures):
    """A line of Markdown: errors in mm, mm/s, degrees and mm."""
    values = [figures[figure] * (np.rad2deg(1) if figure == "yaw_error" else 1e3) for figure in FIGURES]
    return f"| {name} | " + " | ".join(f"{value:.1f}" for value in values) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", type=Path, required=True)
    parser.add_argument("--start", type=Path, required=True, help="parameters file")
    parser.add_argument("--robot", default="fish")
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--sigma", type=float, default=0.03)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/floor"))
    a = parser.parse_args()
    robot = load_robot(a.robot)
    robot = replace(robot, space=replace(robot.space, scale="log"))
    problem = Problem(robot, load_reference(a.reference))
    before = load_robot(json.loads(a.start.read_text())["robot"])
    start = beginning(robot.space, read_parameters(a.start, before.name, before.space).values)
    loss, point = descend(problem, start, a.budget, a.sigma, a.seed)
    values = robot.space.to_values(point)
    a.out.mkdir(parents=True, exist_ok=True)
    engine = problem.simulator.engine
    write_parameters(a.out / f"{robot.name}.json", robot.name, values, engine.name, engine.as_dict(), loss=loss)
    print(f"{1e3 * loss:.2f} mm\n" + table_row(robot.name, problem.evaluate(values).figures()))


if __name__ == "__main__":
    main()
