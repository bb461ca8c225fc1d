"""Simulates swims from rest of fish with random parameters, the data behind `swim2real.robots.fish.response`.

    python experiments/fish_response/measure.py runs/response --sets 3000
    python experiments/fish_response/measure.py runs/extended --sets 900 --robot fish-extended --near runs/response

The first thousand sets are spread over the whole box. The others lie where forward swims were found: a forward set is
moved by a part of the difference of two others, as differential evolution does, so that the sets crowd where a real
fish may be. With `--near` all sets lie where those of an earlier folder swam forward, and the parameters that it didn't
have are spread over their ranges. Each set swims at four frequencies, and of each swim one steady cycle is kept. Writes
a file every fifty sets and goes on where it stopped; the same command gives the same numbers. Knows no real swim.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from swim2real.robots import load_robot
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation

FREQUENCIES = np.array([0.4, 0.75, 1.15, 1.6])  # Hz
SAMPLES = 32  # of a cycle; its end is kept as well
BLOCK = 50  # sets of a file
SPREAD = 1000  # sets over the whole box, before others are drawn near forward ones
LEAST_STRIDE = 0.01  # m in a beat, of a set that goes forward
STRIDES = (0.04, 0.35)  # m, of the sets that most others are drawn near to


def way_in_a_beat(cycles):
    """Forward way [m]; every swim begins with its head toward -x. Shape (N, F, S, M, 2) to (N, F)."""
    head = (cycles[:, :, :, 0] + cycles[:, :, :, 1]) / 2
    return -(head[:, :, -1] - head[:, :, 0])[:, :, 0]


def forward_sets(points, cycles):
    """Sets that go forward at all frequencies, and those of them that are as fast as fish and faster with frequency."""
    stride = way_in_a_beat(cycles)
    good = np.isfinite(stride).all(axis=1) & (stride > LEAST_STRIDE).all(axis=1)
    slope = np.polyfit(np.log(FREQUENCIES), np.log(np.where(good[:, None], stride, 1.0)).T, 1)[0]
    usual = (stride.mean(axis=1) > STRIDES[0]) & (stride.mean(axis=1) < STRIDES[1])
    return points[good], points[good & usual & (slope > 0)]


def points_of_block(number, folder, near, dimensions):
    rng = np.random.default_rng([2026, number])
    if near is None and number * BLOCK < SPREAD:
        return rng.random((BLOCK, dimensions))
    paths = sorted(near.glob("block_????.npz")) if near else [block_path(folder, i) for i in range(number)]
    before = [np.load(path) for path in paths]
    good, best = forward_sets(*(np.concatenate([block[key] for block in before]) for key in ("points", "cycles")))
    chosen = []
    for i in range(BLOCK):
        crowd = best if len(best) > 8 and i % 4 else good
        start = crowd[rng.integers(len(crowd))]
        one, other = good[rng.integers(len(good), size=2)]
        moved = start + rng.uniform(0.2, 0.7) * (one - other) + rng.normal(0, 0.05, len(start))
        chosen.append(np.append(np.clip(moved, 0, 1), rng.random(dimensions - len(start))))
    return np.array(chosen)


def block_path(folder, number):
    return folder / f"block_{number:04d}.npz"


def cycle(simulators, values, frequency):
    """Positions over one steady cycle from rest, NaN when the swim diverged. Shape (SAMPLES + 1, M, 2)."""
    swim = Swim("", Actuation(frequency, 0.0, 0.0), 1 / frequency)
    (trial,) = simulators[frequency].simulate(values, [swim])
    positions = trial.track.positions[: SAMPLES + 1].astype(np.float32)
    return np.full((SAMPLES + 1, *positions.shape[1:]), np.nan, np.float32) if trial.divergence else positions


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sets", type=int, default=3000)
    parser.add_argument("--robot", default="fish")
    parser.add_argument("--near", type=Path, help="folder of a robot with fewer parameters, these being the first")
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    robot = load_robot(a.robot)
    space = replace(robot.space, scale="log")
    simulators = {f: Simulator(robot, 1, sample_interval=1 / f / SAMPLES) for f in FREQUENCIES}
    for number in range(a.sets // BLOCK):
        path = block_path(a.folder, number)
        if path.exists():
            continue
        points = points_of_block(number, a.folder, a.near, len(space))
        cycles = [[cycle(simulators, space.to_values(point), f) for f in FREQUENCIES] for point in points]
        part = path.with_suffix(".part.npz")
        np.savez(part, points=points, cycles=np.array(cycles), frequencies=FREQUENCIES)
        part.replace(path)
        print(f"{(number + 1) * BLOCK} of {a.sets}", flush=True)


if __name__ == "__main__":
    main()
