"""Drives optimizers by a function or by given losses; an advisor that keeps what it was shown."""

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from swim2real.optimizers import Evaluation, Optimizer, ScriptedAdvisor, Situation


def bowl(point: np.ndarray) -> float:
    return float(np.square(point - 0.3).sum())


def answered(optimizer: Optimizer, count: int, answer: Callable[..., Evaluation]) -> list[Evaluation]:
    """Evaluations by `answer`, a function of number and candidate."""
    told = []
    for i in range(count):
        told.append(answer(i, optimizer.ask()))
        optimizer.tell(told[-1])
    return told


def drive(
    optimizer: Optimizer, count: int, loss: Callable[[np.ndarray], Any] = bowl,
    failed: Callable[[int], bool] = lambda i: False, worst: float = 1.0,
) -> list[Evaluation]:  # fmt: skip
    """Evaluations by a loss, or by a vector of residuals, as a function of the point; those that fail have `worst`."""

    def answer(i, candidate):
        value = np.atleast_1d(loss(candidate.point))
        if failed(i):
            return Evaluation(candidate, worst, True, residual=np.ones(value.size))
        length = float(value[0] if value.size == 1 else np.linalg.norm(value))
        return Evaluation(candidate, length, residual=value, stages=staged(value))

    return answered(optimizer, count, answer)


def staged(*residuals: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Stages of a residual in which every entry counts the same."""
    return tuple((one, np.ones_like(one)) for one in residuals)


def feed(optimizer: Optimizer, losses: Sequence[float], failed: Collection[int] = ()) -> list[Evaluation]:
    """Tells losses in turn."""
    return answered(optimizer, len(losses), lambda i, asked: Evaluation(asked, losses[i], i in failed, {"number": i}))


def points(told: Sequence[Evaluation]) -> np.ndarray:
    return np.array([one.candidate.point for one in told])


def notes(told: Sequence[Evaluation], key: str | None = None) -> list[Any]:
    """Notes of the candidates, or what they have under a key."""
    return [one.candidate.note if key is None else one.candidate.note.get(key) for one in told]


def lowest(told: Sequence[Evaluation]) -> float:
    return min(one.loss for one in told)


class Watching(ScriptedAdvisor):
    """A scripted advisor that keeps what it was shown."""

    def __init__(self, advice):
        super().__init__(advice)
        self.shown: list[Situation] = []

    def propose(self, situation):
        self.shown.append(situation)
        return super().propose(situation)
