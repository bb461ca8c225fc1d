"""Evaluates points of the unit cube for studies of runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from swim2real.calibration.problem import Problem
from swim2real.parameters import ParameterSpace
from swimbase.arrays import Array

_LEAST = 1e-5  # m, of a misfit; no camera sees less


@dataclass(frozen=True)
class EvaluatedPoint:
    """An evaluated point.

    Attributes:
        point: Coordinates in the unit cube. Shape (d,).
        loss: Loss of the comparison [m].
        residual: Residual vector of the comparison [m]. Shape (n,).
        failed: Whether a simulation diverged.
    """

    point: Array
    loss: float
    residual: Array
    failed: bool

    @property
    def misfit(self) -> float:
        """Root of the mean square of the residual, which Gauss-Newton lowers; never 0 [m]."""
        return max(float(np.linalg.norm(self.residual)), _LEAST)


def evaluated(problem: Problem, space: ParameterSpace, points: Sequence[Array]) -> Iterator[EvaluatedPoint]:
    """Evaluates points of the unit cube, some at a time, and gives each as soon as it is there. Each of shape (d,)."""
    comparisons = problem.evaluate_each([space.to_values(point) for point in points])
    for point, one in zip(points, comparisons, strict=True):
        yield EvaluatedPoint(np.asarray(point), one.loss, one.residual_vector(), one.divergence is not None)


def independent_numbers(residual: Array, blocks: Sequence[tuple[int, int]]) -> float:
    """Estimated number of independent numbers in a residual, which hangs together in time and between markers.

    Args:
        residual: Shape (n,).
        blocks: Rows, in time, and columns of the numbers that belong together; n is the sum of their products.
    """
    count, first = 0.0, 0
    for rows, columns in blocks:
        noise = residual[first : first + rows * columns].reshape(rows, columns)
        first += rows * columns
        between, along = np.einsum("ti,tj->ij", noise, noise) / rows, _autocorrelation(noise)
        count += _participation(between) * _independent_frames(along)
    return count


def _autocorrelation(noise: Array) -> Array:
    """Autocorrelation of all channels together, not centered, biased toward 0 at long lags so that it is a covariance.

    Args:
        noise: Channels over time. Shape (T, C).

    Returns:
        The autocorrelation, 1 at lag 0. Shape (T,).
    """
    frames = len(noise)
    spectrum = np.square(np.abs(np.fft.rfft(noise, 2 * frames, axis=0))).sum(axis=1)
    lags = np.fft.irfft(spectrum)[:frames]
    return lags / lags[0] if lags[0] > 0 else np.eye(1, frames)[0]


def _independent_frames(correlation: Array) -> float:
    """Independent numbers in a stationary series of this correlation: 2 for a sine, T for white noise."""
    frames = len(correlation)
    shares = 1 - np.arange(frames) / frames
    return float(frames / (1 + 2 * np.sum(shares[1:] * correlation[1:] ** 2)))


def _participation(covariance: Array) -> float:
    """Participation ratio: how many eigenvalues share the sum; all of them where there is no residual."""
    square = float(np.sum(covariance**2))
    return float(np.trace(covariance)) ** 2 / square if square > 0 else float(len(covariance))
