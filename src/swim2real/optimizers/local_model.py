"""A local model of the residual about a point of a run, from all its evaluations, and the step that it proposes.

A Gaussian process of the changes from that point: slopes, as steep as physics expects them where somebody knows, and
what bends, which alters with the distance. The evidence says how much of each there is and how rough the rest. Far
evaluations so tell little of the slopes, and a direction that nobody tried keeps what is expected of it as its
uncertainty, which counts as a loss, so a step keeps to what is known. (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, sections 2.2, 2.7 and 5.4.) The loss is what it is defined as, a mean of distances, of the
residual that is expected; the root of weighted squares is never less, and far from the point where it is weighted much
more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import Bounds, LinearConstraint, NonlinearConstraint, minimize
from scipy.special import gammaln

from swim2real.optimizers.advisor import DECIMALS
from swim2real.optimizers.contract import Array, Evaluation
from swimbase.arrays import Mask
from swimbase.errors import OptimizerError

RADIUS = 0.1  # per range: how far a step goes at most unless asked for more
KNOWN = 0.5  # share of a parameter's slopes that evaluations tell of, below which it counts as unknown
_FEWEST = 4  # evaluations, from which on a variance can be told
_LENGTHS = (0.3, 0.6, 1.2, 5.0)  # per range, over which slopes change
_STEEPNESS = (0.0, 0.3, 3.0, 30.0, 300.0)  # variances of the slopes that physics expects, over that of what bends
_ROUGHNESS = (1e-3, 1e-2, 3e-2, 0.1)  # of what bends, in a range
_LEAST = 1e-3  # m, below which a part counts by its square
_TOWARD = 0.5  # of the way to an evaluation that turned around, which a step goes at most
_MARGIN = 0.5  # of the first beats' speed at the best point, which a step keeps in every trial
_SPEED = 0.01  # m/s, the size of a margin
_TURNED = 0.5  # m, a loss that only an evaluation has that goes the wrong way somewhere, where something may

Slopes = Callable[[Evaluation], Array]
_Kernel = tuple[float, float, float]


@dataclass(frozen=True)
class _Process:
    """Changes of some outputs from a point, as they are expected after steps.

    Attributes:
        away: Steps that were taken. Shape (N, d).
        metric: Expected products of the slopes of two parameters, of size 1 on average. Shape (d, d).
        kernel: Length over which slopes change, variance of those that physics expects, and roughness.
        changes: Changes after these steps. Shape (N, n).
        inverse: Of the covariance of the steps. Shape (N, N).
    """

    away: Array
    metric: Array
    kernel: _Kernel
    changes: Array
    inverse: Array

    @classmethod
    def of(cls, away: Array, changes: Array, metric: Array) -> _Process:
        """The process with the highest evidence, from changes (N, n) after steps (N, d)."""
        products, size = changes @ changes.T, len(away)
        tried: list[tuple[float, _Kernel, tuple[Array, bool]]] = []
        for kernel in product(_LENGTHS, _STEEPNESS if metric.any() else (0.0,), _ROUGHNESS):
            covariance = _covariance(away, away, metric, kernel) + kernel[2] ** 2 * np.eye(size)
            factor = cho_factor(covariance, lower=True)
            fit = float(np.trace(np.asarray(cho_solve(factor, products))))
            determinant = float(np.log(np.diag(factor[0])).sum())
            tried.append((-0.5 * size * np.log(max(fit, 1e-300)) - determinant, kernel, factor))
        _, kernel, factor = max(tried, key=lambda one: one[0])
        return cls(away, metric, kernel, changes, np.asarray(cho_solve(factor, np.eye(size))))

    def with_outputs(self, changes: Array) -> _Process:
        """The same for other outputs (N, n), which alter as these do."""
        return replace(self, changes=changes)

    @cached_property
    def scales(self) -> Array:
        """Variance that every output has of each unit of covariance, as is most likely (Student's). Shape (n,)."""
        squares = np.einsum("in,in->n", self.changes, self.inverse @ self.changes)
        return np.maximum(squares, 0.0) / (len(self.away) - 2)

    def scale(self, slope: Array) -> float:
        """The same of a sum of the outputs, with weights (n,)."""
        summed = np.einsum("in,n->i", self.changes, slope)
        return max(float(summed @ self.inverse @ summed), 0.0) / (len(summed) - 2)

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

    @cached_property
    def slope_weights(self) -> Array:
        """What each change adds to the slopes where they all begin. Shape (d, N)."""
        return self.slopes(np.zeros(self.away.shape[1])).T @ self.inverse

    @cached_property
    def slope_variances(self) -> tuple[Array, Array]:
        """Variance of the slopes there, over that of each output, and what it was before anything was tried. (d,)."""
        before = 1 + self.kernel[1] * np.diag(self.metric)
        told = np.einsum("di,id->d", self.slope_weights, self.slopes(np.zeros(len(before))))
        return np.maximum(before - told, 0.0), before

    def change(self, step: Array) -> tuple[Array, Array]:
        """Expected change of each output, and its standard deviation. Shapes (n,)."""
        return self.inverse @ self.cross(step) @ self.changes, np.sqrt(self.scales * self.variance(step))

    def change_slopes(self, step: Array) -> tuple[Array, Array]:
        """Slopes of both at a step. Shapes (n, d)."""
        mean = (self.slopes(step).T @ (self.inverse @ self.changes)).T
        relative = self.variance_slope(step) / (2 * max(np.sqrt(self.variance(step)), 1e-9))
        return mean, np.outer(np.sqrt(self.scales), relative)


def _metric(slopes: Array) -> Array:
    """Expected products of slopes (d, f), of size 1 on average: as steep as the others where none are known. (d, d)."""
    metric = slopes @ slopes.T
    known = slopes.any(axis=1)
    size = float(np.trace(metric)) / max(int(known.sum()), 1)
    return (metric + np.diag(np.where(known, 0.0, size))) / max(size, 1e-300)


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

    A prediction takes a few milliseconds, a step a few dozen of them.

    Attributes:
        base: The evaluation that it is about.
    """

    def __init__(
        self, evaluations: Sequence[Evaluation], slopes: Slopes | None = None, weigh: Mapping[str, float] | None = None,
        base: Evaluation | None = None,
    ) -> None:  # fmt: skip
        """Fits the model.

        Args:
            evaluations: All of a run. Those that failed or turned around are left out.
            slopes: Slopes that physics expects at an evaluation, of anything, so that a parameter counts by how much
                it does there; zeros for a parameter of which it knows nothing. Shape (d, f).
            weigh: Weights of trials and of parts of the loss, by name, in what a step lowers; 1 for the others.
            base: The one of them that the model is about; the best one by default.

        Raises:
            OptimizerError: Fewer than four are left, or the base turned around.
        """
        usable = [one for one in evaluations if not one.failed and one.stages]
        about = base if base is not None and base.stages else min(usable, key=lambda one: one.loss, default=None)
        every = [one for one in usable if one is not about]
        self._alike = [one for one in every if not _turned(one)]
        if about is None or _turned(about) or 1 + len(self._alike) < _FEWEST:
            raise OptimizerError(
                f"a local model needs {_FEWEST} evaluations that didn't fail or turn around, the best one among them, "
                f"and has {len([one for one in usable if not _turned(one)])}; make more"
            )
        self.base = about
        self._here = about.candidate.point
        if weigh and about.parts:
            residuals = [_apart(one)[0] for one in (about, *self._alike)]
            widths, weights = [count for _, _, count in about.parts], _weights(residuals[0], about.parts, weigh)
        else:
            residuals = [one.stages[-1][0] for one in (about, *self._alike)]
            widths, weights = about.widths, about.stages[-1][1]
        self._residual = residuals[0] * weights
        self._widths = np.array(widths if len(widths) else [len(self._residual)])
        self._begins = np.cumsum(self._widths) - self._widths
        changes = np.array(residuals[1:]) * weights - self._residual
        away = self._away([one for one in every if _turned(one)])
        self._turns = away / np.maximum(np.square(away).sum(axis=1), _ROUGHNESS[0] ** 2)[:, None]
        metric = np.zeros((len(self._here),) * 2) if slopes is None else _metric(slopes(about))
        self._fit = _Process.of(self._away(self._alike), changes, metric)
        self._margins = None
        if about.margins.size:
            margins = np.array([one.margins for one in every]) - about.margins
            self._margins = _Process.of(self._away(every), margins, metric)

    def _away(self, evaluations: Sequence[Evaluation]) -> Array:
        return np.array([one.candidate.point for one in evaluations]).reshape(-1, len(self._here)) - self._here

    @cached_property
    def known(self) -> Array:
        """Share of each parameter's slopes that the evaluations tell of, from 0 to 1. Shape (d,)."""
        left, before = self._fit.slope_variances
        return 1 - left / before

    @cached_property
    def unknown(self) -> Array:
        """Distance by which what isn't known of each parameter's slopes may move all [m per range]. Shape (d,)."""
        return self._distance * np.sqrt(self._fit.slope_variances[0])

    def unknown_at(self, point: Array) -> float:
        """Distance by which what isn't known of the way to a point may move all [m]."""
        return self._distance * float(np.sqrt(self._fit.variance(point - self._here)))

    @cached_property
    def _distance(self) -> float:
        """What a unit of covariance moves all by [m]."""
        return self._unit * float(np.einsum("g,g->", self._lengths, np.sqrt(self._spreads)))

    @cached_property
    def loss_slopes(self) -> tuple[Array, Array]:
        """Slopes of the loss, per range of each parameter [m], with their standard deviations. Shapes (d,)."""
        along = self._along(np.zeros(len(self._here)))
        means = self._fit.slope_weights @ np.einsum("in,n->i", self._fit.changes, along)
        return means, np.sqrt(self._fit.scale(along) * self._fit.slope_variances[0])

    def margin_slopes(self, trial: int) -> tuple[Array, Array]:
        """Slopes of a trial's first beats [m/s per range], with their standard deviations. Shapes (d,)."""
        fit = self._margins
        if fit is None:
            raise OptimizerError("nothing is known of the first beats; a local model of them needs their speeds")
        return fit.slope_weights @ fit.changes[:, trial], np.sqrt(fit.scales[trial] * fit.slope_variances[0])

    def slopes(self, of: Callable[[Evaluation], Array]) -> tuple[Array, Array]:
        """Slopes of other quantities, as in `expect`, with their standard deviations. Shapes (d, ...)."""
        here, fit = self._with_outputs(of)
        means, stds = fit.slope_weights @ fit.changes, np.sqrt(np.outer(fit.slope_variances[0], fit.scales))
        return means.reshape(-1, *here.shape), stds.reshape(-1, *here.shape)

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
    def _lengths(self) -> Array:
        """Each distance at the base, of weighted entries. Shape (G,)."""
        return np.sqrt(np.add.reduceat(np.square(self._residual), self._begins))

    @cached_property
    def _unit(self) -> float:
        """Loss of a product of two such distances."""
        return self.base.loss / float(np.einsum("g,g->", self._lengths, self._lengths))

    @cached_property
    def _spreads(self) -> Array:
        """Of each distance's mean square, what a unit of covariance adds to the square of its mean. Shape (G,)."""
        half = 0.5 * self._widths  # a mean length of normal entries, squared, over their mean square: 2/π, π/4, … 1
        share = np.exp(2 * (gammaln(half + 0.5) - gammaln(half))) / half
        return share * np.add.reduceat(self._fit.scales, self._begins)

    def _moved(self, step: Array) -> tuple[Array, Array]:
        """Expected residual after a step, and the mean distances of what it may be. Shapes (n,) and (G,)."""
        moved = self._residual + self._fit.inverse @ self._fit.cross(step) @ self._fit.changes
        squares = np.add.reduceat(np.square(moved), self._begins) + self._spreads * self._fit.variance(step)
        return moved, np.sqrt(np.maximum(squares, 1e-24))

    def _along(self, step: Array) -> Array:
        """Slope of the loss over the residual's entries after a step. Shape (n,)."""
        moved, distances = self._moved(step)
        return self._unit * np.repeat(self._lengths / distances, self._widths) * moved

    def _loss(self, step: Array) -> tuple[float, Array]:
        """Expected loss after a step, and its slope (d,)."""
        moved, distances = self._moved(step)
        ratios = self._unit * self._lengths / distances
        along = np.einsum("in,n->i", self._fit.changes, np.repeat(ratios, self._widths) * moved)
        slope = self._fit.slopes(step).T @ (self._fit.inverse @ along)
        unknown = 0.5 * float(np.einsum("g,g->", ratios, self._spreads)) * self._fit.variance_slope(step)
        return self._unit * float(np.einsum("g,g->", self._lengths, distances)), slope + unknown

    def predict(self, point: Array) -> Prediction:
        """What is expected at a point of the unit cube. Shape (d,)."""
        step = point - self._here
        loss = self._loss(step)[0]
        std = float(np.sqrt(self._fit.scale(self._along(step)) * self._fit.variance(step)))
        known = self._known(step)
        if self._margins is None:
            return Prediction(loss, std, np.zeros(0), np.zeros(0), known)
        change, stds = self._margins.change(step)
        return Prediction(loss, std, self.base.margins + change, stds, known)

    def sizes(self, point: Array) -> Array:
        """Size of each of the base's parts at a point, over what it is at the base. Shape (K,)."""
        if not self.base.parts:
            return np.zeros(0)
        residual, weights = _apart(self.base)
        rows = np.array([_apart(one)[0] for one in self._alike]) * weights
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
        here, fit = self._with_outputs(of)
        change, stds = fit.change(point - self._here)
        return here + change.reshape(here.shape), stds.reshape(here.shape)

    def _with_outputs(self, of: Callable[[Evaluation], Array]) -> tuple[Array, _Process]:
        here = of(self.base)
        return here, self._fit.with_outputs(np.array([(of(one) - here).ravel() for one in self._alike]))

    def solve(self, radius: float = RADIUS, free: Mask | None = None) -> Array:
        """The point within a trust radius at which the expected loss is lowest.

        The speed of the first beats stays above a share of that of the best point in every trial, or rises where it is
        below 0, as far as the model is sure of it by a standard deviation. The step also goes half the way at
        most toward any evaluation that turned around.

        Args:
            radius: By how much each parameter may change at most, as a share of its range.
            free: Parameters that may change; None for all. Shape (d,).
        """
        size = np.where(np.ones(len(self._here), bool) if free is None else free, radius, 0.0)
        low, high = np.maximum(-self._here, -size), np.minimum(1 - self._here, size)
        nowhere = np.zeros(len(size))
        unit = max(float(np.abs(self._loss(nowhere)[1]).max()) * radius, 1e-300)
        constraints: list[NonlinearConstraint | LinearConstraint] = []
        if len(self._turns):
            constraints.append(LinearConstraint(self._turns, -np.inf, _TOWARD))
        if (fit := self._margins) is not None:
            floor = np.where(self.base.margins > 0, _MARGIN * self.base.margins, self.base.margins)

            def left(step: Array) -> Array:
                change, stds = fit.change(step)
                return (self.base.margins + change - stds - floor) / _SPEED

            def left_slope(step: Array) -> Array:
                mean, std = fit.change_slopes(step)
                return (mean - std) / _SPEED

            constraints.append(NonlinearConstraint(left, 0.0, np.inf, jac=left_slope))

        def expected(step: Array) -> tuple[float, Array]:
            loss, slope = self._loss(step)
            return loss / unit, slope / unit

        found = minimize(
            expected, nowhere, jac=True, bounds=Bounds(low, high), constraints=constraints, method="SLSQP",
            options={"maxiter": 60},
        )  # fmt: skip
        point = np.clip((self._here + np.clip(found.x, low, high)).round(DECIMALS), 0.0, 1.0)
        return np.where(size > 0, point, self._here)


def _apart(evaluation: Evaluation) -> tuple[Array, Array]:
    """The stage before the last two, with its weights, which has the parts of the loss one after another."""
    return evaluation.stages[max(len(evaluation.stages) - 3, 0)]


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
    return evaluation.margins.size > 0 and evaluation.loss >= _TURNED
