"""Statistics of methods: spreads over seeds, differences with intervals, errors by trial and marker.

A `Series` has one value for each seed, a `DataFrame` one row for each seed. Missing values are NaN, and pandas leaves
them out of means.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from swim2real.comparison.results import ComparisonResults, RunResult
from swim2real.objective.figures import (
    AVERAGED,
    SENSORS,
    Figure,
    figure_values,
    figures_for,
    sensor_figure,
)
from swimbase.arrays import Array

Measure = Literal["final", "auc"]
MarkerKind = Literal["motion", "marker", "aligned", "shape"]

ERRORS = (0.1, 0.05, 0.03, 0.02, 0.016)  # m, that a method should reach
_RESAMPLES = 10_000
_LEVEL = 0.95


@dataclass(frozen=True)
class ProtocolDescription:
    """Description of one protocol.

    Attributes:
        loss: Name of the loss.
        trial_loss: Key of the loss in the figures of a trial.
        markers: Kinds of errors that a marker has, each with its description.
        markers_note: How to read these errors.
        has_frequencies: Whether its trials have a frequency, so that there is a speed against it.
    """

    loss: str
    trial_loss: str
    markers: tuple[tuple[MarkerKind, str], ...]
    markers_note: str = "Registration takes a static offset of each marker and trial out."
    has_frequencies: bool = True

    @property
    def markers_title(self) -> str:
        """Title of tables and charts of the markers' errors."""
        return "Error from head to tail" if self.has_frequencies else "Error of each marker"

    @property
    def markers_order(self) -> str:
        """Label of the axis of the markers."""
        return "marker, head to tail" if self.has_frequencies else "marker"


PROTOCOLS: Mapping[str, ProtocolDescription] = {
    "motion": ProtocolDescription(
        "motion error", "motion_error",
        (("motion", "in the frame of the path"), ("aligned", "in the body frame"), ("shape", "shape alone")),
    ),
    "aligned": ProtocolDescription(
        "aligned marker error", "aligned_marker_error",
        (("marker", "not registered (Eq. 1)"), ("aligned", "registered"), ("shape", "registered, shape alone")),
    ),
    "paper": ProtocolDescription(
        "marker error (Eq. 1)", "marker_error", (("marker", "Eq. 1"), ("shape", "shape alone")),
        "Under the paper's protocol nothing is registered.",
    ),
    "playback": ProtocolDescription(
        "playback error", "loss", (("aligned", "at the same times"),),
        "Real and simulated markers are compared at the same times.", has_frequencies=False,
    ),
}  # fmt: skip


def figures_of(protocol: str, sensors: Mapping[str, str]) -> dict[str, Figure]:
    """All figures that a fit may have, by name.

    Args:
        protocol: Name of the protocol.
        sensors: Units of the sensors that are compared, by name.
    """
    figures = figures_for(registered=protocol != "playback")
    shown = {name: figures[name] for name in AVERAGED if name != SENSORS and figures[name].of != "tracks"}
    return shown | {f"{SENSORS}.{name}": sensor_figure(name, unit) for name, unit in sensors.items()}


