"""Speed against recoil: how near the sets of `measure.py` come to real swims in both, as a chart.

    python experiments/fish_response/trade_off.py tracks runs/response runs/extended runs/trade-off.png

Every dot is a parameter set from rest: its mean difference from the real speed, and from the real yaw of the head, at
the measured frequencies. The lines connect the sets that no other one beats in both.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from fit import motions, swims_of
from measure import FREQUENCIES, way_in_a_beat

from swim2real.calibration import Problem
from swim2real.robots.fish import FISH
from swim2real.trials import load_reference


def real_motion(reference):
    """Speed [m/s] and yaw [rad] of the real swims at the measured frequencies."""
    targets = Problem(FISH, load_reference(reference), threads=1).evaluate(FISH.space.published).figures()["trials"]
    trials = sorted(targets.values(), key=lambda trial: trial["frequency"])
    logs = np.log([trial["frequency"] for trial in trials])
    return [np.interp(np.log(FREQUENCIES), logs, [t[name] for t in trials]) for name in ("velocity_real", "yaw_real")]


def differences(folder, speed, yaw):
    """Mean differences of every set that goes forward: speed [mm/s] and yaw [deg]. Shape (N, 2)."""
    _, cycles = swims_of(folder)
    found = way_in_a_beat(cycles) * FREQUENCIES
    forward = (found > 0).all(axis=1)
    slower = 1e3 * np.abs(found - speed).mean(axis=1)
    wider = np.rad2deg(np.abs(np.abs(motions(cycles)[..., -1]) - yaw).mean(axis=1))
    return np.column_stack([slower, wider])[forward]


def front(points):
    """The points that no other one beats in both, by the first. Shape (K, 2)."""
    ordered = points[np.argsort(points[:, 0])]
    return ordered[ordered[:, 1] <= np.minimum.accumulate(ordered[:, 1])]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=Path)
    parser.add_argument("plain", type=Path)
    parser.add_argument("extended", type=Path)
    parser.add_argument("out", type=Path)
    a = parser.parse_args()
    speed, yaw = real_motion(a.reference)
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for folder, name, color in ((a.plain, "the 16", "C0"), (a.extended, "fish-extended", "C1")):
        points = differences(folder, speed, yaw)
        best = front(points)
        axes.plot(*points.T, ".", color=color, ms=2, alpha=0.4)
        axes.step(*best.T, where="post", color=color, label=f"{name}, {len(points)} sets that swim forward")
        print(name, np.round(best, 1).tolist())
    axes.set(xlim=(0, 60), ylim=(0, 12), xlabel="difference in speed [mm/s]", ylabel="difference in yaw [deg]")
    axes.legend(fontsize=8, loc="upper right")
    a.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(a.out, dpi=120)


if __name__ == "__main__":
    main()
