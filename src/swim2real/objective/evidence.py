"""The numbers that a person, a VLM or the physics advisor judges a candidate by: compact and ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.objective.comparison import Comparison, TrialComparison

Array = NDArray[np.float64]

_DIGITS = 9


def evidence(comparison: Comparison) -> dict[str, Any]:
    """All figures of a candidate and, per trial, the beat of every marker.

    The beat is the fundamental of the sideways motion in the body frame: amplitudes [m], phases [rad] relative to the
    motor, and the mean sideways position before registration [m]; for real and simulated swims alike. Numbers are
    rounded to nine digits, so that a record read back gives exactly the same.
    """
    figures = comparison.figures()
    for trial in comparison.trials:
        figures["trials"][trial.name].update(
            {
                "marker_errors": trial.marker_errors("marker"),
                "aligned_marker_errors": trial.marker_errors("aligned"),
                "shape_marker_errors": trial.marker_errors("shape"),
                "beat_real": beat(trial, trial.real, trial.beat_frequency or trial.frequency),
                "beat_simulated": beat(trial, trial.simulated, trial.frequency),
            }
        )
    return rounded(figures)


def beat(trial: TrialComparison, positions: Array, frequency: float) -> dict[str, Array]:
    """Amplitude, phase and mean of each marker's sideways motion at a frequency [Hz]. Each of shape (M,)."""
    angles = 2 * np.pi * frequency * trial.times
    basis = np.column_stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    count = positions.shape[1]
    out = np.full((3, count), np.nan)
    for m in range(count):
        good = trial.weights[:, m] > 0
        if np.count_nonzero(good) > 8:
            out[:, m] = np.linalg.lstsq(basis[good], positions[good, m, 1], rcond=None)[0]
    mean, cosine, sine = out
    return {"amplitude": np.hypot(cosine, sine), "phase": np.arctan2(-sine, cosine), "mean": mean}


def rounded(value: Any) -> Any:
    """Plain lists and numbers for JSON, None for NaN."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, np.ndarray | list | tuple):
        return [rounded(inner) for inner in value]  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.{_DIGITS}g}") if np.isfinite(value) else None
    return value
