"""Stages: a few coordinates at a time, each by its own rule and its own score, as the prior work calibrated by hand.

The prior work [michelis2026simple] fits nine numbers one after the other: a stiffness by the spectrum of the sideways
motion, the motor's geometry on a grid, the fluid coefficients by Bayesian optimization of the loss. Here the same runs
under a budget: it knows the unit cube, and whoever composes it says which coordinates and scores a stage has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swimbase.errors import OptimizerError

Search = Callable[[int, np.random.Generator, Array], Optimizer]

_REFINED = 8  # evaluations at most that halve the gap beside a scan's best point; more are below any noise
_COARSE = 0.6  # of a scan's evaluations, on the even grid
_FINEST = 1e-3  # smallest gap that is halved
_TIE = 1e-9  # a difference of gaps that is rounding


@dataclass(frozen=True)
class Stage:
    """Some coordinates, how they are searched, and by which score.

    Attributes:
        name: Name in the record.
        coordinates: Indices of the coordinates in the unit cube.
        share: Share of the budget, relative to the other stages.
        rule: `scan`: all coordinates at one place, along an even grid that is then refined. `search`: each for itself,
            by an optimizer of the cube that they span.
        score: What is minimized, from an evaluation's detail; NaN where it isn't known. None is the loss.
    """

    name: str
    coordinates: tuple[int, ...]
    share: float
    rule: Literal["scan", "search"] = "search"
    score: Callable[[Any], float] | None = field(default=None, compare=False)

    def value(self, evaluation: Evaluation) -> float:
        """The evaluation's score; infinite when it failed or has no score."""
        if evaluation.failed:
            return float("inf")
        value = evaluation.loss if self.score is None else float(self.score(evaluation.detail))
        return value if np.isfinite(value) else float("inf")


class GridScan(Optimizer):
    """One coordinate: a place that is known, an even grid, then halves of the larger gap beside the best place."""

    def __init__(self, count: int, first: Array | None = None) -> None:
        """Prepares the scan.

        Args:
            count: Evaluations planned after the first; more may be asked for and refine further.
            first: Point that is evaluated before the grid. Shape (1,).
        """
        super().__init__(1)
        self._places = [] if first is None else [float(cube_point(first, 1)[0])]
        coarse = max(int(np.ceil(_COARSE * count)), count - _REFINED, 1)
        self._places += [(i + 0.5) / coarse for i in range(coarse)]
        self._seen: list[tuple[float, float]] = []

    def _next(self) -> Candidate:
        number = len(self._seen)
        return Candidate(cube_point([self._places[number] if number < len(self._places) else self._refined()]))

    def _refined(self) -> float:
        seen = sorted(self._seen)
        edges = np.array([0.0, *(place for place, _ in seen), 1.0])
        gaps = np.diff(edges)
        best = int(np.argmin([value for _, value in seen]))
        beside = best + int(gaps[best + 1] > gaps[best] + _TIE)
        widest = beside if gaps[beside] > _FINEST else int(np.argmax(gaps))
        return float((edges[widest] + edges[widest + 1]) / 2)

    def _learn(self, evaluation: Evaluation) -> None:
        value = float("inf") if evaluation.failed else evaluation.loss
        self._seen.append((float(evaluation.candidate.point[0]), value))