@dataclass(frozen=True)
class MethodStatistics:
    """A method under a protocol, over its seeds, on the runs that were fitted to all trials.

    Attributes:
        method: Label of the method.
        protocol: `aligned`, `paper` or `playback`.
        runs: One run for each of S seeds, S ≥ 1.
        curves: Best loss so far after each of B evaluations [m]. Shape (S, B).
        final: Best loss of each seed [m].
        auc: Mean over the budget of the best loss so far, the first evaluation's included [m].
        figures: Overall figures at the best parameters, a column for each figure [SI].
    """

    method: str
    protocol: str
    runs: tuple[RunResult, ...]
    curves: Array
    final: pd.Series[float]
    auc: pd.Series[float]
    figures: pd.DataFrame

    @property
    def description(self) -> ProtocolDescription:
        """Description of the protocol."""
        return PROTOCOLS[self.protocol]

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seed of each run."""
        return tuple(run.seed for run in self.runs)

    def mean(self, measure: Measure) -> float:
        """Mean of a measure over the seeds [m]."""
        return float((self.final if measure == "final" else self.auc).mean())

    def typical_run(self) -> RunResult:
        """The run with the median final loss; the better of the two middle ones for an even number."""
        order = np.argsort(self.final.to_numpy(), kind="stable")
        return self.runs[int(order[(len(order) - 1) // 2])]


@dataclass(frozen=True)
class Difference:
    """A method's mean minus that of the best method, over the seeds that both have.

    Attributes:
        reference: Label of the best method.
        mean: Mean difference [m].
        low: Lower end of the 95 % interval; NaN for fewer than two seeds [m].
        high: Upper end of the interval [m].
        seeds: Seeds that both have.
    """

    reference: str
    mean: float
    low: float
    high: float
    seeds: tuple[int, ...]

    @property
    def is_significant(self) -> bool:
        """True if zero lies outside the interval."""
        return bool(self.low > 0 or self.high < 0)


@dataclass(frozen=True)
class _StepStatistics:
    """Fates of the proposals of a line search, over all seeds.

    Attributes:
        rounds: Number of rounds that were decided: accepted or rejected.
        accepted: Number of accepted rounds.
        cut_short: Number of rounds that the budget ended before they were decided; they count nowhere else.
        steps: Evaluations of the decided rounds.
        by_size: Accepted rounds by the step size that was accepted, the largest first.
        calls: Mean number of advisor calls in a run.
    """

    rounds: int
    accepted: int
    cut_short: int
    steps: int
    by_size: Mapping[float, int]
    calls: float

    @property
    def accept_rate(self) -> float:
        """Share of the decided rounds that were accepted; NaN without rounds."""
        return self.accepted / self.rounds if self.rounds else float("nan")

    @property
    def shares(self) -> dict[float, float]:
        """Share of the accepted rounds by step size; empty when none was accepted."""
        return {size: count / self.accepted for size, count in self.by_size.items() if self.accepted}

    @property
    def steps_per_accepted(self) -> float:
        """Evaluations that an accepted proposal costs; infinite when none was accepted."""
        return self.steps / self.accepted if self.accepted else float("inf")


@dataclass(frozen=True)
class Speeds:
    """Forward speeds of a method at its best parameters. Trials are ordered by frequency.

    Attributes:
        frequencies: Frequency that the simulated motor turned at, by trial [Hz].
        real: Real speed by trial [m/s].
        simulated: Simulated speed, a column for each trial; NaN where the simulation diverged [m/s].
    """

    frequencies: pd.Series[float]
    real: pd.Series[float]
    simulated: pd.DataFrame

    @property
    def trials(self) -> tuple[str, ...]:
        """Names of the trials."""
        return tuple(self.frequencies.index)

    @property
    def errors(self) -> pd.DataFrame:
        """Absolute error in speed, a column for each trial [m/s]."""
        return (self.simulated - self.real).abs()

    @property
    def mean_error(self) -> pd.Series[float]:
        """Mean error over the trials [m/s]."""
        return self.errors.mean(axis=1)


def method_statistics(results: ComparisonResults, protocol: str) -> tuple[MethodStatistics, ...]:
    """Statistics of every method that has runs under a protocol, in the order of the plan."""
    statistics: list[MethodStatistics] = []
    figures = figures_of(protocol, results.sensors)
    for method in results.methods:
        runs = results.of(method, protocol)
        if not runs:
            continue
        curves = np.array([run.best[: results.budget] for run in runs])
        seeds = pd.Index([run.seed for run in runs])
        final, auc = pd.Series(curves[:, -1], seeds), pd.Series(curves.mean(axis=1), seeds)
        values = pd.DataFrame([figure_values(run.fit) for run in runs], seeds, list(figures), float)
        statistics.append(MethodStatistics(method, protocol, runs, curves, final, auc, values))
    return tuple(statistics)


def best_method(methods: Sequence[MethodStatistics], measure: Measure = "final") -> MethodStatistics:
    """The method with the lowest mean; the first of equals."""
    return min(methods, key=lambda method: method.mean(measure))


def differences(methods: Sequence[MethodStatistics], measure: Measure = "final") -> dict[str, Difference | None]:
    """Differences to the best method, by method; None for the best itself and without common seeds.

    The interval is a percentile bootstrap over seeds. Seeds are drawn in pairs, since methods of a seed begin at the
    same point; all methods see the same draws. With few seeds such an interval is too narrow, and no better one is to
    be had: 5 seeds don't show how far their tails reach.
    """
    if not methods:
        return {}
    best = best_method(methods, measure)
    by_method: dict[str, Difference | None] = {}
    for method in methods:
        gaps = (getattr(method, measure) - getattr(best, measure)).dropna()  # of the seeds that both have
        if method is best or gaps.empty:
            by_method[method.method] = None
        else:
            interval = bootstrap_interval(gaps)
            by_method[method.method] = Difference(best.method, float(gaps.mean()), *interval, tuple(gaps.index))
    return by_method


def bootstrap_interval(values: ArrayLike, seed: int = 0) -> tuple[float, float]:
    """Percentile bootstrap of a mean: the ends of its 95 % interval; NaN for fewer than two values."""
    given = np.asarray(values, dtype=float)
    if given.size < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng(seed)
    means = given[rng.integers(given.size, size=(_RESAMPLES, given.size))].mean(axis=1)
    low, high = np.quantile(means, [(1 - _LEVEL) / 2, (1 + _LEVEL) / 2])
    return float(low), float(high)


def evaluations_to_reach(method: MethodStatistics, errors: Sequence[float] = ERRORS) -> pd.DataFrame:
    """Evaluations of each seed to get to or below an error [m], a column for each; NaN where it doesn't."""
    below = method.curves[:, :, None] <= np.asarray(errors)
    first = np.where(below.any(axis=1), below.argmax(axis=1) + 1.0, np.nan)
    return pd.DataFrame(first, method.final.index, list(errors))


