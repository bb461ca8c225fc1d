"""Does the camera see higher markers nearer? What six tracks from above say of it, without a simulator.

    python experiments/perspective.py ../shared/data/fishsim-markers

Over a beat a swimming fish is a rigid body on average, so the mean positions of its markers keep their distances as it
crosses the picture, unless the camera sees some of them nearer than others: a marker that is higher by a share z of the
camera's distance seems to be as much farther from the point below the camera. Prints how well one set of shares, and a
tilt of the camera, explains what the distances do in all trials, and in each half of them. Each trial has a shape of
its own, since markers were placed by hand; markers that were lost are left out. Then, in one scale and without
perspective, how far each trial's distances are from their means over all trials: if scales differed, all would agree.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from swim2real.calibration.protocols import examine_swims
from swim2real.robots import load_robot
from swim2real.trials import load_reference

BELOW = 1920.0, -1080.0  # px, the middle of a picture in 4K, y up
SEEN = {"f1_50": (0, 1, 2, 3, 8), "f1_75": (0, 1, 2, 3, 4, 8), "f2_00": (0, 1, 2, 8)}  # the others: all
STEP = 0.25  # beats between means
HEIGHTS, TILT = slice(0, 3), slice(3, 5)  # unknowns: shares of M0 and M1, of M2, of M8; change of the scale [1/m]


def beat_means(swim):
    """Mean positions over a beat, from the point below the camera [m]. Shape (N, M, 2)."""
    track, beat = swim.trial.track, 1 / swim.beat.frequency
    times = track.times - track.times[0]
    begins = np.arange(0.0, times[-1] - beat, STEP * beat)
    rows = [track.positions[(times >= begin) & (times < begin + beat)].mean(axis=0) for begin in begins]
    markers = list(SEEN.get(swim.trial.name, range(9)))
    return np.array(rows)[:, markers] - swim.trial.meters_per_pixel * np.array(BELOW), markers


def seen(points, unknowns, markers):
    """Where the camera sees markers at these points [m]."""
    shares = np.zeros(9)
    shares[[0, 1, 2, 8]] = unknowns[HEIGHTS][[0, 0, 1, 2]]
    return points * (1 + shares[markers])[:, None] * (1 - points @ unknowns[TILT])[..., None]


def off(unknowns, trials, free):
    """Differences of the beat means from rigid shapes, each with a pose at every time [m]."""
    shared, rest, found = np.where(free, unknowns[:5], 0.0), unknowns[5:], []
    for means, markers in trials:
        shape, rest = rest[: 2 * len(markers)].reshape(-1, 2), rest[2 * len(markers) :]
        poses, rest = rest[: 3 * len(means)].reshape(-1, 3), rest[3 * len(means) :]
        turns = np.exp(1j * poses[:, 2])
        moved = (shape @ [1, 1j])[None] * turns[:, None] + (poses[:, :2] @ [1, 1j])[:, None]
        found.append(seen(np.stack([moved.real, moved.imag], axis=2), shared, markers) - means)
    return found


def fitted(trials, free):
    """The unknowns that all trials share, and each trial's rms of what is left [m]."""
    first = [np.zeros(5)]
    for means, _ in trials:
        heads = means[:, 0] - means[:, 1]
        angles = np.arctan2(heads[:, 1], heads[:, 0])
        middle = len(means) // 2
        shape = (means[middle] - means[middle, :2].mean(axis=0)) @ [1, 1j] * np.exp(-1j * angles[middle])
        first += [np.column_stack([shape.real, shape.imag]).ravel()]
        first += [np.column_stack([means[:, :2].mean(axis=1), angles]).ravel()]
    first = np.concatenate(first)

    def residual(unknowns):
        # a shape and its poses may turn and shift together: a little holds them where they began
        return np.concatenate([*(1e3 * one.ravel() for one in off(unknowns, trials, free)), 1e-3 * (unknowns - first)])

    found = least_squares(residual, first, x_scale="jac", max_nfev=60).x
    return found[:5], [np.sqrt(2 * np.mean(one**2)) for one in off(found, trials, free)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=Path)
    swims = examine_swims(load_reference(parser.parse_args().reference), load_robot("fish"))
    trials = [beat_means(swim) for swim in sorted(swims, key=lambda swim: swim.beat.frequency)]
    half = len(trials) // 2
    heights, tilt = np.arange(5) < HEIGHTS.stop, np.arange(5) >= TILT.start
    print(f"{'':28s}rms mm of each trial; heights of M0 and M1, M2, M8 over M3 to M7 [% of the camera's]; tilt [%/m]")
    for name, some, free in (
        ("nothing", trials, heights & tilt), ("tilt", trials, tilt), ("heights", trials, heights),
        ("heights and tilt", trials, heights | tilt), ("the same, slower half", trials[:half], heights | tilt),
        ("the same, faster half", trials[half:], heights | tilt),
    ):  # fmt: skip
        shared, left = fitted(some, free)
        print(f"{name:28s}{np.round(1e3 * np.array(left), 1)}  {np.round(100 * shared, 1)}", flush=True)
    pairs = ((0, 1), (1, 2), (2, 8), (3, 7))
    plain = [one.trial.seen_from_afar().track.positions for one in swims]
    lengths = [[np.median(np.linalg.norm(x[:, a] - x[:, b], axis=1)) for a, b in pairs] for x in plain]
    off = 100 * (np.array(lengths) / np.mean(lengths, axis=0) - 1)
    print("\ndistances M0-M1, M1-M2, M2-M8, M3-M7, of each trial from the mean over trials [%]")
    for swim, row in zip(swims, off, strict=True):
        print(f"{swim.trial.name:28s}{np.round(row, 1)}")


if __name__ == "__main__":
    main()
