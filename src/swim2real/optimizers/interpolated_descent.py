"""Descent on a linear model that interpolates the residual, wide enough for what is rough, with hops out of dead ends.

The scheme of Cartis and Roberts, "A derivative-free Gauss-Newton method" (Math. Prog. Comp. 11, 2019): d + 1 evaluated
points, a Gauss-Newton step of the linear model through them, and points that keep them well spread. As in their DFO-LS
for noisy residuals the radius shrinks slowly, and a search that gains nothing leaves its best point. DFO-LS itself is
under the GPL, and evaluates one point at a time. All sums over the residual are in one table of inner products.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, cube_point
from swim2real.optimizers.least_squares import lowest_within

_RADIUS, _LEAST_RADIUS, _MOST_TRUST = 0.1, 0.01, 0.5  # of a parameter's range
_SHRINK, _TRUST_SHRINK = 0.9, 0.98
_PULL, _PULL_SHARE = 2e-3, 0.1  # per range, toward the middle; and no more than this share of the residual's length
_PATIENCE, _GAIN = 12, 0.02  # pairs of points in a row without this gain, as a share of the squares, before a hop
_HOP, _SPREADS = 0.2, 3  # length of a hop in the cube; points that are spread anew after it
_HOPS = 5  # in a row without a gain, before the descent ends

Search = Generator[list[Candidate], list[Evaluation], Evaluation]


def descend(base: Evaluation, stage: int, rng: np.random.Generator, note: Mapping[str, Any]) -> Search:
    """Goes down from a point until hops gain nothing, and returns the best evaluation.

    Args:
        base: Where to begin.
        stage: Stage of the residual that is lowered.
        rng: Generator of the hops.
        note: What every candidate's note contains.
    """
    here = base.candidate.point
    sides = np.where(here <= 0.5, _RADIUS, -_RADIUS) * np.eye(here.size)
    around = yield [_candidate(here + side, "spread", note) for side in sides]
    points, best, vain = _Points(base, around, stage), base, 0
    while vain < _HOPS:
        lowest = yield from _go_down(points, note)
        gained = points.squares_of(lowest) < (1 - _GAIN) * points.squares_of(best)
        vain = 0 if gained else vain + 1
        best = min(best, lowest, key=points.squares_of)
        yield from _hop(points, rng, note)
    return best


def _go_down(points: _Points, note: Mapping[str, Any]) -> Search:
    radius = trust = _RADIUS
    lowest, waited = points.best, 0
    while waited < _PATIENCE and radius >= _LEAST_RADIUS:
        model = points.model()
        step, promised = model.step(trust)
        far = model.distances.max() > 2 * trust
        second = model.spread(points.farthest(), max(trust / 2, radius)) if far else model.step(trust / 3)[0]
        source = "spread" if far else "step"
        told = yield [_candidate(model.center + step, "step", note), _candidate(model.center + second, source, note)]
        before, ratio = points.squares[0], -1.0
        for one in told:
            if not one.failed:
                ratio = max(ratio, (before - points.squares_of(one)) / promised)
                spread = one is told[1] and far
                points.replace(points.farthest() if spread else points.superfluous(one, trust), one)
        if ratio < 0.1:
            trust = max(_TRUST_SHRINK * trust, radius)
            if not far and trust <= radius:
                radius *= _SHRINK
                trust = max(0.95 * trust, radius)
        elif ratio < 0.7:
            trust = max(_TRUST_SHRINK * trust, float(np.linalg.norm(step)), radius)
        else:
            trust = min(2 * trust, _MOST_TRUST)
        gained = points.squares[0] < (1 - _GAIN) * points.squares_of(lowest)
        lowest, waited = (points.best, 0) if gained else (lowest, waited + 1)
    return min(lowest, points.best, key=points.squares_of)


def _hop(points: _Points, rng: np.random.Generator, note: Mapping[str, Any]) -> Generator[Any, Any, None]:
    """Leaves the best point, the farther along a direction the less it changes the residual, and spreads points."""
    model = points.model()
    steepness, directions = np.linalg.eigh(model.curvature)
    way = directions @ (rng.standard_normal(len(steepness)) / np.sqrt(steepness + 0.05 * steepness[-1]))
    (told,) = yield [_candidate(model.center + _HOP * way / np.linalg.norm(way), "hop", note)]
    if not told.failed:
        points.replace(0, told)
    for _ in range(_SPREADS):
        way = points.model().spread(points.farthest(), _RADIUS)
        (told,) = yield [_candidate(points.best.candidate.point + way, "spread", note)]
        if not told.failed:
            points.replace(points.farthest(), told)


def _candidate(point: Array, source: str, note: Mapping[str, Any]) -> Candidate:
    return Candidate(cube_point(np.clip(point, 0.0, 1.0)), {"source": source, **note})


class _Points:
    """d + 1 points, the lowest first, with their residuals and the table of inner products of these.

    Attributes:
        best: The first.
        squares: Squared length of each residual, ascending. Shape (d + 1,).
    """

    def __init__(self, base: Evaluation, around: list[Evaluation], stage: int) -> None:
        self._stage = stage
        self._members = [base, *around]
        # a point that failed teaches nothing: it has the residual of the base
        self._residuals = np.array([(base if one.failed else one).stages[stage] for one in self._members])
        self._table = np.einsum("in,jn->ij", self._residuals, self._residuals)
        self._sort()

    @property
    def best(self) -> Evaluation:
        return self._members[0]

    @property
    def squares(self) -> Array:
        return np.diag(self._table)

    def squares_of(self, evaluation: Evaluation) -> float:
        residual = evaluation.stages[self._stage]
        return float(np.einsum("n,n->", residual, residual))

    def model(self) -> _Model:
        places = np.array([one.candidate.point for one in self._members])
        inverse = np.linalg.pinv(places[1:] - places[0], rcond=1e-6)
        table = self._table
        changes = table[1:, 1:] - table[:1, 1:] - table[1:, :1] + table[0, 0]
        pull = min(_PULL**2, _PULL_SHARE**2 * float(table[0, 0]))
        curvature = np.einsum("ij,jk,lk->il", inverse, changes, inverse)
        slope = np.einsum("ij,j->i", inverse, table[1:, 0] - table[0, 0])
        return _Model(places, inverse, _firm(curvature, pull), slope + pull * (places[0] - 0.5))

    def farthest(self) -> int:
        return 1 + int(np.argmax(self.model().distances))

    def superfluous(self, new: Evaluation, trust: float) -> int:
        """The one, the best left out, in whose place a new point leaves the points spread best."""
        model = self.model()
        share = np.abs(np.einsum("ij,i->j", model.inverse, new.candidate.point - model.center))
        return 1 + int(np.argmax(share * np.maximum(1.0, (model.distances / trust) ** 4)))

    def replace(self, index: int, new: Evaluation) -> None:
        self._members[index], self._residuals[index] = new, new.stages[self._stage]
        self._table[index] = self._table[:, index] = np.einsum("in,n->i", self._residuals, self._residuals[index])
        self._sort()

    def _sort(self) -> None:
        order = np.argsort(self.squares, kind="stable")
        self._members = [self._members[i] for i in order]
        self._residuals, self._table = self._residuals[order], self._table[np.ix_(order, order)]


class _Model:
    """The linear model of the residual around the best point: its squares change by quadratic terms.

    Attributes:
        center: The best point. Shape (d,).
        distances: Of the others. Shape (d,).
        inverse: Gradients, by column, of the linear functions that are 1 at one of the others, 0 at the rest. (d, d).
        curvature: Shape (d, d).
        slope: Shape (d,).
    """

    def __init__(self, places: Array, inverse: Array, curvature: Array, slope: Array) -> None:
        self.center, self.inverse, self.curvature, self.slope = places[0], inverse, curvature, slope
        self.distances = np.sqrt(np.square(places[1:] - places[0]).sum(axis=1))

    def step(self, trust: float) -> tuple[Array, float]:
        """The step within a box, and the cube, at which the model is lowest; and what it promises to gain."""
        least, most = np.maximum(-self.center, -trust) - 1e-12, np.minimum(1 - self.center, trust) + 1e-12
        step = lowest_within(self.curvature, self.slope, (least, most))
        return step, max(-self.change(step), 1e-300)

    def spread(self, index: int, length: float) -> Array:
        """A step after which a point, in the place of the one with this index, leaves the points well spread."""
        gradient = self.inverse[:, index - 1]
        way = length * gradient / max(float(np.linalg.norm(gradient)), 1e-12)
        both = [np.clip(self.center + sign * way, 0.0, 1.0) - self.center for sign in (1, -1)]
        room = [abs(float(np.einsum("i,i->", gradient, one))) for one in both]
        return min(both, key=self.change) if min(room) > 0.5 * max(room) else both[int(np.argmax(room))]

    def change(self, step: Array) -> float:
        """Change of the squares that the model sees in a step."""
        return float(np.einsum("i,i->", 2 * self.slope + np.einsum("ij,j->i", self.curvature, step), step))


def _firm(curvature: Array, pull: float) -> Array:
    """Positive definite."""
    return curvature + (pull + 1e-9 * float(np.trace(curvature)) / len(curvature) + 1e-18) * np.eye(len(curvature))
