"""Least squares in stages from several starts: what is smooth comes first, what turns a trial around comes last."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swim2real.optimizers.enough import Sizes, conclusion, needed
from swim2real.optimizers.interpolated_descent import (
    BRIEF,
    EXACT,
    PATIENT,
    SMOOTH,
    Search,
    Surrounded,
    go_down,
    squares,
    surround,
    together,
)
from swimbase.errors import OptimizerError

_BODIES, _EASED = 4, 2  # starts of a group that begins with the first stage, and with the last eased one
_ALIKE = 2  # per parameter: points that the first stage hardly tells apart
_FORMING_RADII = (0.2, 0.05)  # of a parameter's range: far apart, points see past the bends that a body snaps into
_FORMING_TRUST = 0.4  # of it, as all that follow
_START_RADIUS, _WIDE_RADIUS, _CLOSE_RADIUS = 0.05, 0.1, 0.02
_WORTHWHILE = 0.95  # share of the loss to which going the way from an end again must lower it, to be repeated
_DEEPER = 0.99  # and the same of going to its bottom
_MOST, _FEW = 120, 5  # evaluations per parameter after which a search ends anyway, of as many more than there are
_TYPICAL = 15  # evaluations per parameter until the first end, as progress is reported before it
Start: TypeAlias = tuple[int, Evaluation]


class _Order(NamedTuple):
    """Indices of stages: of the body alone, the last eased one, those between, and the last."""

    body: int
    eased: int
    whole: tuple[int, ...]
    last: int


def _orders(count: int) -> list[_Order]:
    """Orders in which a number of stages are gone through, as `Comparison.residual_stages` has them."""
    if count < 4:
        return [_Order(0, 0, (max(count - 2, 0),), count - 1)]
    every = _Order(count - 4, count - 3, (count - 2,), count - 1)
    return [every, _Order(0, 1, (2, 3), count - 1)][: 1 + (count > 4)]


class MultiStart(Optimizer):
    """Goes down from several starts, best first, on one stage of the residual after the other.

    A problem gives its residual in stages (`Comparison.residual_stages`). Those before the last two are eased: the
    motion of the body alone, then with a bounded share of the way that it has come, so that a trial gone the wrong way
    hides nothing. All starts are evaluated first. A group of them, those that are lowest, goes down at the same time.
    Every other group forms the body first, on points far apart; half of it on points closer together; and of random
    points whose bodies are as near as the best one's, the one goes on that also swims best. The other groups, which
    choose first, begin with the last eased stage, as all do where there is no other. The best of a group is followed to
    its end: the whole residual on points far apart, which see past what is rough, then the last stage on points close
    together. From an end that is the best so far the way is gone again, and then its last part, as long as that lowers
    it. A third kind of group, with the start of the best end once more, goes through the stages in which some trials
    lead, and on from its end whether it is the best or not: trials that can be explained bring the search to where
    those are explained that no step leads to. When
    no start is left, new ones are random. The search is done when another start isn't worth its evaluations, or after a
    large number of them.
    """

    needs_residual = True

    def __init__(
        self, starts: Sequence[Array], rng: np.random.Generator, smooth: bool = False, sizes: Sizes | None = None,
        led: bool = False,
    ) -> None:  # fmt: skip
        """Prepares the search.

        Args:
            starts: Points to begin from, the run's first point first. Shapes (d,).
            rng: Generator of further starts.
            smooth: Whether the residual changes smoothly with the parameters, so that few vain steps end a descent.
            sizes: Noise and motion of the trials; by default only ends decide when it is done.
            led: Whether the first start is known to be good, so that it is followed before the others are evaluated.

        Raises:
            OptimizerError: There is no start.
        """
        if not starts:
            raise OptimizerError("starts is empty; give one point at least")
        super().__init__(len(starts[0]))
        self._brief, self._patient = (SMOOTH, SMOOTH) if smooth else (BRIEF, PATIENT)
        self._starts, self._rng = [cube_point(start, self.dimension) for start in starts], rng
        self._waiting, self._numbers = dict[int, Evaluation](), count()
        self._orders = _orders(1)
        self._search, self._begun, self._followed = self._run(), dict[int, Evaluation](), dict[int, Evaluation]()
        self._batch: deque[Candidate] = deque()
        self._told: list[Evaluation] = []
        self._sizes, self._led, self._made, self._ended = sizes or Sizes(), led, 0, 0
        self._most = _MOST * (self.dimension + _FEW)

    @property
    def ends(self) -> Sequence[float]:
        return [one.loss for one in self._followed.values()]

    @property
    def left(self) -> int:
        """Evaluations that it probably needs until it is done, by those until the ends so far.

        A descent that has taken longer than those before takes as long again, as far as anybody knows.
        """
        count, begun = len(self.ends), 1 if self._led else len(self._starts)
        each = (self._ended - begun) / count if count else _TYPICAL * self.dimension
        wanted = max(needed(self.ends, self._sizes) - count, 1)
        ended = self._ended if count else begun
        expected = round(ended + wanted * each)
        return max(min(expected if expected > self._made else 2 * self._made - ended, self._most) - self._made, 1)

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
        if evaluation.stages:
            self._orders = _orders(len(evaluation.stages))
        self._told.append(evaluation)
        self._made += 1
        if self._made >= self._most and not self.conclusion:
            self.conclusion, self.gave_up = f"{self._made} evaluations are the most of a search", True

    def _run(self) -> Search[None]:
        first, *others = self._starts
        starts = [Candidate(point, {"source": "start", "start": number}) for number, point in enumerate(others, 2)]
        begun = yield [Candidate(first, {"source": "first point"}), *starts[: 0 if self._led else None]]
        if self._led:
            if not begun[0].failed:
                yield from self._follow([(1, begun[0])], self._orders[0])
            begun = (yield starts) if starts else []
        self._waiting = {number: one for number, one in enumerate(begun, 1 + self._led) if not one.failed}
        self._numbers = count(len(self._starts) + 1)
        while True:
            every, *led = self._orders
            yield from self._follow((yield from self._taken(_EASED, every.eased)), every)
            if every.eased > every.body:
                bodies = yield from self._taken(_BODIES, every.body)
                yield from self._follow([(yield from self._formed(bodies))], every)
            for order in led:
                others = yield from self._taken(_EASED - 1, order.eased)
                best = min(self._followed, key=lambda number: self._followed[number].loss)
                yield from self._follow([(next(self._numbers), self._begun[best]), *others], order)

    def _follow(self, begun: list[Start], order: _Order) -> Search[None]:
        """Eases starts, and goes to the end with the best of them."""
        reached = yield from together([self._ease(*one, order) for one in begun])
        number, points = min(reached, key=lambda one: one[1].squares[0])
        self._begun[number] = dict(begun)[number]
        end = self._followed[number] = yield from self._to_the_end(points, {"start": number}, order)
        if end.loss <= min(self.ends) or order != self._orders[0]:
            yield from self._deeper(end, number, order)
        self._ended = self._made
        self.conclusion = self.conclusion or conclusion(self.ends, self._sizes)

    def _formed(self, begun: list[Start]) -> Search[Start]:
        """The start whose body comes nearest, and of the points that are as near the one that also swims best."""
        formed: list[tuple[int, Surrounded]] = []
        for radius in _FORMING_RADII:
            formed = yield from together([self._form(*one, radius) for one in begun])
            formed = sorted(formed, key=lambda one: one[1].squares[0])[: max(len(formed) // 2, 1)]
            begun = [(number, points.best) for number, points in formed]
        number, points = formed[0]
        alike = yield from points.alike(_ALIKE * self.dimension, self._rng, {"start": number})
        known = [one for one in (points.best, *alike) if not one.failed]
        return number, min(known, key=lambda one: squares(one, self._orders[0].eased))

    def _taken(self, wanted: int, stage: int) -> Search[list[Start]]:
        """The starts that are lowest in a stage, or random ones where none are left."""
        taken: list[Start] = []
        while len(taken) < wanted:
            if not self._waiting:
                number = next(self._numbers)
                point = cube_point(self._rng.random(self.dimension))
                (one,) = yield [Candidate(point, {"source": "start", "start": number})]
                self._waiting.update({} if one.failed else {number: one})
                continue
            heights = {number: squares(one, stage) for number, one in self._waiting.items()}
            number = min(heights, key=lambda number: heights[number])
            taken.append((number, self._waiting.pop(number)))
        return taken

    def _form(self, number: int, base: Evaluation, radius: float) -> Search[tuple[int, Surrounded]]:
        points = yield from surround(base, radius, {"start": number})
        yield from go_down(points, self._orders[0].body, EXACT, {"start": number}, _FORMING_TRUST)
        return number, points

    def _ease(self, number: int, base: Evaluation, order: _Order) -> Search[tuple[int, Surrounded]]:
        points = yield from surround(base, _START_RADIUS, {"start": number})
        yield from go_down(points, order.eased, self._brief, {"start": number}, _WIDE_RADIUS)
        return number, points

    def _to_the_end(self, points: Surrounded, note: Mapping[str, Any], order: _Order) -> Search[Evaluation]:
        for stage in order.whole:
            yield from go_down(points, stage, self._patient, note)
        return (yield from self._to_the_bottom(points.best, note, order))

    def _to_the_bottom(self, base: Evaluation, note: Mapping[str, Any], order: _Order) -> Search[Evaluation]:
        points = yield from surround(base, _CLOSE_RADIUS, note)
        return (yield from go_down(points, order.last, EXACT, {**note, "last": True}, _WIDE_RADIUS))

    def _all_the_way(self, base: Evaluation, note: Mapping[str, Any], order: _Order) -> Search[Evaluation]:
        points = yield from surround(base, _WIDE_RADIUS, note)
        yield from go_down(points, order.eased, self._brief, note)
        return (yield from self._to_the_end(points, note, order))

    def _deeper(self, best: Evaluation, number: int, order: _Order) -> Search[None]:
        """Goes all the way again from an end, then to the bottom, each as long as that pays."""
        for way, worthwhile in ((self._all_the_way, _WORTHWHILE), (self._to_the_bottom, _DEEPER)):
            before = np.inf
            while best.loss < worthwhile * before:
                before = best.loss
                end = yield from way(best, {"start": number}, order)
                best = self._followed[number] = min(best, end, key=lambda one: one.loss)
