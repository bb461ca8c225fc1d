"""A linear model of the residual about the best point so far, from all evaluations of a run, and the step it proposes.

Bayesian linear regression: an evaluation tells of the slopes at the best point the less the farther it is away, since
what bends grows with the square of the distance. The evidence says how steep slopes are to be expected. A direction
that nobody tried keeps that expectation as its uncertainty, which counts as a loss, so a step keeps to what is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from swim2real.optimizers.contract import Array, Evaluation
from swimbase.arrays import Mask
from swimbase.errors import OptimizerError

RADIUS = 0.1  # per range: how far a step goes at most unless asked for more
_NEAR = 0.05  # per range: distance up to which an evaluation tells as much as one next to the best point
_CAUTION = 0.1  # weight of what isn't known in the squares that a step lowers
_STEEPNESS = np.geomspace(1e-2, 1e4, 13)  # variances of slopes that may be expected, over that of what bends
_MARGIN = 0.5  # of the first beats' speed at the best point, which a step keeps in every trial
_SPEED = 0.01  # m/s, the size of a margin
_TURNED = 0.5  # m, a loss that only an evaluation has that goes the wrong way somewhere


@dataclass(frozen=True)
class _Slopes:
    """Slopes of some outputs at a point.

    Attributes:
        slopes: Shape (d, n).
        covariance: Of the slopes of an output, over the variance of what bends in it. Shape (d, d).
        steepness: What it was for each coordinate before any evaluation.
        scales: Variance of what bends in each output. Shape (n,).
    """

    slopes: Array
    covariance: Array
    steepness: float
    scales: Array

    def variance(self, step: Array) -> float:
        """Variance of an output after a step, over that of what bends in it. Shape (d,)."""
        return max(float(step @ self.covariance @ step), 0.0)

    @classmethod
    def of(cls, away: Array, changes: Array) -> _Slopes:
        """The regression with the highest evidence, from changes (N, n) at distances (N, d) from the point."""
        noise = _NEAR**2 + np.square(away).sum(axis=1)
        inner, products = away @ away.T, np.einsum("in,jn->ij", changes, changes)
        tried: list[tuple[float, float, tuple[Array, bool]]] = []
        for steepness in _STEEPNESS:
            factor = cho_factor(steepness * inner + np.diag(noise), lower=True)
            fit = float(np.trace(np.asarray(cho_solve(factor, products))))
            determinant = float(np.log(np.diag(factor[0])).sum())
            tried.append((-0.5 * len(away) * np.log(max(fit, 1e-300)) - determinant, steepness, factor))
        _, steepness, factor = max(tried, key=lambda one: one[0])
        weights = steepness * np.asarray(cho_solve(factor, away)).T
        scales = np.einsum("in,in->n", changes, np.asarray(cho_solve(factor, changes))) / len(away)
        covariance = steepness * (np.eye(away.shape[1]) - weights @ away)
        return cls(np.einsum("di,in->dn", weights, changes), covariance, steepness, scales)


class Prediction(NamedTuple):
    """What is expected at a point.

    Attributes:
        loss: Loss [m].
        std: Its standard deviation [m].
        margins: Speeds of the first beats [m/s]. Shape (F,).
        margin_stds: Their standard deviations [m/s]. Shape (F,).
        known: Share of the way there, from 0 to 1, that evaluations tell of.
    """

    loss: float
    std: float
    margins: Array
    margin_stds: Array
    known: float


class LocalModel:
    """Predicts what is near the best of some evaluations, and steps along what is known.

    A prediction and a step take a few milliseconds.

    Attributes:
        base: The best evaluation.
        forward: Whether all its trials go forward.
    """

    def __init__(self, evaluations: Sequence[Evaluation]) -> None:
        """Fits the model.

        Args:
            evaluations: All of a run. Those that failed are left out, and, where the best one goes forward, those that
                don't.

        Raises:
            OptimizerError: Fewer than two are left.
        """
        usable = [one for one in evaluations if not one.failed and one.stages]
        ordered = sorted(usable, key=lambda one: one.loss)
        self.forward = bool(ordered) and not _turned(ordered[0])
        every = ordered[1:]
        alike = [one for one in every if not (self.forward and _turned(one))]
        if not alike:
            raise OptimizerError("a local model needs two evaluations that didn't fail or turn around; make more")
        self.base = ordered[0]
        self._here = self.base.candidate.point
        stage = len(self.base.stages) - (1 if self.forward else min(3, len(self.base.stages)))
        residual, weights = self.base.stages[stage]
        self._residual = residual * weights
        changes = np.array([one.stages[stage][0] * weights for one in alike]) - self._residual
        self._fit = _Slopes.of(self._away(alike), changes)
        self._margins = None
        if self.base.margins.size:
            self._margins = _Slopes.of(self._away(every), np.array([e.margins for e in every]) - self.base.margins)

    def _away(self, evaluations: Sequence[Evaluation]) -> Array:
        return np.array([one.candidate.point for one in evaluations]) - self._here

    @property
    def known(self) -> Array:
        """Share of each parameter's effect that the evaluations tell of, from 0 to 1. Shape (d,)."""
        return 1 - np.diag(self._fit.covariance) / self._fit.steepness

    @cached_property
    def _quadratic(self) -> tuple[Array, Array, float]:
        """Curvature (d, d), slope (d,) and what is unknown (times the step's variance) of the expected squares."""
        slopes = self._fit.slopes
        curvature = np.einsum("in,jn->ij", slopes, slopes)
        return curvature, np.einsum("in,n->i", slopes, self._residual), float(self._fit.scales.sum())

    def predict(self, point: Array) -> Prediction:
        """What is expected at a point of the unit cube. Shape (d,)."""
        step = point - self._here
        curvature, slope, scale = self._quadratic
        before = float(np.einsum("n,n->", self._residual, self._residual))
        mean = max(before + float(2 * slope @ step + step @ curvature @ step), 0.0)
        spread = self._fit.variance(step)
        # a loss is a mean of distances, and these squares are weighted such that they add up to it at the base
        loss, std = (float(np.sqrt(before * square)) for square in (mean + scale * spread, scale * spread))
        known = 1 - spread / max(self._fit.steepness * float(step @ step), 1e-300)
        if self._margins is None:
            return Prediction(loss, std, np.zeros(0), np.zeros(0), known)
        margins = self.base.margins + step @ self._margins.slopes
        return Prediction(loss, std, margins, np.sqrt(self._margins.scales * self._margins.variance(step)), known)

    def solve(self, radius: float = RADIUS, free: Mask | None = None) -> Array:
        """The point within a trust radius at which the expected squares are lowest.

        The speed of the first beats stays above a share of that of the best point in every trial, or rises where it is
        below 0, as far as the model is sure of it by a standard deviation.

        Args:
            radius: By how much each parameter may change at most, as a share of its range.
            free: Parameters that may change; None for all. Shape (d,).
        """
        curvature, slope, scale = self._quadratic
        curvature = curvature + _CAUTION * scale * self._fit.covariance
        size = np.where(np.ones(len(slope), bool) if free is None else free, radius, 0.0)
        low, high = np.maximum(-self._here, -size), np.minimum(1 - self._here, size)
        unit = max(float(np.abs(slope).max()) * radius, 1e-300)
        constraints: list[NonlinearConstraint] = []
        if (fit := self._margins) is not None:
            floor = np.where(self.base.margins > 0, _MARGIN * self.base.margins, self.base.margins)

            def left(step: Array) -> Array:
                spread = np.sqrt(fit.scales * max(fit.variance(step), 1e-18))
                return (self.base.margins + step @ fit.slopes - spread - floor) / _SPEED

            constraints.append(NonlinearConstraint(left, 0.0, np.inf))

        def expected(step: Array) -> tuple[float, Array]:
            squares = float(2 * slope @ step + step @ curvature @ step)
            return squares / unit, 2 * (slope + curvature @ step) / unit

        found = minimize(
            expected, np.zeros(len(slope)), jac=True, bounds=Bounds(low, high), constraints=constraints,
            method="SLSQP", options={"maxiter": 60},
        )  # fmt: skip
        return np.clip(self._here + np.clip(found.x, low, high), 0.0, 1.0)


def _turned(evaluation: Evaluation) -> bool:
    return evaluation.loss >= _TURNED
