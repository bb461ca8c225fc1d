"""How good each method is and how surely: spreads over seeds, differences with intervals, errors reached."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim2real.comparison.protocols import PROTOCOLS, ProtocolWords, figures_of
from swim2real.comparison.results import ComparisonResults, RunResult
from swim2real.errors import ArgumentError, RunError

Array = NDArray[np.float64]
Figure = Literal["final", "auc"]

ERRORS = (0.1, 0.05, 0.03, 0.02, 0.016)  # m, that a method should reach
_RESAMPLES = 10_000
_LEVEL = 0.95


@dataclass(frozen=True)
class Spread:
    """One figure of a method over its seeds.

    Attributes:
        values: NaN where a seed has none. Shape (S,).
    """

    values: Array

    @property
    def known(self) -> Array:
        """The values that there are. Shape (≤ S,)."""
        return self.values[np.isfinite(self.values)]

    @property
    def mean(self) -> float:
        return float(np.mean(self.known)) if self.known.size else float("nan")

    @property
    def std(self) -> float:
        """Standard deviation of the seeds as a sample (n - 1); NaN for a single seed."""
        return float(np.std(self.known, ddof=1)) if self.known.size > 1 else float("nan")

    @property
    def median(self) -> float:
        return float(np.median(self.known)) if self.known.size else float("nan")

    @property
    def worst(self) -> float:
        return float(np.max(self.known)) if self.known.size else float("nan")


@dataclass(frozen=True)
class MethodStatistics:
    """A method under a protocol, over its seeds, on runs made of all trials.

    Attributes:
        method: Its label.
        protocol: `aligned`, `paper` or `playback`.
        runs: One a seed, at least one.
        curves: Best loss so far after each evaluation [m]. Shape (S, B).
        final: Best loss of each seed [m].
        auc: Mean over the budget of the best loss so far, the first evaluation's included [m].
        figures: Overall figures at the best parameters, by name; NaN where a fit has none [SI].
    """

    method: str
    protocol: str
    runs: tuple[RunResult, ...]
    curves: Array
    final: Spread
    auc: Spread
    figures: Mapping[str, Spread]

    @property
    def words(self) -> ProtocolWords:
        """What is said of its protocol."""
        return PROTOCOLS[self.protocol]

    @property
    def seeds(self) -> tuple[int, ...]:
        return tuple(run.seed for run in self.runs)

    def by_seed(self, figure: Figure) -> dict[int, float]:
        """A figure of each seed [m]."""
        values = (self.final if figure == "final" else self.auc).values
        return dict(zip(self.seeds, values.tolist(), strict=True))

    def typical_run(self) -> RunResult:
        """The run with the median final loss; the better of the two middle ones for an even number."""
        order = np.argsort(self.final.values, kind="stable")
        return self.runs[int(order[(len(order) - 1) // 2])]


@dataclass(frozen=True)
class Difference:
    """A method's mean minus that of the best method, over the seeds that both have.

    Attributes:
        reference: The best method.
        mean: [m].
        low: Lower end of the 95 % interval; NaN for fewer than two seeds [m].
        high: Upper end [m].
        seeds: That both have.
    """

    reference: str
    mean: float
    low: float
    high: float
    seeds: tuple[int, ...]

    @property
    def is_sure(self) -> bool:
        """Whether zero lies outside the interval."""
        return bool(self.low > 0 or self.high < 0)


@dataclass(frozen=True)
class Reached:
    """How soon the seeds of a method got to an error.

    Attributes:
        error: [m].
        evaluations: How many it took; NaN where it was not reached. Shape (S,).
    """

    error: float
    evaluations: Array

    @property
    def count(self) -> int:
        """Seeds that reached it."""
        return int(np.isfinite(self.evaluations).sum())

    @property
    def median(self) -> float:
        """Over all seeds, one that did not reach it taking forever; infinite where most did not."""
        ordered = np.sort(np.where(np.isfinite(self.evaluations), self.evaluations, np.inf))
        return float((ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2)


def method_statistics(results: ComparisonResults, protocol: str) -> tuple[MethodStatistics, ...]:
    """Every method that has runs under a protocol, as planned.

    Raises:
        RunError: A run is shorter than the budget.
    """
    found: list[MethodStatistics] = []
    for method in results.methods:
        runs = results.of(method, protocol)
        if not runs:
            continue
        for run in runs:
            if len(run.losses) < results.budget:
                raise RunError(
                    f"run '{run.folder}' has {len(run.losses)} of {results.budget} evaluations; "
                    f"run the comparison again, it goes on from there"
                )
        curves = np.array([run.best[: results.budget] for run in runs])
        figures = {
            figure.name: Spread(numbers([figure.of(run.fit) for run in runs]))
            for figure in figures_of(protocol, results.sensors)
        }
        spreads = Spread(curves[:, -1]), Spread(curves.mean(axis=1))
        found.append(MethodStatistics(method, protocol, runs, curves, *spreads, figures))
    return tuple(found)


def best_method(methods: Sequence[MethodStatistics], figure: Figure = "final") -> MethodStatistics:
    """The one with the lowest mean; the first of equals.

    Raises:
        ArgumentError: There is none.
    """
    if not methods:
        raise ArgumentError("there is no method with a finished run to compare; run the comparison first")
    return min(methods, key=lambda one: (one.final if figure == "final" else one.auc).mean)


def differences(
    methods: Sequence[MethodStatistics], figure: Figure = "final", seed: int = 0
) -> dict[str, Difference | None]:
    """How much worse than the best method each one is, by method; None for the best itself and without common seeds.

    The interval is a percentile bootstrap over seeds. Seeds are drawn in pairs, since methods of a seed begin at the
    same point; all methods see the same draws. With few seeds such an interval is too narrow, and no better one is to
    be had: 5 seeds can't tell how far their tails reach.

    Args:
        methods: Under one protocol.
        figure: `final` or `auc`.
        seed: Of the draws.
    """
    if not methods:
        return {}
    best = best_method(methods, figure)
    reference = best.by_seed(figure)
    found: dict[str, Difference | None] = {}
    for one in methods:
        own = one.by_seed(figure)
        common = tuple(sorted(own.keys() & reference.keys()))
        if one.method == best.method or not common:
            found[one.method] = None
            continue
        gaps = np.array([own[s] - reference[s] for s in common])
        found[one.method] = Difference(best.method, float(gaps.mean()), *bootstrap_interval(gaps, seed), common)
    return found


def bootstrap_interval(values: ArrayLike, seed: int = 0) -> tuple[float, float]:
    """Percentile bootstrap of a mean: the ends of its 95 % interval; NaN for fewer than two values."""
    given = np.asarray(values, dtype=float)
    if given.size < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(seed)
    means = given[rng.integers(given.size, size=(_RESAMPLES, given.size))].mean(axis=1)
    low, high = np.quantile(means, [(1 - _LEVEL) / 2, (1 + _LEVEL) / 2])
    return float(low), float(high)


def reached(method: MethodStatistics, errors: Sequence[float] = ERRORS) -> tuple[Reached, ...]:
    """How many evaluations a method takes to get to or below each error [m]."""
    found: list[Reached] = []
    for error in errors:
        below = method.curves <= error
        first = np.where(below.any(axis=1), below.argmax(axis=1) + 1.0, np.nan)
        found.append(Reached(error, first))
    return tuple(found)


def numbers(values: Sequence[float | None]) -> Array:
    """A row of numbers from evidence, which has None for what is not known. Shape (n,)."""
    return np.array([np.nan if value is None else value for value in values], dtype=float)