def step_statistics(runs: Sequence[RunResult]) -> _StepStatistics | None:
    """Rounds of a method's runs, counted together; None for a method without rounds."""
    rounds = [step_round for run in runs for step_round in run.rounds]
    if not rounds:
        return None
    decided = [step_round for step_round in rounds if step_round.finished]
    accepted_sizes = [step_round.sizes[-1] for step_round in decided if step_round.accepted]
    sizes = sorted({size for step_round in decided for size in step_round.sizes}, reverse=True)
    return _StepStatistics(
        rounds=len(decided),
        accepted=len(accepted_sizes),
        cut_short=len(rounds) - len(decided),
        steps=sum(len(step_round.sizes) for step_round in decided),
        by_size={size: accepted_sizes.count(size) for size in sizes},
        calls=float(np.mean([run.calls for run in runs])),
    )


def speeds(runs: Sequence[RunResult]) -> Speeds | None:
    """Speeds of a method's runs, by frequency; None without runs, and of trials without frequencies."""
    if not runs or not PROTOCOLS[runs[0].protocol].has_frequencies:
        return None
    trials = runs[0].fit.trials
    names = sorted(trials, key=lambda name: (trials[name].frequency or 0.0, name))
    made = [[run.fit.trials.get(name) for name in names] for run in runs]
    simulated = [[None if one is None or one.divergence else one.velocity_simulated for one in row] for row in made]
    return Speeds(
        pd.Series({name: trials[name].frequency for name in names}, dtype="float64"),
        pd.Series({name: trials[name].velocity_real for name in names}, dtype="float64"),
        pd.DataFrame(simulated, [run.seed for run in runs], names, float),
    )


def marker_errors(runs: Sequence[RunResult], kind: MarkerKind, count: int) -> pd.DataFrame:
    """Mean error of each marker over the trials, a column for each marker [m].

    Args:
        runs: Runs of a method.
        kind: `marker` is without registration, of swims the paper's Eq. 1; `aligned` is registered, in the body frame,
            with the difference in progress; `shape` is the same without progress.
        count: Number of markers; one of which no run says anything is NaN.
    """
    rows: list[pd.Series[float]] = []
    key = "marker_errors" if kind == "marker" else f"{kind}_marker_errors"
    for run in runs:
        errors = [getattr(trial, key) for trial in run.fit.trials.values()]
        rows.append(pd.DataFrame([known for known in errors if known], dtype=float).mean())
    return pd.DataFrame(rows, [run.seed for run in runs], range(count), dtype=float)


def held_out_errors(results: ComparisonResults, method: str, protocol: str) -> pd.DataFrame | None:
    """Errors of a method on trials that it was not fitted to, a row for each run; None without such runs.

    Columns: `trial` is the name of the trial that was left out and `seed` the run's seed; `held_out` is the error on
    that trial, in the protocol's own figure; `same_when_fitted` is the error on the same trial of the run of that seed
    that was fitted to it; `velocity` is the error in speed on the trial that was left out [m, m/s].
    """
    key = PROTOCOLS[protocol].trial_loss
    fitted_to_all = {run.seed: run.fit.trials for run in results.of(method, protocol)}
    rows = [
        {
            "trial": run.held_out, "seed": run.seed, "held_out": getattr(run.held_out_fit, key),
            "same_when_fitted": getattr(fitted_to_all.get(run.seed, {}).get(run.held_out or ""), key, None),
            "velocity": run.held_out_fit.velocity_error,
        }
        for run in results.left_out(method, protocol) if run.held_out_fit is not None
    ]  # fmt: skip
    numbers = dict.fromkeys(("held_out", "same_when_fitted", "velocity"), float)
    return pd.DataFrame(rows).astype(numbers) if rows else None
