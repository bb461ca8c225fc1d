"""A local model of the residual about a point of a run, from all its evaluations, and the step that it proposes.

A Gaussian process of the changes from that point: slopes, as steep as physics expects them where somebody knows, and
what bends, which alters with the distance. The evidence says how much of each there is and how rough the rest. Far
evaluations so tell little of the slopes, and a direction that nobody tried keeps what is expected of it as its
uncertainty, which counts as a loss, so a step keeps to what is known. (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, sections 2.2, 2.7 and 5.4.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import Bounds, LinearConstraint, NonlinearConstraint, minimize

from swim2real.optimizers.contract import Array, Evaluation
from swimbase.arrays import Mask
from swimbase.errors import OptimizerError

RADIUS = 0.1  # per range: how far a step goes at most unless asked for more
_FEWEST = 4  # evaluations, from which on a variance can be told
_LENGTHS = (0.3, 0.6, 1.2, 5.0)  # per range, over which slopes change
_STEEPNESS = (0.0, 0.3, 3.0, 30.0, 300.0)  # variances of the slopes that physics expects, over that of what bends
_ROUGHNESS = (1e-3, 1e-2, 3e-2, 0.1)  # of what bends, in a range
_KNOWN_OVER = 0.1  # per range: change of a parameter by which it is judged how well it is known
_LEAST = 1e-3  # m, below which a part counts by its square
_TOWARD = 0.5  # of the way to an evaluation that turned around, which a step goes at most
_MARGIN = 0.5  # of the first beats' speed at the best point, which a step keeps in every trial
_SPEED = 0.01  # m/s, the size of a margin
_TURNED = 0.5  # m, a loss that only an evaluation has that goes the wrong way somewhere

Slopes = Callable[[Evaluation], Array]
_Kernel = tuple[float, float, float]


@dataclass(frozen=True)
class _Process:
    """Changes of some outputs from a point, as they are expected after steps.

    Attributes:
        away: Steps that were taken. Shape (N, d).
        metric: Expected products of the slopes of two parameters, of size 1 on average. Shape (d, d).
        kernel: Length over which slopes change, variance of those that physics expects, and roughness.
        solved: The changes, freed from their covariance. Shape (N, n).
        inverse: Of the covariance of the steps. Shape (N, N).
        scales: Variance that every output has of each unit of covariance. Shape (n,).
    """

    away: Array
    metric: Array
    kernel: _Kernel
    solved: Array
    inverse: Array
    scales: Array

    @classmethod
    def of(cls, away: Array, changes: Array, metric: Array) -> _Process:
        """The process with the highest evidence, from changes (N, n) after steps (N, d)."""
        products, size = np.einsum("in,jn->ij", changes, changes), len(away)
        tried: list[tuple[float, _Kernel, tuple[Array, bool]]] = []
        for kernel in product(_LENGTHS, _STEEPNESS if metric.any() else (0.0,), _ROUGHNESS):
            covariance = _covariance(away, away, metric, kernel) + kernel[2] ** 2 * np.eye(size)
            factor = cho_factor(covariance, lower=True)
            fit = float(np.trace(np.asarray(cho_solve(factor, products))))
            determinant = float(np.log(np.diag(factor[0])).sum())
            tried.append((-0.5 * size * np.log(max(fit, 1e-300)) - determinant, kernel, factor))
        _, kernel, factor = max(tried, key=lambda one: one[0])
        return cls._conditioned(away, changes, metric, kernel, np.asarray(cho_solve(factor, np.eye(size))))

    @classmethod
    def _conditioned(cls, away: Array, changes: Array, metric: Array, kernel: _Kernel, inverse: Array) -> _Process:
        solved = np.einsum("ij,jn->in", inverse, changes)
        scales = np.maximum(np.einsum("in,in->n", changes, solved), 0.0) / (len(away) - 2)  # Student's variance
        return cls(away, metric, kernel, solved, inverse, scales)

    def with_outputs(self, changes: Array) -> _Process:
        """The same for other outputs (N, n), which alter as these do."""
        return self._conditioned(self.away, changes, self.metric, self.kernel, self.inverse)

    def cross(self, step: Array) -> Array:
        """Covariance of a step (d,) with those that were taken. Shape (N,)."""
        return _covariance(step[None], self.away, self.metric, self.kernel)[0]

    def slopes(self, step: Array) -> Array:
        """Slopes of `cross`. Shape (N, d)."""
        length, steepness, _ = self.kernel
        here, far = _near(step[None], length)[0], _near(self.away, length)
        apart = _near(self.away - step, length)
        bent = apart[:, None] * (self.away - step) + here * far[:, None] * step
        return bent + steepness * self.away @ self.metric

    def expected(self, step: Array) -> float:
        """Variance of a step before anything was tried, over that of each output."""
        return float(_covariance(step[None], step[None], self.metric, self.kernel)[0, 0])

    def variance(self, step: Array) -> float:
        """Variance of a step, over that of each output."""
        cross = self.cross(step)
        return max(self.expected(step) - float(cross @ self.inverse @ cross), 0.0)

    def variance_slope(self, step: Array) -> Array:
        """Slope of the variance. Shape (d,)."""
        length, steepness, _ = self.kernel
        own = 2 * _near(step[None], length)[0] ** 2 * step + 2 * steepness * self.metric @ step
        return own - 2 * self.slopes(step).T @ (self.inverse @ self.cross(step))

    def change(self, step: Array) -> tuple[Array, Array]:
        """Expected change of each output, and its standard deviation. Shapes (n,)."""
        return self.cross(step) @ self.solved, np.sqrt(self.scales * self.variance(step))


def _near(steps: Array, length: float) -> Array:
    return np.exp(-0.5 * np.square(steps / length).sum(axis=1))


def _covariance(here: Array, there: Array, metric: Array, kernel: _Kernel) -> Array:
    """Covariance of the changes after steps (N, d) and (K, d), all of which are from one rough point. Shape (N, K)."""
    length, steepness, rough = kernel
    inner = here @ there.T
    near, far = _near(here, length), _near(there, length)
    # near * far is the squared exponential about the point itself; the inner product makes it one about the other
    bent = near[:, None] * far * np.expm1(inner / length**2)
    return length**2 * bent + steepness * here @ metric @ there.T + rough**2


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
    """Predicts what is near one of some evaluations, mostly the best, and steps along what is known.

    A prediction takes less than a millisecond, a step a few dozen.

    Attributes:
        base: The evaluation that it is about.
        forward: Whether all its trials go forward.
    """

    def __init__(
        self, evaluations: Sequence[Evaluation], slopes: Slopes | None = None, weigh: Mapping[str, float] | None = None,
        base: Evaluation | None = None,
    ) -> None:  # fmt: skip
        """Fits the model.

        Args:
            evaluations: All of a run. Those that failed are left out, and, where the best one goes forward, those that
                don't.
            slopes: Slopes that physics expects at an evaluation, of anything, so that a parameter counts by how much
                it does there. Shape (d, f).
            weigh: Weights of trials and of parts of the loss, by name, in what a step lowers; 1 for the others.
            base: The one of them that the model is about; the best one by default.

        Raises:
            OptimizerError: Fewer than four are left.
        """
        usable = [one for one in evaluations if not one.failed and one.stages]
        about = base if base is not None and base.stages else min(usable, key=lambda one: one.loss, default=None)
        self.forward = about is not None and not _turned(about)
        every = [one for one in usable if one is not about]
        self._alike = [one for one in every if not (self.forward and _turned(one))]
        if about is None or 1 + len(self._alike) < _FEWEST:
            raise OptimizerError(
                f"a local model needs {_FEWEST} evaluations that didn't fail or turn around and has "
                f"{min(len(usable), 1 + len(self._alike))}; make more"
            )
        self.base = about
        self._here = self.base.candidate.point
        weighed = weigh and self.base.parts
        stage = len(self.base.stages) - (1 if self.forward and not weighed else min(3, len(self.base.stages)))
        residual, weights = self.base.stages[stage]
        if weigh and weighed:
            weights = _weights(residual, self.base.parts, weigh)
        away = self._away([one for one in every if self.forward and _turned(one)])
        self._turns = away / np.maximum(np.square(away).sum(axis=1), _ROUGHNESS[0] ** 2)[:, None]
        self._residual = residual * weights
        changes = np.array([one.stages[stage][0] * weights for one in self._alike]) - self._residual
        metric = np.zeros((len(self._here),) * 2)
        if slopes is not None:
            expected = slopes(self.base)
            metric = expected @ expected.T
            metric *= len(metric) / max(float(np.trace(metric)), 1e-300)
        self._fit = _Process.of(self._away(self._alike), changes, metric)
        self._margins = None
        if self.base.margins.size:
            margins = np.array([one.margins for one in every]) - self.base.margins
            self._margins = _Process.of(self._away(every), margins, metric)

    def _away(self, evaluations: Sequence[Evaluation]) -> Array:
        return np.array([one.candidate.point for one in evaluations]).reshape(-1, len(self._here)) - self._here

    @cached_property
    def known(self) -> Array:
        """Share of each parameter's effect that the evaluations tell of, from 0 to 1. Shape (d,)."""
        return np.array([self._known(_KNOWN_OVER * side) for side in np.eye(len(self._here))])

    @cached_property
    def unsure(self) -> Array:
        """How unsure the loss is after a change of each parameter by the same share of its range [m]. Shape (d,)."""
        spread = np.array([self._fit.variance(_KNOWN_OVER * side) for side in np.eye(len(self._here))])
        before = float(np.einsum("n,n->", self._residual, self._residual))
        return self.base.loss * np.sqrt(self._quadratic[2] * spread / before)

    def safe(self, point: Array) -> bool:
        """Whether no trial is expected to turn around at a point, by a standard deviation. Shape (d,)."""
        step = point - self._here
        if self._margins is not None:
            change, stds = self._margins.change(step)
            if np.any(self.base.margins + change - stds < np.minimum(self.base.margins, 0.0)):
                return False
        return bool(np.all(self._turns @ step < _TOWARD))

    def _known(self, step: Array) -> float:
        return 1 - self._fit.variance(step) / max(self._fit.expected(step), 1e-300)

    @cached_property
    def _quadratic(self) -> tuple[Array, Array, float]:
        """Curvature (N, N) and slope (N,) of the squares over `cross`, and their variance per unit of covariance."""
        solved = self._fit.solved
        curvature = np.einsum("in,jn->ij", solved, solved)
        return curvature, np.einsum("in,n->i", solved, self._residual), float(self._fit.scales.sum())

    def _squares(self, step: Array) -> tuple[float, Array]:
        """Expected change of the squares without what isn't known, and its slope (d,)."""
        curvature, slope, _ = self._quadratic
        cross = self._fit.cross(step)
        along = slope + curvature @ cross
        return float(cross @ (slope + along)), 2 * self._fit.slopes(step).T @ along

    def predict(self, point: Array) -> Prediction:
        """What is expected at a point of the unit cube. Shape (d,)."""
        step = point - self._here
        before = float(np.einsum("n,n->", self._residual, self._residual))
        mean = max(before + self._squares(step)[0], 0.0)
        spread = self._quadratic[2] * self._fit.variance(step)
        # a loss is a mean of distances, and these squares are weighted such that they add up to it at the base
        loss, std = (self.base.loss * float(np.sqrt(square / before)) for square in (mean + spread, spread))
        known = self._known(step)
        if self._margins is None:
            return Prediction(loss, std, np.zeros(0), np.zeros(0), known)
        change, stds = self._margins.change(step)
        return Prediction(loss, std, self.base.margins + change, stds, known)

    def sizes(self, point: Array) -> Array:
        """Size of each of the base's parts at a point, over what it is at the base. Shape (K,)."""
        if not self.base.parts:
            return np.zeros(0)
        stage = len(self.base.stages) - min(3, len(self.base.stages))
        residual, weights = self.base.stages[stage]
        rows = np.array([one.stages[stage][0] for one in self._alike]) * weights
        here = residual * weights
        change, stds = self._fit.with_outputs(rows - here).change(point - self._here)
        squares, before = np.square(here + change) + np.square(stds), np.square(here)
        edges = np.cumsum([0, *(count for _, _, count in self.base.parts)])[:-1]
        return np.sqrt(np.add.reduceat(squares, edges) / np.maximum(np.add.reduceat(before, edges), _LEAST**2))

    def expect(self, point: Array, of: Callable[[Evaluation], Array]) -> tuple[Array, Array]:
        """Other quantities at a point that alter as the residual does, with standard deviations.

        Args:
            point: In the unit cube. Shape (d,).
            of: An evaluation's quantities, NaN where one isn't known. Any shape.

        Returns:
            In that shape; NaN for what isn't known of every evaluation.
        """
        here = of(self.base)
        changes = np.array([of(one) - here for one in self._alike]).reshape(len(self._alike), -1)
        change, stds = self._fit.with_outputs(changes).change(point - self._here)
        return here + change.reshape(here.shape), stds.reshape(here.shape)

    def solve(self, radius: float = RADIUS, free: Mask | None = None) -> Array:
        """The point within a trust radius at which the expected squares are lowest.

        The speed of the first beats stays above a share of that of the best point in every trial, or rises where it is
        below 0, as far as the model is sure of it by a standard deviation. The step also goes half the way at
        most toward any evaluation that turned around.

        Args:
            radius: By how much each parameter may change at most, as a share of its range.
            free: Parameters that may change; None for all. Shape (d,).
        """
        size = np.where(np.ones(len(self._here), bool) if free is None else free, radius, 0.0)
        low, high = np.maximum(-self._here, -size), np.minimum(1 - self._here, size)
        scale, nowhere = self._quadratic[2], np.zeros(len(size))
        unit = max(float(np.abs(self._squares(nowhere)[1]).max()) * radius, 1e-300)
        constraints: list[NonlinearConstraint | LinearConstraint] = []
        if len(self._turns):
            constraints.append(LinearConstraint(self._turns, -np.inf, _TOWARD))
        if (fit := self._margins) is not None:
            floor = np.where(self.base.margins > 0, _MARGIN * self.base.margins, self.base.margins)

            def left(step: Array) -> Array:
                change, stds = fit.change(step)
                return (self.base.margins + change - np.maximum(stds, 1e-9) - floor) / _SPEED

            constraints.append(NonlinearConstraint(left, 0.0, np.inf))

        def expected(step: Array) -> tuple[float, Array]:
            squares, slope = self._squares(step)
            unknown, more = self._fit.variance(step), self._fit.variance_slope(step)
            return (squares + scale * unknown) / unit, (slope + scale * more) / unit

        found = minimize(
            expected, nowhere, jac=True, bounds=Bounds(low, high), constraints=constraints, method="SLSQP",
            options={"maxiter": 60},
        )  # fmt: skip
        return np.clip(self._here + np.clip(found.x, low, high), 0.0, 1.0)


def _weights(residual: Array, parts: Sequence[tuple[str, str, int]], weigh: Mapping[str, float]) -> Array:
    """Weights of a residual's entries with which a part of a trial counts by its size, times what it is weighed by."""
    weights, at = np.ones_like(residual), 0
    for trial, part, count in parts:
        entries = slice(at, at + count)
        length = max(float(np.linalg.norm(residual[entries])), _LEAST)
        weights[entries] = np.sqrt(weigh.get(trial, 1.0) * weigh.get(part, 1.0) / length)
        at += count
    return weights


def _turned(evaluation: Evaluation) -> bool:
    return evaluation.loss >= _TURNED
