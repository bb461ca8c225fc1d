"""What the physics advisor sees of a swim: forward speed and the shape of the beat.

Speeds are compared on a scale that is logarithmic for swimmers and linear around standstill, so that a fish that hardly
moves, or moves backward, is nothing special. The beat is taken relative to the last marker's phase, because the
phase of a trial is free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

_LEAST_TRIALS = 4
_OUTLIER = 0.12  # on the speed scale, from a line over the logarithm of frequency
SLOW = 0.01  # m/s, where the speed scale turns from linear to logarithmic


def to_scale(speed: Array | float) -> Array:
    """Speed [m/s] on the advisor's scale."""
    return np.arcsinh(np.asarray(speed, dtype=float) / SLOW)


def from_scale(value: Array) -> Array:
    """Speed [m/s] of a value on the advisor's scale."""
    return SLOW * np.sinh(value)


@dataclass(frozen=True)
class Swims:
    """One side, real or simulated, of all trials.

    Attributes:
        speed: Forward speed [m/s]. Shape (F,).
        beat: Real and imaginary parts of each marker's sideways fundamental, turned so that the last marker's phase is
            zero [m]; NaN for a marker that never counts. Shape (F, 2 M).
    """

    speed: Array
    beat: Array

    @property
    def features(self) -> Array:
        """Scaled speed, then the beat. Shape (F, 1 + 2 M)."""
        return np.concatenate([to_scale(self.speed)[:, None], self.beat], axis=1)


def swims(evidence: Mapping[str, Any], side: str) -> Swims:
    """Reads one side, `real` or `simulated`, from the evidence of an evaluation."""
    trials = evidence["trials"].values()
    speed = np.array([trial[f"velocity_{side}"] for trial in trials], dtype=float)
    beats: list[Array] = []
    for trial in trials:
        content = trial[f"beat_{side}"]
        amplitude, phase = (np.array(content[key], dtype=float) for key in ("amplitude", "phase"))
        turned: NDArray[np.complex128] = amplitude * np.exp(
            1j * (phase - (phase[-1] if np.isfinite(phase[-1]) else 0.0))
        )
        beats.append(np.concatenate([turned.real, turned.imag]))
    return Swims(speed, np.array(beats))


def without_outliers(scaled: Array, frequencies: Array) -> Array:
    """Scaled speeds whose outliers are replaced by what the other frequencies suggest. Shape (F,).

    Close to a bound of stability a simulated swimmer may turn or stagger at one frequency and not at the next, for
    the slightest change of a parameter. Such a speed tells nothing of thrust and drag.
    """
    if len(scaled) < _LEAST_TRIALS:
        return scaled
    logs = np.log(frequencies)
    basis = np.column_stack([np.ones_like(logs), logs - logs.mean()])
    line = least_squares(lambda p: basis @ p - scaled, [np.median(scaled), 1.0], loss="soft_l1", f_scale=0.05).x
    rest = scaled - basis @ line
    limit = max(_OUTLIER, 4 * float(np.median(np.abs(rest))))
    return np.where(np.abs(rest) > limit, basis @ line, scaled)


def frequencies(evidence: Mapping[str, Any]) -> Array:
    """Frequency of each trial [Hz]. Shape (F,)."""
    return np.array([trial["frequency"] for trial in evidence["trials"].values()], dtype=float)