class Staged(Optimizer):
    """The first point, then stage after stage; each begins where the one before found its best score.

    Coordinates of later stages keep the first point's values until their turn. The last stage may go on beyond the
    budget.
    """

    def __init__(
        self, first: Array, stages: Sequence[Stage], budget: int, search: Search, rng: np.random.Generator,
        held: Mapping[int, float] | None = None,
    ) -> None:  # fmt: skip
        """Prepares the stages.

        Args:
            first: First point of the run. Shape (d,).
            stages: Stages in order.
            budget: Evaluations that the shares are taken of, the first point included.
            search: Function that makes the optimizer of a `search` stage from its dimension, generator and first point.
            rng: Generator that `search` is given.
            held: Coordinates that no stage moves and the value that they have from the second evaluation on; others
                that no stage moves keep the first point's.

        Raises:
            OptimizerError: A setting is out of range, or a coordinate is both held and searched.
        """
        super().__init__(len(first))
        self._first, self._stages = cube_point(first), tuple(stages)
        self._search, self._rng = search, rng
        self._check(budget, held or {})
        start = self._first.copy()
        for i, value in (held or {}).items():
            start[i] = value
        self._point = cube_point(start, self.dimension)
        self.counts = _counts([stage.share for stage in stages], budget - 1)
        self._number = self._done = 0
        self._first_evaluated = False
        self._at_point: Evaluation | None = None
        self._inner: Optimizer | None = None
        self._inner_candidate: Candidate | None = None
        self._best: tuple[float, Evaluation] | None = None

    def _check(self, budget: int, held: Mapping[int, float]) -> None:
        if budget < 1:
            raise OptimizerError(f"budget is {budget}; it must be at least 1")
        if not self._stages:
            raise OptimizerError("there are no stages; give at least one")
        for stage in self._stages:
            if not stage.coordinates or len(set(stage.coordinates)) < len(stage.coordinates):
                raise OptimizerError(f"stage '{stage.name}' has coordinates {stage.coordinates}; give some, each once")
            if not (np.isfinite(stage.share) and stage.share > 0):
                raise OptimizerError(f"stage '{stage.name}' has a share of {stage.share}; it must be above 0")
            both = sorted(set(stage.coordinates) & set(held))
            if both:
                raise OptimizerError(f"stage '{stage.name}' moves coordinate {both[0]}, which is held")
        used = {*held, *(i for stage in self._stages for i in stage.coordinates)}
        outside = sorted(i for i in used if not 0 <= i < self.dimension)
        if outside:
            raise OptimizerError(f"coordinate {outside[0]} is none of the cube's; there are 0 to {self.dimension - 1}")

    @property
    def _stage(self) -> Stage:
        return self._stages[self._number]

    def _next(self) -> Candidate:
        if not self._first_evaluated:
            return Candidate(self._first, {"source": "first point"})
        last = len(self._stages) - 1
        while self._number < last and self._done >= self.counts[self._number]:
            self._finish()
        if self._inner is None:
            self._begin()
        inner = self._inner
        if inner is None:
            raise OptimizerError("a stage has no optimizer")
        self._inner_candidate = inner.ask()
        note = {"source": f"stage {self._stage.name}", "stage": self._stage.name}
        return Candidate(self._composed(self._inner_candidate), note)

    def _begin(self) -> None:
        """Starts the stage's own search, which learns what is known of the point where it starts."""
        stage, count = self._stage, self.counts[self._number]
        start = self._point[list(stage.coordinates)]
        together = stage.rule == "scan"
        if together:
            known = self._at_point is not None and bool(np.all(start == start[0]))
            self._inner = GridScan(count, start[:1] if known else None)
        else:
            known = self._at_point is not None
            self._inner = self._search(len(start), self._rng, cube_point(start))
        if not known or self._at_point is None:
            return
        candidate = self._inner.ask()
        if not np.array_equal(self._composed(candidate), self._point):
            raise OptimizerError(f"the search of stage '{stage.name}' must begin at the point that it is given")
        self._tell(candidate, self._at_point)

    def _composed(self, inner: Candidate) -> Array:
        point = self._point.copy()
        point[list(self._stage.coordinates)] = inner.point  # a scan's one value goes to all
        return cube_point(point)

    def _learn(self, evaluation: Evaluation) -> None:
        if not self._first_evaluated:
            self._first_evaluated = True
            if np.array_equal(evaluation.candidate.point, self._point):
                self._at_point = evaluation
            return
        if self._inner_candidate is None:
            raise OptimizerError("a stage got an evaluation without a candidate")
        self._tell(self._inner_candidate, evaluation)
        self._done += 1

    def _tell(self, candidate: Candidate, evaluation: Evaluation) -> None:
        """Passes an evaluation on to the stage's search, with the stage's score as its loss."""
        value = self._stage.value(evaluation)
        failed = not np.isfinite(value)
        if self._inner is not None:
            self._inner.tell(Evaluation(candidate, evaluation.loss if failed else value, failed, evaluation.detail))
        if not failed and (self._best is None or value < self._best[0]):
            self._best = (value, evaluation)

    def _finish(self) -> None:
        """Goes on to the next stage, from the best of this one."""
        if self._best is not None:
            self._at_point = self._best[1]
            self._point = cube_point(self._at_point.candidate.point)
        self._number, self._done = self._number + 1, 0
        self._inner = self._inner_candidate = self._best = None


def _counts(shares: Sequence[float], total: int) -> tuple[int, ...]:
    """Whole numbers in the ratio of the shares that add up to the total."""
    ends = np.round(total * np.cumsum(shares) / np.sum(shares)).astype(int)
    return tuple(int(n) for n in np.diff(ends, prepend=0))
