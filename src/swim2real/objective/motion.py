"""Motions and residuals in few numbers: the beat of each marker, amplitudes, and means in windows of time."""

from __future__ import annotations

import numpy as np

from swimbase.arrays import Array

WINDOWS = 8
_FEWEST_FRAMES = 8  # in which a marker must be seen, so that a sine can be fitted to its motion


def beat(times: Array, positions: Array, weights: Array, frequency: float) -> dict[str, Array]:
    """The fundamental of each marker's sideways motion at a frequency.

    Args:
        times: Time stamps [s]. Shape (T,).
        positions: Positions in the body frame [m]. Shape (T, M, 2).
        weights: Weights, 0 where a marker doesn't count. Shape (T, M).
        frequency: Frequency of the beat [Hz].

    Returns:
        `amplitude` [m], `phase` relative to the motor [rad] and `mean` [m], each of shape (M,), NaN for a marker that
        counts in too few frames or whose positions aren't known.
    """
    angles = 2 * np.pi * frequency * times
    basis = np.column_stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    counts, sideways = weights > 0, positions[:, :, 1]
    known = (counts.sum(axis=0) > _FEWEST_FRAMES) & (np.isfinite(sideways) | ~counts).all(axis=0)
    coefficients = np.full((3, positions.shape[1]), np.nan)
    together = known & counts.all(axis=0)  # markers that count in every frame are fitted at once
    coefficients[:, together] = np.linalg.lstsq(basis, sideways[:, together], rcond=None)[0]
    for m in np.flatnonzero(known & ~together):
        good = counts[:, m]
        coefficients[:, m] = np.linalg.lstsq(basis[good], sideways[good, m], rcond=None)[0]
    mean, cosine, sine = coefficients
    return {"amplitude": np.hypot(cosine, sine), "phase": np.arctan2(-sine, cosine), "mean": mean}


def windows(times: Array, count: int = WINDOWS) -> Array:
    """Edges of equal windows of time [s]. Shape (count + 1,)."""
    return np.linspace(times[0], times[-1], count + 1)


def windowed_means(times: Array, values: Array, edges: Array) -> Array:
    """Mean of the finite values in each window, NaN where there are none.

    Args:
        times: Time stamps [s]. Shape (T,).
        values: Values at these times. Shape (T, ...).
        edges: Edges of the windows [s]. Shape (W + 1,).

    Returns:
        Means. Shape (W, ...).
    """
    window = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    return np.stack([finite_mean(values[window == w]) for w in range(len(edges) - 1)])


def finite_mean(values: Array) -> Array:
    """Mean of the finite values over the first axis, NaN where there are none. Shape (T, ...) to (...)."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def main_amplitudes(positions: Array, weights: Array) -> Array:
    """Standard deviation of each marker along the axis on which it moves most [m].

    NaN for a marker that never counts. Shapes (T, M, 2) and (T, M) to (M,).
    """
    known = (weights > 0)[:, :, None] & np.isfinite(positions)
    deviations = np.where(known, positions - finite_mean(np.where(known, positions, np.nan)), 0.0)
    count = known.all(axis=2).sum(axis=0)
    covariance = np.einsum("tmi,tmj->mij", deviations, deviations) / np.maximum(count, 1)[:, None, None]
    return np.where(count > 0, np.sqrt(np.linalg.eigvalsh(covariance)[:, -1].clip(0.0)), np.nan)


def extent(positions: Array, weights: Array) -> float:
    """Root mean square distance of markers from their mean places [m]. Shapes (T, M, 2) and (T, M)."""
    known = (weights > 0) & np.isfinite(positions).all(axis=2)
    apart = np.where(known[:, :, None], positions - finite_mean(np.where(known[:, :, None], positions, np.nan)), 0.0)
    return float(np.linalg.norm(apart)) / np.sqrt(max(int(known.sum()), 1))
