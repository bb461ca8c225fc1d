"""Behind the totals: rounds of the line search, speeds by frequency, errors by marker, trials left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.comparison.protocols import PROTOCOLS, MarkerKind
from swim2real.comparison.results import ComparisonResults, RunResult
from swim2real.comparison.statistics import Spread, numbers

Array = NDArray[np.float64]

_MARKER_KEYS = {"marker": "marker_errors", "aligned": "aligned_marker_errors", "shape": "shape_marker_errors"}


@dataclass(frozen=True)
class StepStatistics:
    """What became of the proposals of a method, over its seeds.

    Attributes:
        rounds: That were decided: accepted or rejected.
        accepted: Of them.
        cut_short: Rounds that the budget ended before they were decided; in none of the other figures.
        steps: Evaluations of the decided rounds.
        by_size: Accepted rounds by the step size that was accepted, the largest first.
        calls: Advisor calls of each run. Shape (S,).
    """

    rounds: int
    accepted: int
    cut_short: int
    steps: int
    by_size: Mapping[float, int]
    calls: Array

    @property
    def accept_rate(self) -> float:
        return self.accepted / self.rounds if self.rounds else float("nan")

    @property
    def shares(self) -> dict[float, float]:
        """Share of the accepted rounds by step size; none when none was accepted."""
        return {size: count / self.accepted for size, count in self.by_size.items() if self.accepted}

    @property
    def steps_per_accepted(self) -> float:
        """Evaluations that an accepted proposal costs; infinite when none was."""
        return self.steps / self.accepted if self.accepted else float("inf")


@dataclass(frozen=True)
class Speeds:
    """Forward speeds of a method at its best parameters, by frequency.

    Attributes:
        trials: N names.
        frequencies: That the simulated motor turned at [Hz]. Shape (N,).
        real: [m/s]. Shape (N,).
        simulated: NaN where it diverged [m/s]. Shape (S, N).
    """

    trials: tuple[str, ...]
    frequencies: Array
    real: Array
    simulated: Array

    @property
    def errors(self) -> Array:
        """How far off each is, without sign [m/s]. Shape (S, N)."""
        return np.abs(self.simulated - self.real)

    @property
    def mean_error(self) -> Spread:
        """Mean over trials, by seed [m/s]."""
        return Spread(nan_mean(self.errors, axis=1))


@dataclass(frozen=True)
class LeftOut:
    """A method's error on trials that its fit did not know.

    Attributes:
        trials: Each run's trial. Length R.
        seeds: Each run's seed. Length R.
        unseen: Error on the trial that was left out, in the protocol's own figure [m]. Shape (R,).
        seen: Error on the trials that were fitted [m]. Shape (R,).
        in_fit: Error on the same trial of the run of that seed that knew it; NaN where there is none [m]. Shape (R,).
        velocity: Error in speed on the trial that was left out [m/s]. Shape (R,).
    """

    trials: tuple[str, ...]
    seeds: tuple[int, ...]
    unseen: Array
    seen: Array
    in_fit: Array
    velocity: Array

    def of_trial(self, trial: str) -> Spread:
        """Errors on a trial, one a seed [m]."""
        return Spread(self.unseen[[name == trial for name in self.trials]])


def step_statistics(runs: Sequence[RunResult]) -> StepStatistics | None:
    """Rounds of a method's runs, counted together; None for a method without rounds."""
    rounds = [one for run in runs for one in run.rounds]
    if not rounds:
        return None
    decided = [one for one in rounds if one.finished]
    taken = [one.sizes[-1] for one in decided if one.accepted]
    by_size = {
        size: taken.count(size) for size in sorted({size for one in decided for size in one.sizes}, reverse=True)
    }
    return StepStatistics(
        rounds=len(decided),
        accepted=len(taken),
        cut_short=len(rounds) - len(decided),
        steps=sum(len(one.sizes) for one in decided),
        by_size=by_size,
        calls=np.array([run.calls for run in runs], dtype=float),
    )


def speeds(runs: Sequence[RunResult]) -> Speeds | None:
    """Speeds of a method's runs, by frequency; None without runs, and of trials without frequencies."""
    if not runs or not PROTOCOLS[runs[0].protocol].frequencies:
        return None
    figures = runs[0].fit["trials"]
    names = tuple(sorted(figures, key=lambda name: (figures[name]["frequency"] or 0.0, name)))
    simulated = np.array([numbers([_speed(run.fit["trials"].get(name, {})) for name in names]) for run in runs])
    return Speeds(
        names,
        numbers([figures[name]["frequency"] for name in names]),
        numbers([figures[name]["velocity_real"] for name in names]),
        simulated,
    )


def _speed(figures: Mapping[str, Any]) -> float | None:
    return None if figures.get("divergence") else figures.get("velocity_simulated")


def marker_errors(runs: Sequence[RunResult], kind: MarkerKind) -> Array:
    """Mean error of each marker over the trials, by seed [m]. Shape (S, M).

    Args:
        runs: Of a method.
        kind: `marker` is without registration, of swims the paper's Eq. 1; `aligned` is registered, in the body frame,
            with the difference in progress; `shape` is the same without progress.
    """
    key = _MARKER_KEYS[kind]
    rows = [nan_mean(np.array([numbers(t[key]) for t in run.fit["trials"].values()]), axis=0) for run in runs]
    return np.array(rows)


def left_out(results: ComparisonResults, method: str, protocol: str) -> LeftOut | None:
    """What a method makes of trials it was not fitted to; None without such runs."""
    runs = [run for run in results.left_out(method, protocol) if run.held_out_fit is not None]
    if not runs:
        return None
    key = PROTOCOLS[protocol].trial_loss
    knowing = {run.seed: run.fit["trials"] for run in results.of(method, protocol)}
    unseen = [run.held_out_fit or {} for run in runs]
    names = [str(run.held_out) for run in runs]
    in_fit = [knowing.get(run.seed, {}).get(name, {}).get(key) for run, name in zip(runs, names, strict=True)]
    return LeftOut(
        trials=tuple(names),
        seeds=tuple(run.seed for run in runs),
        unseen=numbers([fit.get(key) for fit in unseen]),
        seen=numbers([run.fit.get(key) for run in runs]),
        in_fit=numbers(in_fit),
        velocity=numbers([fit.get("velocity_error") for fit in unseen]),
    )


def nan_mean(values: Array, axis: int) -> Array:
    """Mean of the known values; NaN where none is known, without a warning."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
