"""Residuals at points that weren't simulated: Gaussian processes of their principal components."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from swim2real.identification.evaluated import EvaluatedPoint
from swimbase.arrays import Array

_COMPONENTS = 24
_FAR = 3.0  # times the lowest misfit, from which on points count less in the choice of the components
_LENGTHS = (0.05, 5.0)  # per range
_STEPS = (1.5, 1.25, 1.1)  # factors by which the kernel's numbers are tried, one after the other
_JITTER, _RIDGE = 1e-8, 1e-6


class Emulator:
    """Mean square of the residual that is to be expected anywhere, from points that were evaluated.

    The residual's difference to the best one's is written in its principal components. All have the same covariance, a
    squared exponential and a linear part with white noise, chosen by the evidence. It has one length for each of the
    directions in which the residual changes the least, the next least and so on, since valleys run along combinations
    of parameters. The variance of the prediction counts, so what is unknown looks bad, until it is evaluated.
    (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 5.4; Constantine, Active
    Subspaces, 2015; Conti and O'Hagan, J. Stat. Plan. Inference 140, 640 (2010), for many outputs with one covariance.)

    Attributes:
        kernel: Logarithms of the directions' lengths, of the linear part's slope and of the noise. Shape (d + 2,).
        lowest: Lowest misfit of the points [m].
    """

    def __init__(self, evaluated: Sequence[EvaluatedPoint], kernel: Array | None = None) -> None:
        """Conditions the processes.

        Args:
            evaluated: Points that didn't fail, more than one.
            kernel: Where the choice of the kernel begins, as another emulator has it.
        """
        best = min(evaluated, key=lambda one: one.misfit)
        self.lowest, self._center = best.misfit, best.point
        self._points = np.array([one.point for one in evaluated])
        changes = np.array([one.residual for one in evaluated]) - best.residual
        near = np.minimum(1.0, _FAR * self.lowest / np.maximum(np.linalg.norm(changes, axis=1), 1e-300))
        basis = _components(changes * near[:, None])
        self._outputs = np.einsum("in,kn->ik", changes, basis)
        self._slope = 2 * np.einsum("kn,n->k", basis, best.residual)
        size = self._points.shape[1]
        self._axes = _directions(self._points - self._center, self._outputs, near**2)
        self.kernel = self._chosen(np.append(np.zeros(size), [0.0, -3.0]) if kernel is None else kernel)
        factor = cho_factor(self._covariance(self.kernel), lower=True)
        self._weights = np.asarray(cho_solve(factor, self._outputs))
        self._whitener = np.asarray(solve_triangular(factor[0], np.eye(len(self._points)), lower=True))
        self._scale = float(np.einsum("ik,ik->", self._outputs, self._weights)) / len(self._points)

    def __call__(self, points: Array) -> Array:
        """Expected square of the misfit [m²]. Shape (N, d) to (N,)."""
        cross, own = self._between(points, self.kernel)
        explained = np.square(cross @ self._whitener.T).sum(axis=1)
        change = cross @ self._weights
        mean = self.lowest**2 + np.einsum("ik,k->i", change, self._slope) + np.square(change).sum(axis=1)
        return np.maximum(mean, 0.0) + self._scale * np.maximum(own - explained, 0.0)

    def _between(self, points: Array, kernel: Array) -> tuple[Array, Array]:
        """Covariance with the evaluated points (N, K), and the points' own variance (N,)."""
        lengths, linear = np.exp(kernel[:-2]), np.exp(2 * kernel[-2])
        here, there = ((x - self._center) @ self._axes / lengths for x in (points, self._points))
        product, squares = np.einsum("ia,ja->ij", here, there), np.square(here).sum(axis=1)
        apart = squares[:, None] + np.square(there).sum(axis=1) - 2 * product
        return np.exp(-0.5 * np.maximum(apart, 0.0)) + linear * product, 1 + linear * squares

    def _covariance(self, kernel: Array) -> Array:
        noise = np.exp(2 * kernel[-1]) + _JITTER
        return self._between(self._points, kernel)[0] + noise * np.eye(len(self._points))

    def _evidence(self, kernel: Array) -> float:
        """Logarithm of the evidence with the best common scale, and a wide prior of the lengths."""
        try:
            factor = cho_factor(self._covariance(kernel), lower=True)
        except np.linalg.LinAlgError:
            return -np.inf
        count, outputs = self._outputs.shape
        fit = float(np.einsum("ik,ik->", self._outputs, np.asarray(cho_solve(factor, self._outputs))))
        determinant = float(np.log(np.diag(factor[0])).sum())
        return -outputs * (0.5 * count * np.log(max(fit, 1e-300)) + determinant) - 0.2 * float(np.sum(kernel[:-2] ** 2))

    def _chosen(self, kernel: Array) -> Array:
        """The kernel with the highest evidence, one number after the other."""
        highest = self._evidence(kernel)
        for factor in _STEPS:
            for i in range(kernel.size):
                for step in (np.log(factor), -np.log(factor)):
                    tried = kernel.copy()
                    tried[i] += step
                    if i < kernel.size - 2:
                        tried[i] = np.clip(tried[i], *np.log(_LENGTHS))
                    evidence = self._evidence(tried)
                    if evidence > highest:
                        kernel, highest = tried, evidence
                        break
        return kernel


def _components(changes: Array) -> Array:
    """Principal components, the largest first, by the inner products of the few rows. Shape (N, n) to (k, n)."""
    squares, sides = np.linalg.eigh(changes @ changes.T)
    kept = np.flatnonzero(squares > 1e-6 * squares[-1])[: -_COMPONENTS - 1 : -1]
    return sides[:, kept].T @ changes / np.sqrt(squares[kept])[:, None]


def _directions(away: Array, changes: Array, weights: Array) -> Array:
    """Directions in which outputs change the least to the most, in the linear fit to their changes. Shape (d, d)."""
    away, changes = away * weights[:, None], changes * weights[:, None]
    square = np.einsum("ia,ib->ab", away, away)
    ridge = _RIDGE * np.trace(square) * np.eye(len(square))
    slopes = np.linalg.solve(square + ridge, np.einsum("ia,ik->ak", away, changes))
    return np.linalg.eigh(np.einsum("ak,bk->ab", slopes, slopes))[1]
