"""Simulates swims of fish with random parameters, the data behind `swim2real.robots.fish.response`.

    python experiments/fish_response/measure.py swims.npz 2000

Writes after every hundred sets and goes on where it stopped. Knows no real swim.
"""

import sys
from pathlib import Path

import numpy as np

from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation

FREQUENCIES = np.array([0.375, 0.75, 1.125, 1.5, 1.69])  # Hz
START_SPEEDS = np.array([0.03, 0.08, 0.12, 0.18, 0.2])  # m/s, a first guess
CYCLES = 6


def one(simulator, point):
    swims = [Swim(f"{f} Hz", Actuation(f, 0.0, v), CYCLES / f) for f, v in zip(FREQUENCIES, START_SPEEDS, strict=True)]
    trials = simulator.simulate(FISH.space.to_values(point), swims)
    speeds, beats = [], []
    for trial, frequency in zip(trials, FREQUENCIES, strict=True):
        times, body = trial.track.times, trial.track.body
        turn = np.exp(-2j * np.pi * frequency * times[:-1])[:, None]
        speeds.append(np.nan if trial.divergence else trial.track.speed)
        beats.append(2 * (body[:-1, :, 1] * turn).mean(axis=0) if not trial.divergence else np.full(9, np.nan + 0j))
    return speeds, beats


def main(target, count):
    path, rows = Path(target), []
    if path.exists():
        with np.load(path) as stored:
            rows = list(zip(stored["points"], stored["speeds"], stored["beats"], strict=True))
    simulator = Simulator(FISH)
    points = np.random.default_rng(12345).random((int(count), len(FISH.space)))
    for i in range(len(rows), len(points)):
        rows.append((points[i], *one(simulator, points[i])))
        if (i + 1) % 100 == 0 or i + 1 == len(points):
            parts = (np.array(part) for part in zip(*rows, strict=True))
            np.savez(path, frequencies=FREQUENCIES, **dict(zip(("points", "speeds", "beats"), parts, strict=True)))
            print(f"{i + 1} of {count}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
