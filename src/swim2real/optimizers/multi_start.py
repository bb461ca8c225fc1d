"""Least squares in stages from several starts: what is smooth comes first, what turns a trial around comes last.

Sums over the residual avoid BLAS, whose order of summation hangs on the number of threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Mapping, Sequence
from typing import Any

import numpy as np

from swim2real.errors import OptimizerError
from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swim2real.optimizers.interpolated_descent import descend
from swim2real.optimizers.least_squares import lowest_within

_DIFFERENCE = 0.01  # of a parameter's range, of the forward differences
_PULL, _PULL_SHARE = 2e-3, 0.2  # per range, toward the middle; and no more than this share of the residual's length
_DAMPINGS = (0.1, 1.0, 10.0)  # multiples of the last damping that are tried
_STEPS = ((1.0, 1.0), (0.5, 0.1))  # length and pull of the steps that are tried with each damping
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 0.1, 1e-5, 1e3
_RADIUS = 0.5  # of the range, the farthest that a parameter goes in one step
_STEEP = 4.0  # a difference that raises the squares by this factor may have crossed a border: the other side is tried
_GAIN = 0.03  # share of the residual's length below which a stage has ended
_ITERATIONS = 6  # of a stage, at most

_AGREEING, _MOST_ENDS = 2, 6  # ends that agree with the best, and descents in all, after which a search is done
AGREEMENT = 0.1  # of the lowest loss, within which ends agree

Search = Generator[list[Candidate], list[Evaluation], None]


class MultiStart(Optimizer):
    """Goes down from several starts, best first, by Levenberg-Marquardt on one stage of the residual after the other.

    A problem gives its residual in stages (`Comparison.residual_stages`): the shape of the motion alone, then with
    recoil and a bounded share of the way that it has come, then everything. All starts are evaluated first and ranked
    by the last but one stage, in which a trial gone the wrong way hides nothing. Each iteration takes a Jacobian by
    differences, on the other side where one is steep, and tries eight steps: four dampings, each at full length and at
    half of it. A weak pull to the middle of the cube, nearly none at half length, keeps parameters that the trials
    don't tell off their bounds. When no start is left, new ones are random.
    """

    needs_residual = True

    def __init__(self, starts: Sequence[Array], rng: np.random.Generator) -> None:
        """Prepares the search.

        Args:
            starts: Points to begin from, the run's first point first. Shapes (d,).
            rng: Generator of further starts.

        Raises:
            OptimizerError: There is no start.
        """
        if not starts:
            raise OptimizerError("starts is empty; give one point at least")
        super().__init__(len(starts[0]))
        self._starts, self._rng = [cube_point(start, self.dimension) for start in starts], rng
        self._search, self._ends = self._run(), list[float]()
        self._batch: deque[Candidate] = deque()
        self._told: list[Evaluation] = []

    def upcoming(self) -> Sequence[Candidate]:
        return tuple(self._batch)

    def _next(self) -> Candidate:
        if not self._batch:
            self._batch.extend(self._search.send(self._told) if self._told else next(self._search))
            self._told = []
        return self._batch.popleft()

    def _learn(self, evaluation: Evaluation) -> None:
        if not evaluation.stages and not evaluation.failed:
            raise OptimizerError("tell() got an evaluation without stages of its residual, which multi-start needs")
        self._told.append(evaluation)

    def _run(self) -> Search:
        first, *others = self._starts
        starts = [Candidate(point, {"source": "start", "start": number}) for number, point in enumerate(others, 2)]
        begun = yield [Candidate(first, {"source": "first point"}), *starts]
        ranked = sorted(
            (number for number, one in enumerate(begun) if not one.failed),
            key=lambda number: _squares(begun[number], max(len(begun[number].stages) - 2, 0)),
        )
        for number in ranked:
            yield from self._descend(begun[number], number + 1)
        number = len(begun)
        while True:
            number += 1
            point = cube_point(self._rng.random(self.dimension))
            (evaluation,) = yield [Candidate(point, {"source": "start", "start": number})]
            if not evaluation.failed:
                yield from self._descend(evaluation, number)

    def _descend(self, base: Evaluation, start: int) -> Search:
        last = len(base.stages) - 1
        for stage in range(max(last, 1)):
            base = yield from self._stage(base, stage, start)
        end = yield from descend(base, last, self._rng, {"start": start, "stage": last + 1})
        self._ends.append(end.loss)
        self.done = agreeing(self._ends) >= _AGREEING or len(self._ends) >= _MOST_ENDS

    def _stage(
        self, base: Evaluation, stage: int, start: int
    ) -> Generator[list[Candidate], list[Evaluation], Evaluation]:
        damping = _FIRST_DAMPING
        for _ in range(_ITERATIONS):
            before = _squares(base, stage)
            base, damping = yield from self._iteration(base, stage, damping, start)
            if _squares(base, stage) > (1 - _GAIN) ** 2 * before:
                break
        return base

    def _iteration(
        self, base: Evaluation, stage: int, damping: float, start: int
    ) -> Generator[list[Candidate], list[Evaluation], tuple[Evaluation, float]]:
        """The best of the differences and steps from a point, or the point itself, and the damping to go on with."""
        here, residual, squares = base.candidate.point, base.stages[stage], _squares(base, stage)
        note = {"start": start, "stage": stage + 1}
        inward = np.where(here <= 0.5, _DIFFERENCE, -_DIFFERENCE)
        there = yield [_shifted(here, k, inward[k], note) for k in range(self.dimension)]
        steep = [k for k, one in enumerate(there) if one.failed or _squares(one, stage) >= _STEEP * squares]
        steep = [k for k in steep if 0 <= here[k] - inward[k] <= 1]
        back = (yield [_shifted(here, k, -inward[k], note) for k in steep]) if steep else []
        other_side = dict(zip(steep, back, strict=True))
        gradients = np.array([_slope(base, [one, other_side.get(k)], k, stage) for k, one in enumerate(there)])
        pull, dampings = min(_PULL, _PULL_SHARE * float(np.sqrt(squares))), [factor * damping for factor in _DAMPINGS]
        tried = [
            (damped_step(gradients, residual, here, one, share * pull), length, one)
            for one in dampings
            for length, share in _STEPS
        ]
        steps = yield [
            Candidate(cube_point(np.clip(here + length * step, 0.0, 1.0)), {"source": "step", "damping": one, **note})
            for step, length, one in tried
        ]
        best = min(
            (one for one in [base, *there, *back, *steps] if not one.failed), key=lambda one: _squares(one, stage)
        )
        damping = 10 * damping if best is base else best.candidate.note.get("damping", damping)
        return best, float(np.clip(damping, _LEAST_DAMPING, _MOST_DAMPING))


def _shifted(point: Array, k: int, change: float, note: Mapping[str, Any]) -> Candidate:
    moved = np.array(point)
    moved[k] += change
    return Candidate(cube_point(moved), {"source": "difference", "parameter": k, **note})


def agreeing(ends: Sequence[float]) -> int:
    """How many descents ended within a tenth of the best one's loss, that one included."""
    return sum(end <= (1 + AGREEMENT) * min(ends) for end in ends)


