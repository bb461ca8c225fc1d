"""Descent on a linear model that interpolates a weighted residual at points around the best one.

The scheme of Cartis and Roberts, "A derivative-free Gauss-Newton method" (Math. Prog. Comp. 11, 2019): d + 1 evaluated
points, a Gauss-Newton step of the linear model through them, and points that keep them well spread. Weights are those
at the best point (iteratively reweighted least squares). The points carry every stage of the residual, so another stage
needs no new ones. DFO-LS, by the same authors, is under the GPL, has no weights, and evaluates one point at a time. All
sums over the residual are in one table of inner products.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, cube_point
from swim2real.optimizers.least_squares import lowest_within

_OPEN, _KNOWN = 0.3, 0.01  # per range: standard deviations of parameters that a stage doesn't determine, and at least
_GAIN = 0.02  # share of the squares that counts as one
_APART = 0.01  # of the trust: steps nearer to each other than this are the same
_LEAST_SHARE, _MOST_TRUST = 0.1, 0.5  # of the first radius that it shrinks to, and of a parameter's range
_PULL, _PULL_SHARE = 2e-3, 0.1  # per range, toward the middle; and no more than this share of the residual's length

Result = TypeVar("Result")
Search: TypeAlias = Generator[list[Candidate], list[Evaluation], Result]
"""Yields candidates, is sent their evaluations, and returns what it found."""


@dataclass(frozen=True)
class _Pace:
    """Patience of a descent.

    Attributes:
        patience: Pairs of points in a row without a gain that end it.
        shrink: Factor of the radius after a vain pair.
        trust_shrink: That of the trust.
    """

    patience: int
    shrink: float
    trust_shrink: float


PATIENT = _Pace(12, 0.9, 0.98)  # on rough ground, where the lie of the land shows from afar only
BRIEF = _Pace(8, 0.9, 0.98)
SMOOTH = _Pace(8, 0.7, 0.85)  # on what changes smoothly
EXACT = _Pace(6, 0.5, 0.7)  # to the bottom of what is smooth


def together(searches: Sequence[Search[Result]]) -> Search[list[Result]]:
    """Several searches at the same time, so that more candidates are known at once: their results, in order."""
    results: dict[int, Result] = {}
    told: dict[int, list[Evaluation] | None] = dict.fromkeys(range(len(searches)))
    while len(results) < len(searches):
        asked: dict[int, list[Candidate]] = {}
        for number, evaluations in told.items():
            try:
                asked[number] = searches[number].send(evaluations)  # pyright: ignore[reportArgumentType]
            except StopIteration as end:
                results[number] = end.value
        if asked:
            made = iter((yield [one for batch in asked.values() for one in batch]))
            told = {number: [next(made) for _ in batch] for number, batch in asked.items()}
    return [results[number] for number in range(len(searches))]


def surround(base: Evaluation, radius: float, note: Mapping[str, Any]) -> Search[Surrounded]:
    """Spreads points about one, each a share of one parameter's range away from it.

    Args:
        base: Evaluation of the one.
        radius: The share.
        note: What every candidate's note contains.
    """
    here = base.candidate.point
    sides = np.where(here <= 0.5, radius, -radius) * np.eye(here.size)
    around = yield [_candidate(here + side, "spread", note) for side in sides]
    return Surrounded(base, around, radius)


def go_down(
    points: Surrounded, stage: int, pace: _Pace, note: Mapping[str, Any], trust: float = 0.0
) -> Search[Evaluation]:
    """Lowers one stage of the residual, and returns the best evaluation.

    Args:
        points: Where to begin; they move along.
        stage: Index of the stage.
        pace: How fast it gives up.
        note: What every candidate's note contains.
        trust: Longest first step, as a share of each parameter's range; at least the radius of the points.
    """
    points.turn_to(stage)
    note, radius = {**note, "stage": stage + 1}, points.radius
    trust, least = max(trust, radius), _LEAST_SHARE * radius
    lowest, waited = points.squares[0], 0
    while waited < pace.patience and radius >= least:
        model = points.model()
        step, promised = model.step(trust)
        far, second = model.distances.max() > 2 * trust, model.step(trust / 3)[0]
        spreads = far or bool(np.abs(second - step).max() < _APART * trust)
        if spreads:
            second = model.spread(points.farthest(), max(trust / 2, radius) if far else radius)
        source = "spread" if spreads else "step"
        told = yield [_candidate(model.center + step, "step", note), _candidate(model.center + second, source, note)]
        before, ratio = points.squares[0], -1.0
        for one in told:
            if not one.failed:
                height, spread = squares(one, stage), one is told[1] and spreads
                ratio = max(ratio, (before - height) / promised)
                points.replace(points.farthest() if spread else points.superfluous(one, trust), one, height)
        if ratio < 0.1:
            trust = max(pace.trust_shrink * trust, radius)
            if not far and trust <= radius:
                radius *= pace.shrink
                trust = max(0.95 * trust, radius)
        elif ratio < 0.7:
            trust = max(pace.trust_shrink * trust, float(np.linalg.norm(step)), radius)
        else:
            trust = min(2 * trust, _MOST_TRUST)
        gained = points.squares[0] < (1 - _GAIN) * lowest
        lowest, waited = (points.squares[0], 0) if gained else (lowest, waited + 1)
    return points.best


def squares(evaluation: Evaluation, stage: int) -> float:
    """Sum of the weighted squares of a stage of an evaluation's residual."""
    residual, weights = evaluation.stages[stage]
    return float(np.einsum("n,n,n->", residual, residual, weights * weights))


