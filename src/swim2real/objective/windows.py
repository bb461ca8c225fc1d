"""Motions and residuals in few numbers: means in windows of time, amplitudes along the main axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOWS = 8


def windows(times: Array, count: int = WINDOWS) -> Array:
    """When equal windows of time begin, and the last one ends [s]. Shape (count + 1,)."""
    return np.linspace(times[0], times[-1], count + 1)


def windowed(times: Array, values: Array, edges: Array) -> Array:
    """Mean of the finite values in each window, NaN where there are none.

    Args:
        times: [s]. Shape (T,).
        values: Shape (T, ...).
        edges: Of the windows [s]. Shape (W + 1,).

    Returns:
        Shape (W, ...).
    """
    window = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    return np.stack([mean(values[window == w]) for w in range(len(edges) - 1)])


def mean(values: Array) -> Array:
    """Of the finite values over the first axis, NaN where there are none. Shape (T, ...) to (...)."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def main_amplitudes(positions: Array, weights: Array) -> Array:
    """Standard deviation of each marker along the axis that it moves along most [m].

    NaN for a marker that never counts. Shapes (T, M, 2) and (T, M) to (M,).
    """
    known = (weights > 0)[:, :, None] & np.isfinite(positions)
    moved = np.where(known, positions - mean(np.where(known, positions, np.nan)), 0.0)
    count = known.all(axis=2).sum(axis=0)
    covariance = np.einsum("tmi,tmj->mij", moved, moved) / np.maximum(count, 1)[:, None, None]
    return np.where(count > 0, np.sqrt(np.linalg.eigvalsh(covariance)[:, -1].clip(0.0)), np.nan)
