"""Least squares in stages from several starts: what is smooth comes first, what turns a trial around comes last.

Sums over the residual avoid BLAS, whose order of summation hangs on the number of threads.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np

from swim2real.errors import OptimizerError
from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swim2real.optimizers.least_squares import lowest_within

_DIFFERENCE = 0.01  # of a parameter's range, of the forward differences
_PULL, _PULL_SHARE = 2e-3, 0.2  # per range, toward the middle; and no more than this share of the residual's length
_DAMPINGS = (1 / 30, 1 / 3, 3.0, 30.0)  # multiples of the last damping that are tried
_STEPS = ((1.0, 1.0), (0.5, 0.1))  # length and pull of the steps that are tried with each damping
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 0.1, 1e-5, 1e3
_RADIUS = 0.5  # of the range, the farthest that a parameter goes in one step
_STEEP = 4.0  # a difference that raises the squares by this factor may have crossed a border: the other side is tried
_GAIN, _LAST_GAIN = 0.03, 0.01  # share of the residual's length below which a stage has ended; of the last stage
_ITERATIONS, _LAST_ITERATIONS = 6, 20  # of a stage, at most

Search = Generator[Candidate, Evaluation, None]


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
        self._search = self._run()
        self._last: Evaluation | None = None

    def _next(self) -> Candidate:
        return next(self._search) if self._last is None else self._search.send(self._last)

    def _learn(self, evaluation: Evaluation) -> None:
        if not evaluation.stages and not evaluation.failed:
            raise OptimizerError("tell() got an evaluation without stages of its residual, which multi-start needs")
        self._last = evaluation

    def _run(self) -> Search:
        begun: list[Evaluation] = []
        for number, point in enumerate(self._starts, 1):
            note = {"source": "start", "start": number} if number > 1 else {"source": "first point"}
            begun.append((yield Candidate(point, note)))
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
            evaluation = yield Candidate(point, {"source": "start", "start": number})
            if not evaluation.failed:
                yield from self._descend(evaluation, number)

    def _descend(self, base: Evaluation, start: int) -> Search:
        for stage in range(len(base.stages)):
            base = yield from self._stage(base, stage, start)

    def _stage(self, base: Evaluation, stage: int, start: int) -> Generator[Candidate, Evaluation, Evaluation]:
        last, damping, poor = stage == len(base.stages) - 1, _FIRST_DAMPING, 0
        for _ in range(_LAST_ITERATIONS if last else _ITERATIONS):
            before = _squares(base, stage)
            base, damping = yield from self._iteration(base, stage, damping, start)
            gained = 1 - np.sqrt(_squares(base, stage) / before)
            poor = poor + 1 if gained < (_LAST_GAIN if last else _GAIN) else 0
            if poor > last:  # the last stage has a second try, with more damping
                break
        return base

    def _iteration(
        self, base: Evaluation, stage: int, damping: float, start: int
    ) -> Generator[Candidate, Evaluation, tuple[Evaluation, float]]:
        """The best of the differences and steps from a point, or the point itself, and the damping to go on with."""
        here, residual, squares = base.candidate.point, base.stages[stage], _squares(base, stage)
        note = {"start": start, "stage": stage + 1}
        gradients, best = np.zeros((self.dimension, residual.size)), base
        for k in range(self.dimension):
            inward = _DIFFERENCE if here[k] <= 0.5 else -_DIFFERENCE
            sides: list[tuple[float, Evaluation]] = []
            for change in (inward, -inward):
                if not 0 <= here[k] + change <= 1:
                    continue
                point = np.array(here)
                point[k] += change
                evaluation = yield Candidate(cube_point(point), {"source": "difference", "parameter": k, **note})
                if not evaluation.failed:
                    sides.append((change, evaluation))
                    best = min(best, evaluation, key=lambda one: _squares(one, stage))
                    if _squares(evaluation, stage) < _STEEP * squares:
                        break
            gradients[k] = _slope(sides, base, stage)
        pull, found = min(_PULL, _PULL_SHARE * float(np.sqrt(squares))), damping
        for factor in _DAMPINGS:
            for length, share in _STEPS:
                step = damped_step(gradients, residual, here, factor * damping, share * pull)
                point = cube_point(np.clip(here + length * step, 0.0, 1.0))
                evaluation = yield Candidate(point, {"source": "step", "damping": factor * damping, **note})
                if not evaluation.failed and _squares(evaluation, stage) < _squares(best, stage):
                    best, found = evaluation, factor * damping
        damping = 10 * damping if best is base else found
        return best, float(np.clip(damping, _LEAST_DAMPING, _MOST_DAMPING))


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


def _slope(sides: Sequence[tuple[float, Evaluation]], base: Evaluation, stage: int) -> Array:
    """Change of the residual with a parameter: from the side that is not steep, or from both where both are. (n,)."""
    if not sides:
        return np.zeros_like(base.stages[stage])
    change, evaluation = sides[-1]
    if len(sides) == 1 or _squares(evaluation, stage) < _STEEP * _squares(base, stage):
        return (evaluation.stages[stage] - base.stages[stage]) / change
    other_change, other = sides[0]
    return (evaluation.stages[stage] - other.stages[stage]) / (change - other_change)


def _squares(evaluation: Evaluation, stage: int) -> float:
    residual = evaluation.stages[stage]
    return float(np.einsum("n,n->", residual, residual))