def _candidate(point: Array, source: str, note: Mapping[str, Any]) -> Candidate:
    return Candidate(cube_point(np.clip(point, 0.0, 1.0)), {"source": source, **note})


class Surrounded:
    """d + 1 points, the lowest first, and the inner products of their residuals under the weights of the lowest.

    Attributes:
        radius: How far they were spread.
        squares: Sum of squares of each under its own weights, ascending. Shape (d + 1,).
    """

    def __init__(self, base: Evaluation, around: list[Evaluation], radius: float) -> None:
        self._members, self.radius = [base, *around], radius

    def turn_to(self, stage: int) -> None:
        """Sees one stage of the residual from now on."""
        self._stage = stage
        known = [one for one in self._members if not one.failed]
        self._instead = min(known, key=lambda one: squares(one, stage))  # of a point that failed, which teaches nothing
        self.squares = np.array([squares(self._instead if one.failed else one, stage) for one in self._members])
        self._weigh()

    @property
    def best(self) -> Evaluation:
        return self._instead if self._members[0].failed else self._members[0]

    def _weigh(self) -> None:
        """Sorts, and takes all inner products under the weights of the lowest."""
        order = np.argsort(self.squares, kind="stable")
        self._members, self.squares = [self._members[i] for i in order], self.squares[order]
        self._residuals = np.array([self._seen(one) for one in self._members])
        self._table = np.einsum("in,jn->ij", self._residuals, self._residuals)

    def _seen(self, evaluation: Evaluation) -> Array:
        residual, _ = (self._instead if evaluation.failed else evaluation).stages[self._stage]
        return residual * self.best.stages[self._stage][1]

    def model(self) -> _Model:
        places = np.array([one.candidate.point for one in self._members])
        inverse = np.linalg.pinv(places[1:] - places[0], rcond=1e-6)
        table = self._table
        changes = table[1:, 1:] - table[:1, 1:] - table[1:, :1] + table[0, 0]
        pull = min(_PULL**2, _PULL_SHARE**2 * float(table[0, 0]))
        curvature = np.einsum("ij,jk,lk->il", inverse, changes, inverse)
        slope = np.einsum("ij,j->i", inverse, table[1:, 0] - table[0, 0])
        return _Model(places, inverse, _firm(curvature, pull), slope + pull * (places[0] - 0.5))

    def alike(self, count: int, rng: np.random.Generator, note: Mapping[str, Any]) -> Search[list[Evaluation]]:
        """Random points that the stage hardly tells from the best one: normal, as the linear model leaves them open.

        Args:
            count: Of points.
            rng: Generator of the points.
            note: What every candidate's note contains.
        """
        model, size = self.model(), len(self.squares) - 1
        rest = max(float(self.squares[0]) / size, _KNOWN**2 * float(np.trace(model.curvature)) / size)
        precision = model.curvature / rest + np.eye(size) / _OPEN**2
        directions = np.linalg.solve(np.linalg.cholesky(precision).T, rng.standard_normal((size, count))).T
        return (yield [_candidate(model.center + step, "alike", note) for step in directions])

    def farthest(self) -> int:
        return 1 + int(np.argmax(self.model().distances))

    def superfluous(self, new: Evaluation, trust: float) -> int:
        """The one, the best left out, in whose place a new point leaves the points spread best."""
        model = self.model()
        share = np.abs(np.einsum("ij,i->j", model.inverse, new.candidate.point - model.center))
        return 1 + int(np.argmax(share * np.maximum(1.0, (model.distances / trust) ** 4)))

    def replace(self, index: int, new: Evaluation, height: float) -> None:
        self._members[index], self.squares[index] = new, height
        if self.squares[index] < self.squares[0]:
            self._weigh()
            return
        self._residuals[index] = self._seen(new)
        self._table[index] = self._table[:, index] = np.einsum("in,n->i", self._residuals, self._residuals[index])


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
