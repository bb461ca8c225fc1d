"""Fits the law of `swim2real.robots.fish.response` to the swims that `measure.py` simulated.

python experiments/fish_response/fit.py swims.npz src/swim2real/robots/fish/response.json
"""

import json
import sys

import numpy as np
from scipy.optimize import least_squares

from swim2real.robots.fish import FISH
from swim2real.robots.fish.response import FishResponse

SLOW = 0.01  # m/s, below which speeds are compared on a linear scale
RIDGE_LAW, RIDGE_BEAT = 0.1, 1.0
# of the logarithm of speed: what frequencies of one fish err alike, and apart
COMMON_ERROR, OWN_ERROR = 0.5, 0.3
START = np.concatenate(
    [[-0.4, 0.4, 0.2, 1.4, 0.1, -2.0], np.log([150, 1, 0.1, 0.1, 0.1, 0.1]), [np.log(0.05)], np.zeros(11)]
)


def fit_law(points, values, speeds, frequencies):
    """One law for all frequencies: how steeply speed rises with frequency hardly follows from the parameters alone."""
    seen = np.arcsinh(speeds / SLOW)
    count = len(frequencies)

    def residual(p):
        error = np.arcsinh(FishResponse(*split(p), None, None).speeds(points, values, frequencies) / SLOW) - seen
        common = error.mean(axis=1, keepdims=True)
        level = common * np.sqrt(count) / np.hypot(OWN_ERROR, np.sqrt(count) * COMMON_ERROR)
        return np.concatenate([level.ravel(), ((error - common) / OWN_ERROR).ravel(), RIDGE_LAW * (p - START)])

    return least_squares(residual, START, loss="soft_l1", max_nfev=400).x


def split(p):
    return p[:6], p[6:12], p[12:24]


def main(source, target):
    with np.load(source) as stored:
        points, speeds, beats, frequencies = (stored[k] for k in ("points", "speeds", "beats", "frequencies"))
    kept = np.isfinite(speeds).all(axis=1)  # a diverged swim tells nothing
    points, speeds, beats = points[kept], speeds[kept], beats[kept]
    values = FISH.space.to_array(points)
    turned = beats * np.exp(-1j * np.angle(beats[:, :, -1:]))
    parts = np.concatenate([turned.real, turned.imag], axis=2)
    basis = np.column_stack([np.ones(len(points)), 2 * points - 1])
    ridge = np.diag([1e-6, *[RIDGE_BEAT] * points.shape[1]])
    beat = [np.linalg.solve(basis.T @ basis + ridge, basis.T @ parts[:, j]) for j in range(len(frequencies))]
    response = FishResponse(*split(fit_law(points, values, speeds, frequencies)), frequencies, np.array(beat))
    scaled = np.arcsinh(speeds / SLOW)
    error = np.arcsinh(response.speeds(points, values, frequencies) / SLOW) - scaled
    print(f"{len(points)} parameter sets")
    for j, frequency in enumerate(frequencies):
        r2 = 1 - error[:, j].var() / scaled[:, j].var()
        right = np.mean(np.sign(error[:, j] + scaled[:, j]) == np.sign(scaled[:, j]))
        middle = np.median(np.abs(error[:, j]))
        print(f"{frequency:.3f} Hz: R² {r2:.2f}, direction right in {100 * right:.0f} %, median error {middle:.2f}")
    content = {
        name: np.round(getattr(response, name), 5).tolist()
        for name in ("thrust", "drag", "amplitude", "frequencies", "beat")
    }
    with open(target, "w", encoding="utf-8") as file:
        json.dump({"sets": len(points), **content}, file)
        file.write("\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
