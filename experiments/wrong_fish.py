"""The lowest aligned error isn't the best fish: fits over a real swim, where the body frame hides them and in its path.

    python experiments/wrong_fish.py tracks docs/images/wrong-fish.png lowest.json runs/floor/fish-extended.json
    python experiments/wrong_fish.py tracks docs/images/rolling-fish.png simulators/extended.json \
        simulators/rolling.json --trial f0_50

One column a parameters file. Above, the body frame, which the aligned error compares; below, the frame of the path,
moving along with the progress: midlines over one beat, real in red, simulated in blue.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from swim2real.calibration import Problem
from swim2real.parameters import read_parameters
from swim2real.robots import load_robot
from swim2real.trials import load_reference

MIDLINES, BEGIN = 8, 1.0  # of a beat; s


def panels(path, reference, name):
    """Real and simulated midlines over a beat in the body frame and in the path's [m], and the figures of the fit."""
    robot = load_robot(json.loads(path.read_text())["robot"])
    comparison = Problem(robot, reference, threads=1).evaluate(read_parameters(path, robot.name, robot.space).values)
    trial = next(one for one in comparison.trials if one.name == name)
    chosen = np.searchsorted(trial.times, BEGIN + np.arange(MIDLINES) / MIDLINES / trial.frequency)
    drawn = []
    for head, body in ((trial.head.real, trial.real), (trial.head.simulated, trial.simulated + trial.registration)):
        along = np.column_stack([head.progress, np.zeros(len(body))])[:, None]
        drawn.append((body[chosen], (head.to_path(body) + along)[chosen]))
    (body_real, path_real), (body_simulated, path_simulated) = drawn
    return ((body_real, body_simulated), (path_real, path_simulated)), comparison.figures()["trials"][name]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("parameters", type=Path, nargs="+")
    parser.add_argument("--trial", default="f1_00")
    a = parser.parse_args()
    reference, count = load_reference(a.reference), len(a.parameters)
    figure, axes = plt.subplots(2, count, figsize=(4.5 * count, 4), sharex=True, sharey=True, layout="constrained")
    for column, path in zip(axes.T, a.parameters, strict=True):
        frames, figures = panels(path, reference, a.trial)
        yaw = [f"{np.rad2deg(figures[f'yaw_{side}']):.0f}" for side in ("simulated", "real")]
        sway = [f"{1e3 * figures[f'sway_{side}']:.0f}" for side in ("simulated", "real")]
        aligned, motion = (1e3 * figures[name] for name in ("aligned_marker_error", "motion_error"))
        title = (
            f"{a.trial}: aligned {aligned:.0f} mm, whole motion {motion:.0f} mm\n"
            f"yaw {yaw[0]}°, real {yaw[1]}°; sway {sway[0]} mm, real {sway[1]} mm"
        )
        column[0].set_title(title, fontsize=9)
        for panel, sides, name in zip(column, frames, ("body frame", "frame of the path"), strict=True):
            for midlines, color in zip(sides, ("C3", "C0"), strict=True):
                for midline in midlines:
                    known = np.isfinite(midline).all(axis=1)
                    panel.plot(*(1e3 * midline[known]).T, "-", color=color, lw=0.9, alpha=0.6)
            panel.set_aspect("equal")
            panel.set_ylabel(f"{name} [mm]")
    a.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(a.out, dpi=100)


if __name__ == "__main__":
    main()
