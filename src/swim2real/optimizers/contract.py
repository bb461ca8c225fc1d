"""The ask/tell contract: `ask()` gives a candidate, `tell()` takes its evaluation. With random search and a sequel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swimbase.arrays import Array
from swimbase.errors import OptimizerError


def cube_point(point: ArrayLike, dimension: int | None = None) -> Array:
    """A read-only copy of a point of the unit cube. Shape (d,).

    Raises:
        OptimizerError: Wrong length, not finite, or outside the cube.
    """
    copy = np.array(point, dtype=float)
    if copy.ndim != 1 or (dimension is not None and copy.size != dimension):
        raise OptimizerError(f"a point has shape {copy.shape}; expected ({dimension or 'd'},)")
    if not np.all((copy >= 0) & (copy <= 1)):
        raise OptimizerError(f"a point must lie in the unit cube, got coordinates from {copy.min()} to {copy.max()}")
    copy.flags.writeable = False
    return copy


def streams(seed: int) -> tuple[np.random.Generator, np.random.Generator, np.random.Generator]:
    """Independent random streams of a run: for the first point, the optimizer and the advisor.

    Raises:
        OptimizerError: The seed isn't a whole number from 0 on.
    """
    if isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0:
        raise OptimizerError(f"seed is {seed!r}; it must be a whole number from 0 on")
    first, optimizer, advisor = (np.random.default_rng(s) for s in np.random.SeedSequence(int(seed)).spawn(3))
    return first, optimizer, advisor


def first_point(dimension: int, seed: int) -> Array:
    """The first point of a run: depends on the seed alone, so every method starts at the same one. Shape (d,)."""
    return cube_point(streams(seed)[0].random(dimension))


@dataclass(frozen=True)
class Candidate:
    """A point to evaluate.

    Attributes:
        point: Point of the unit cube, read-only. Shape (d,).
        note: Where it comes from, for the record, ready for JSON.
    """

    point: Array
    note: Mapping[str, Any] = field(default_factory=dict[str, object])


@dataclass(frozen=True)
class Evaluation:
    """The loss of a candidate, and what else is known of it.

    Attributes:
        candidate: The candidate, as `ask()` gave it.
        loss: A finite number, lower is better.
        failed: True when there is no proper result, such as a simulation that diverged.
        detail: Further results, for advisors that can read them.
        residual: What a least-squares method drives to zero, for optimizers that ask for it; its squared norm is the
            mean over trials of the weighted mean squared distance. Shape (n,), the same n for all of a run.
        stages: The residual in the stages in which it can be lowered, each with the weights of its entries as they are
            here; empty where the evaluation failed or nobody asked. Shapes (n_k,) twice.
        parts: Trial, part and number of entries of what follows one another in the stage before the last two; empty
            where nobody knows.
        widths: Numbers of entries of the last two stages that make a distance each, of whose mean the loss is made;
            empty where all are one. Shape (G,).
        margins: What turns a trial around where it falls below 0, such as the speed of its first beats [m/s]; empty
            where nothing is known of it. Shape (F,).
    """

    candidate: Candidate
    loss: float
    failed: bool = False
    detail: Any = None
    residual: Array | None = None
    stages: tuple[tuple[Array, Array], ...] = ()
    margins: Array = field(default_factory=lambda: np.zeros(0))
    parts: tuple[tuple[str, str, int], ...] = ()
    widths: Array = field(default_factory=lambda: np.zeros(0, dtype=int))

    def __post_init__(self) -> None:
        if not np.isfinite(self.loss):
            raise OptimizerError(f"the loss is {self.loss}; a failed evaluation needs a finite one, too")


class Optimizer(ABC):
    """Proposes points of the unit cube and learns from their losses.

    Attributes:
        needs_residual: Whether tell() needs residuals; they aren't recorded, so resuming simulates again.
        conclusion: The reason why it is done, in words; empty as long as it isn't.
        gave_up: Whether that is no evidence, but the number of its evaluations.
    """

    needs_residual: bool = False
    conclusion: str = ""
    gave_up: bool = False

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension
        self._pending: Candidate | None = None

    def ask(self) -> Candidate:
        """The next candidate.

        Raises:
            OptimizerError: The last candidate's evaluation is missing.
        """
        if self._pending is not None:
            raise OptimizerError("ask() was called twice; tell() the evaluation of the last candidate first")
        candidate = self._next()
        cube_point(candidate.point, self.dimension)
        self._pending = candidate
        return candidate

    def tell(self, evaluation: Evaluation) -> None:
        """Takes the evaluation of the candidate that was asked last.

        Raises:
            OptimizerError: Nothing was asked, or it is another candidate's evaluation.
        """
        if self._pending is None:
            raise OptimizerError("tell() without a candidate; ask() for one first")
        if not np.array_equal(evaluation.candidate.point, self._pending.point):
            raise OptimizerError("tell() got the evaluation of another candidate than the one that was asked last")
        self._pending = None
        self._learn(evaluation)

    @property
    def done(self) -> bool:
        """Whether it expects to find nothing better, or has gone on for too long; evaluations alone decide it."""
        return bool(self.conclusion)

    @property
    def ends(self) -> Sequence[float]:
        """Losses at which descents from independent starts have come to their end."""
        return ()

    @property
    def left(self) -> int | None:
        """Evaluations that it probably needs until it is done; None for one that never is."""
        return None

    def upcoming(self) -> Sequence[Candidate]:
        """The candidates that come after the last one whatever its evaluation is, so that they may be made ahead."""
        return ()

    @abstractmethod
    def _next(self) -> Candidate: ...

    @abstractmethod
    def _learn(self, evaluation: Evaluation) -> None: ...


class RandomSearch(Optimizer):
    """The first point where one is given, then uniform samples of the unit cube."""

    def __init__(self, dimension: int, rng: np.random.Generator, first: Array | None = None) -> None:
        super().__init__(dimension)
        self._first = None if first is None else cube_point(first, dimension)
        self._rng = rng

    def _next(self) -> Candidate:
        if self._first is not None:
            point, self._first = self._first, None
            return Candidate(point, {"source": "first point"})
        return Candidate(cube_point(self._rng.random(self.dimension)), {"source": "random"})

    def _learn(self, evaluation: Evaluation) -> None:
        """Random search learns nothing."""


class Sequel(Optimizer):
    """One optimizer for its budget, then another one, which is made with the best point so far."""

    needs_residual = True

    def __init__(self, first: Optimizer, budget: int, then: Callable[[Array], Optimizer]) -> None:
        """Prepares both.

        Args:
            first: The optimizer that begins.
            budget: Its evaluations.
            then: Makes the other one from the best point. Shape (d,).
        """
        super().__init__(first.dimension)
        self._current, self._left, self._then = first, budget, then
        self._best: Evaluation | None = None

    @property
    def ends(self) -> Sequence[float]:
        return self._current.ends

    @property
    def left(self) -> int | None:
        return None if self._left else self._current.left

    def upcoming(self) -> Sequence[Candidate]:
        return () if self._left else self._current.upcoming()

    def _next(self) -> Candidate:
        return self._current.ask()

    def _learn(self, evaluation: Evaluation) -> None:
        self._current.tell(evaluation)
        if not self._left:
            self.conclusion, self.gave_up = self._current.conclusion, self._current.gave_up
            return
        self._left -= 1
        if not evaluation.failed and (self._best is None or evaluation.loss < self._best.loss):
            self._best = evaluation
        if not self._left:
            if self._best is None:
                raise OptimizerError("every evaluation so far has failed, so there is nothing to go on from")
            self._current = self._then(self._best.candidate.point)
