"""Recover the known: calibrates against noise-free swims of hidden parameters.

    python experiments/recover.py --hidden 5 --out runs/recover

Hidden parameters are drawn uniformly from the logarithmic box; those whose fish hardly swims (under 20 mm/s at the
fastest beat) or swims tail first are drawn again, because nothing can be learned from a fish that stands still.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from swim2real.demo import SyntheticCamera, synthetic_reference
from swim2real.pipeline import calibrate
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings

FREQUENCIES = (0.375, 0.75, 0.94, 1.125, 1.31, 1.5)  # Hz
SECONDS = 5.0
LEAST_SPEED = 0.02  # m/s


def hidden(number, frequencies=FREQUENCIES, seconds=SECONDS, camera=SyntheticCamera()):  # noqa: B008
    """A hidden fish that swims: its point of the unit cube, and its swims as a camera sees them."""
    rng = np.random.default_rng([7, number])
    while True:
        point = rng.random(len(FISH.space))
        values = FISH.space.to_values(point)
        reference = synthetic_reference(FISH, values, frequencies, seconds, camera, number)
        speeds = [trial.track.speed for trial in reference]
        if speeds[-1] > LEAST_SPEED and min(speeds) > 0:
            return point, reference


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hidden", type=int, default=5)
    parser.add_argument("--budget", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("runs/recover"))
    a = parser.parse_args()
    for number in range(a.hidden):
        point, reference = hidden(number)
        folder = a.out / f"hidden_{number}"
        settings = CalibrationSettings(budget=a.budget, seed=number, protocol="aligned")
        outcome = calibrate(
            reference, FISH, settings, folder, source="synthetic", resume=folder.exists(), sensitivity=True
        )
        best = json.loads((folder / "best.json").read_text())["parameters"]
        off = np.abs(FISH.space.to_cube(best) - point)
        fit = outcome.fit
        errors = (fit.aligned_marker_error, fit.shape_error, fit.velocity_error)
        aligned, shape, velocity = (f"{1e3 * error:.1f}" for error in errors if error is not None)
        speeds = " ".join(f"{1e3 * trial.velocity_real:.0f}" for trial in fit.trials.values() if trial.velocity_real)
        print(
            f"hidden {number}: aligned {aligned} mm, shape {shape} mm, velocity {velocity} mm/s; real speeds {speeds}"
        )
        for effect, distance in zip(outcome.sensitivity or (), off, strict=True):
            off_by = f"off by {100 * distance:3.0f} % of its range"
            step = max(abs(effect.lower or 0.0), abs(effect.upper or 0.0))
            print(f"    {effect.name:24s} {off_by}, a step changes the loss by {1e3 * step:.2f} mm", flush=True)


if __name__ == "__main__":
    main()
