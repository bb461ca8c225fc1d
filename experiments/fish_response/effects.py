"""Measures what each parameter of the fish does to a swim from rest: at given fits, and all over the box.

    python experiments/fish_response/effects.py runs/effects.json --fits runs/0 runs/1 runs/2 --sets 40

Each parameter is changed by a tenth of its range, a twentieth to either side, all else the same, and the fish swims at
0.4, 0.75, 1.15 and 1.6 Hz. Told are the changes of its speed when it beats slowly, at a middle rate (the two in
between) and fast, of the last marker's amplitude and of the head's yaw, in percent: at each fit, and the median over
random sets that swim forward, with the share of them that have its sign. The words of `fish.toml` hold to them.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from fit import motions
from measure import FREQUENCIES, LEAST_STRIDE, SAMPLES, STRIDES, cycle, way_in_a_beat

from swim2real.parameters import read_parameters
from swim2real.robots import load_robot
from swim2real.simulation import Simulator

STEP = 0.1  # of a parameter's range
EFFECTS = ("slow", "middle", "fast", "tail", "yaw")


def swims(space, simulators, points):
    """Strides (N, F), amplitudes of the last marker and of the yaw (N, F); NaN where a swim diverged."""
    cycles = np.array([[cycle(simulators, space.to_values(p), f) for f in FREQUENCIES] for p in points], dtype=float)
    motion = motions(cycles)
    return way_in_a_beat(cycles), np.abs(motion[..., -3]), np.abs(motion[..., -1])


def effects(space, simulators, point):
    """Percent by which each figure grows over a tenth of each parameter's range. Shape (d, 5), NaN where unknown."""
    steps = [np.clip(point + way * STEP / 2 * np.eye(len(point)), 0, 1) for way in (-1, 1)]
    here = [np.repeat(figure, len(point), axis=0) for figure in swims(space, simulators, point[None])]
    (before, *low), (after, *high) = ((points, *swims(space, simulators, points)) for points in steps)
    # where one side turns around, the point itself stands for it
    for side, points in ((low, before), (high, after)):
        turned = ~(side[0] > LEAST_STRIDE).all(axis=1)
        points[turned] = point
        for figure, own in zip(side, here, strict=True):
            figure[turned] = own[turned]
    widths = (after - before).sum(axis=1)
    stride, tail, yaw = (_log_ratio(*pair) for pair in zip(low, high, strict=True))
    found = np.stack([stride[:, 0], stride[:, 1:-1].mean(axis=1), stride[:, -1], tail.mean(1), yaw.mean(1)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(widths[:, None] > 0, 100 * np.expm1(found * (STEP / widths)[:, None]), np.nan)


def _log_ratio(before, after):
    """Logarithm of the ratio, NaN where one of them isn't above 0."""
    known = (before > 0) & (after > 0)
    return np.where(known, np.log(np.where(known, after, 1) / np.where(known, before, 1)), np.nan)


def forward_points(robot, count):
    """Random points that the learned response expects to swim forward, as fast as fish."""
    rng, response, found = np.random.default_rng(15), robot.swims.response, []
    while len(found) < count:
        points = rng.random((2000, len(robot.space)))
        speeds, forward = response.speeds(points, FREQUENCIES)
        strides = (speeds / FREQUENCIES).mean(axis=1)
        found += list(points[(forward > 0.5).all(axis=1) & (strides > STRIDES[0]) & (strides < STRIDES[1])])
    return found[:count]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--fits", type=Path, nargs="*", default=[])
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--robot", default="fish")
    a = parser.parse_args()
    robot = load_robot(a.robot)
    space = replace(robot.space, scale="log")
    simulators = {f: Simulator(robot, 1, sample_interval=1 / f / SAMPLES) for f in FREQUENCIES}
    fits = [space.to_cube(read_parameters(path, robot.name, robot.space).values) for path in a.fits]
    at_fits = np.array([effects(space, simulators, point) for point in fits]).reshape(-1, len(space), 5)
    over_box = np.array([effects(space, simulators, point) for point in forward_points(robot, a.sets)])
    median = np.nanmedian(over_box, axis=0)
    alike = np.nanmean(np.where(np.isnan(over_box), np.nan, np.sign(over_box) == np.sign(median)), axis=0)
    content = {}
    heads = [f"fit {i + 1}" for i in range(len(fits))]
    print(f"| {', '.join(EFFECTS)} | {' | '.join(heads)} | box | sign |")
    for i, name in enumerate(space.names):
        rows = [*at_fits[:, i], median[i]]
        content[name] = {
            "fits": [dict(zip(EFFECTS, np.round(row, 1), strict=True)) for row in at_fits[:, i]],
            "box": dict(zip(EFFECTS, np.round(median[i], 1), strict=True)),
            "alike": dict(zip(EFFECTS, np.round(alike[i], 2), strict=True)),
        }
        cells = [" ".join(f"{x:+.1f}" for x in row) for row in rows]
        print(f"| {name} | {' | '.join(cells)} | {' '.join(f'{x:.2f}' for x in alike[i])} |", flush=True)
    a.out.parent.mkdir(parents=True, exist_ok=True)
    a.out.write_text(json.dumps(content, indent=1, allow_nan=True) + "\n")


if __name__ == "__main__":
    main()
