"""Phase and registration: what a simulator's parameters can't explain and must not be blamed for.

One phase a trial, because nobody wrote down the motor's angle at the first frame. One static vector a marker, because
markers are placed by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from swimbase.arrays import Array

_SHIFTS = 24
_COARSE_FRAMES = 60


@dataclass(frozen=True)
class Alignment:
    """The phase of a trial and the registration of its markers.

    Attributes:
        shift: Time by which the simulation is read later [s], from 0 to a period.
        registration: Real minus simulated, the median over time [m]. Shape (M, 2).
        shape_error: Weighted mean distance that is left [m].
    """

    shift: float
    registration: Array
    shape_error: float


def align(simulated: Callable[[Array], Array], real: Array, times: Array, weights: Array, period: float) -> Alignment:
    """Finds the shift that minimizes the shape error; continuous, not on the frame grid.

    Args:
        simulated: Body-frame positions at any times, (T,) s to (T, M, 2) m; must cover one period more than `times`.
        real: Body-frame positions [m], NaN where not seen. Shape (T, M, 2).
        times: Since the first frame [s]. Shape (T,).
        weights: 0 where a marker doesn't count. Shape (T, M).
        period: Period of the beat [s].
    """
    usable = np.where(np.isfinite(real).all(axis=2), weights, 0.0)

    def shape_error(shift: float) -> float:
        difference = real - simulated(times + shift)
        return weighted_distance(difference - register(difference, usable), usable)

    some = slice(None, None, max(1, len(times) // _COARSE_FRAMES))
    few, few_weights = np.nan_to_num(real[some]), usable[some]
    norm = np.maximum(few_weights.sum(axis=0), 1e-12)[:, None]
    shifts = np.arange(_SHIFTS) * (period / _SHIFTS)
    difference = few - simulated((times[some] + shifts[:, None]).ravel()).reshape(_SHIFTS, *few.shape)
    difference -= ((few_weights[:, :, None] * difference).sum(axis=1) / norm)[:, None]
    coarse = (few_weights * np.sqrt(np.square(difference).sum(axis=3))).sum(axis=(1, 2))
    best = float(shifts[int(np.argmin(coarse))])
    width = period / _SHIFTS
    found = minimize_scalar(
        lambda shift: shape_error(shift % period), bounds=(best - width, best + width), method="bounded",
        options={"xatol": 1e-4 * period},
    )  # fmt: skip
    shift = float(found.x) % period
    difference = real - simulated(times + shift)
    registration = register(difference, usable)
    return Alignment(shift, registration, weighted_distance(difference - registration, usable))


def register(difference: Array, weights: Array) -> Array:
    """Median over the frames that count, zero for a marker without any [m]. Shape (T, M, 2) to (M, 2)."""
    counts = weights > 0
    seen = counts.sum(axis=0)
    # those that don't count come last, so that the middle of the others is at the same place along both axes
    ascending = np.sort(np.where(counts[:, :, None], difference, np.inf).transpose(1, 2, 0), axis=2)
    markers = np.arange(len(seen))
    low, high = (ascending[markers, :, np.minimum(place, len(counts) - 1)] for place in ((seen - 1) // 2, seen // 2))
    return np.where(seen[:, None] > 0, (low + high) / 2, 0.0)


def weighted_distance(residual: Array, weights: Array) -> float:
    """Weighted mean length of the vectors of a residual [m]; NaN vectors must have weight 0."""
    total = float(weights.sum())
    if total <= 0:
        return 0.0
    lengths = np.sqrt(np.square(residual).sum(axis=2))
    return float((weights * np.where(weights > 0, lengths, 0.0)).sum() / total)
