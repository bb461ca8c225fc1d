"""How far the last digits of the tracks decide where a calibration ends: the same one, with 1e-12 m of noise added.

    python experiments/last_digits.py tracks --robot fish --count 10

Prints the lowest loss of each calibration, and their median, least and most.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.pipeline import calibrate
from swim2real.robots import load_robot
from swim2real.settings import CalibrationSettings
from swim2real.trials import TrialSet, load_reference


def shaken(reference, size, number):
    """The reference with noise on every position [m]."""
    rng = np.random.default_rng(number)
    tracks = [
        MarkerTrack(t.track.times, t.track.positions + rng.normal(0, size, t.track.positions.shape), t.track.confidence)
        for t in reference
    ]
    trials = [replace(trial, track=track) for trial, track in zip(reference, tracks, strict=True)]
    return TrialSet(tuple(trials), reference.marker_names)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=Path)
    parser.add_argument("--robot", default="fish")
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--noise", type=float, default=1e-12, help="standard deviation of what is added [m]")
    parser.add_argument("--budget", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("runs/last-digits"))
    a = parser.parse_args()
    robot, reference, losses = load_robot(a.robot), load_reference(a.reference), []
    for number in range(a.count):
        out = a.out / f"{a.robot}-{a.seed}-{number}"
        settings = CalibrationSettings(seed=a.seed, budget=a.budget)
        made = calibrate(shaken(reference, a.noise, number), robot, settings, out, resume=out.exists())
        losses.append(1e3 * made.fit.loss)
        print(f"{number}: {losses[-1]:.2f} mm", flush=True)
    print(f"median {np.median(losses):.2f} mm, from {min(losses):.2f} to {max(losses):.2f} mm")


if __name__ == "__main__":
    main()
