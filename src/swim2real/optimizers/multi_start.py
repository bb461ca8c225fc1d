"""Least squares in stages from several starts: what is smooth comes first, what turns a trial around comes last."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from itertools import count

import numpy as np

from swim2real.errors import OptimizerError
from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swim2real.optimizers.interpolated_descent import BRIEF, EXACT, PATIENT, Surrounded, go_down, squares, surround

_GROUP = 4  # starts that are gone down from, before the best of them is followed to its end
_START_RADIUS, _WIDE_RADIUS, _CLOSE_RADIUS = 0.05, 0.1, 0.02  # of a parameter's range
_ROUNDS = 2  # of points, by which the stage before the last eased one is lowered
_WORTHWHILE = 0.95  # share of the loss to which going the way from an end again must lower it, to be repeated
_AGREEING, _MOST_ENDS = 3, 6  # ends that agree with the best, and ends in all, after which a search is done
AGREEMENT = 0.1  # of the lowest loss, within which ends agree

Search = Generator[list[Candidate], list[Evaluation], None]


class MultiStart(Optimizer):
    """Goes down from several starts, best first, on one stage of the residual after the other.

    A problem gives its residual in stages (`Comparison.residual_stages`). Those before the last two are eased: the
    motion of the body alone, then with a bounded share of the way that it has come, so that a trial gone the wrong way
    hides nothing. All starts are evaluated first. Groups of them, the best first, go down through eased stages, in turn
    through the last of these alone and from the one before on. The best of a group is followed to its end: the whole
    residual on points far apart, which see past what is rough, then the last stage on points close together. From the
    best end of all the way is gone again, as long as that lowers it. When no start is left, new ones are random.
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
        self._search, self._followed = self._run(), dict[int, Evaluation]()
        self._batch: deque[Candidate] = deque()
        self._told: list[Evaluation] = []

    @property
    def ends(self) -> Sequence[float]:
        return [one.loss for one in self._followed.values()]

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
        waiting, fresh = {number: one for number, one in enumerate(begun, 1) if not one.failed}, count(len(begun) + 1)
        eased = 1
        while True:
            followed: list[tuple[int, Surrounded]] = []
            while len(followed) < _GROUP:
                if not waiting:
                    yield from self._random_start(next(fresh), waiting)
                    continue
                eased = max(len(next(iter(waiting.values())).stages) - 2, 1)
                begin = max(eased - 1 - len(followed) % 2, 0)
                number = min(waiting, key=lambda number: squares(waiting[number], begin))
                base, note = waiting.pop(number), {"start": number}
                for _ in range(begin, eased - 1):
                    for _ in range(_ROUNDS):
                        points = yield from surround(base, _START_RADIUS, note)
                        base = yield from go_down(points, begin, EXACT, note, _WIDE_RADIUS)
                points = yield from surround(base, _START_RADIUS, note)
                yield from go_down(points, eased - 1, BRIEF, note, _WIDE_RADIUS)
                followed.append((number, points))
            number, points = min(followed, key=lambda one: one[1].squares[0])
            self._followed[number] = yield from self._to_the_end(points, number)
            yield from self._repeat()
            self.done = agreeing(self.ends) >= _AGREEING or len(self.ends) >= _MOST_ENDS

    def _random_start(self, number: int, waiting: dict[int, Evaluation]) -> Search:
        point = cube_point(self._rng.random(self.dimension))
        (one,) = yield [Candidate(point, {"source": "start", "start": number})]
        if not one.failed:
            waiting[number] = one

    def _to_the_end(self, points: Surrounded, number: int) -> Generator[list[Candidate], list[Evaluation], Evaluation]:
        note = {"start": number}
        whole = max(len(points.best.stages) - 2, 0)
        base = yield from go_down(points, whole, PATIENT, note)
        close = yield from surround(base, _CLOSE_RADIUS, note)
        return (yield from go_down(close, len(base.stages) - 1, EXACT, note, _WIDE_RADIUS))

    def _repeat(self) -> Search:
        """Goes all the way again from the best end, as long as that lowers it."""
        number, best = min(self._followed.items(), key=lambda one: one[1].loss)
        before, note = np.inf, {"start": number}
        while best.loss < _WORTHWHILE * before:
            before = best.loss
            points = yield from surround(best, _WIDE_RADIUS, note)
            if (eased := len(best.stages) - 2) > 0:
                yield from go_down(points, eased - 1, BRIEF, note)
            end = yield from self._to_the_end(points, number)
            best = self._followed[number] = min(best, end, key=lambda one: one.loss)


def agreeing(ends: Sequence[float]) -> int:
    """How many descents ended within a tenth of the best one's loss, that one included."""
    return sum(end <= (1 + AGREEMENT) * min(ends) for end in ends)