def damped_step(gradients: Array, residual: Array, point: Array, damping: float, pull: float) -> Array:
    """The Levenberg-Marquardt step within the cube, with a pull toward its middle. Shape (d,).

    Args:
        gradients: Gradients of the residual, by coordinate. Shape (d, n).
        residual: Residual at the point. Shape (n,).
        point: Point of the unit cube. Shape (d,).
        damping: Share of each coordinate's own curvature that is added.
        pull: What the way over a coordinate's whole range adds to the residual.
    """
    dimension = point.size
    curvature = np.einsum("in,jn->ij", gradients, gradients) + pull**2 * np.eye(dimension)
    slope = np.einsum("in,n->i", gradients, residual) + pull**2 * (point - 0.5)
    diagonal = np.diag(curvature)
    scale = float(diagonal.sum()) / dimension
    if scale == 0:
        return np.zeros(dimension)
    damped = curvature + damping * np.diag(diagonal + 1e-6 * scale) + 1e-12 * scale * np.eye(dimension)
    bounds = (np.maximum(-point, -_RADIUS) - 1e-12, np.minimum(1 - point, _RADIUS) + 1e-12)
    return lowest_within(damped, slope, bounds)


def _slope(base: Evaluation, sides: Sequence[Evaluation | None], k: int, stage: int) -> Array:
    """Change of the residual with a parameter: from the side that is not steep, or from both where both are. (n,)."""
    known = [one for one in sides if one is not None and not one.failed]
    if not known:
        return np.zeros_like(base.stages[stage])
    last, other = known[-1], base
    if len(known) == 2 and _squares(last, stage) >= _STEEP * _squares(base, stage):
        other = known[0]
    change = float(last.candidate.point[k] - other.candidate.point[k])
    return (last.stages[stage] - other.stages[stage]) / change


def _squares(evaluation: Evaluation, stage: int) -> float:
    residual = evaluation.stages[stage]
    return float(np.einsum("n,n->", residual, residual))
