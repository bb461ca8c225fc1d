"""Convergence of a run, judged by its record, in a sentence with what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markertrack.track import MarkerTrack
from swim2real.calibration.file_models import Outcome, RecordedEvaluation
from swim2real.calibration.run_settings import RunSettings
from swim2real.optimizers.enough import AGREEMENT, agreeing
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Sensor
from swim2real.settings import CalibrationSettings
from swim2real.trials import Trial

_FALLING = 0.05  # of the loss, by which the last quarter of the budget may lower it in a run that has converged
_FEW = 10  # evaluations of which nothing is said
_LEAST = 1e-300  # m, in place of a loss of 0
_ON_BOUND = 0.005  # of the range
_SPREAD = ("first point", "start", "initial")  # sources of points that no search has proposed


def incumbent(entries: Sequence[RecordedEvaluation]) -> RecordedEvaluation | None:
    """The entry with the lowest loss of those that didn't fail, the earliest of equals; None when all failed."""
    return min((entry for entry in entries if not entry.failed), key=lambda entry: entry.loss, default=None)


def best_losses(entries: Sequence[RecordedEvaluation]) -> list[float]:
    """Loss of the incumbent after each evaluation [m]; that of a failure as long as all failed."""
    losses: list[float] = []
    best: float | None = None
    for entry in entries:
        if not entry.failed:
            best = entry.loss if best is None else min(best, entry.loss)
        losses.append(entry.loss if best is None else best)
    return losses


def still_falling(entries: Sequence[RecordedEvaluation], settings: CalibrationSettings) -> str | None:
    """A warning that a run hadn't converged: its last quarter lowered the loss by more than 5 %.

    Args:
        entries: Evaluations on record.
        settings: Settings of the run.

    Returns:
        None for a run that converged, hasn't spent its budget, or is shorter than four evaluations.
    """
    budget = settings.budget
    if budget is None or budget < 4 or len(entries) < budget:
        return None
    losses = best_losses(entries)
    before, end = losses[len(losses) - len(losses) // 4 - 1], losses[-1]
    if end >= (1 - _FALLING) * before:
        return None
    return (
        f"the loss was still falling: {100 * (1 - end / before):.0f} % lower in the last quarter of the budget; raise "
        f"--budget and add --resume (with method staged: begin a new run)"
    )


def never_beaten(entries: Sequence[RecordedEvaluation], settings: CalibrationSettings) -> str | None:
    """A warning that a search has found nothing better than the points that it began with.

    Args:
        entries: Evaluations on record.
        settings: Settings of the run.

    Returns:
        None for a run that did, hasn't spent its budget, or is shorter than ten evaluations.
    """
    budget = settings.budget
    if budget is None or settings.method == "random" or budget < _FEW or len(entries) < budget:
        return None
    best = incumbent(entries)
    if best is None or best.note.source not in _SPREAD:
        return None
    return (
        f"the search hasn't beaten its own first points: the best of {len(entries)} is evaluation {best.index + 1}, "
        f"which no search proposed; run several seeds (--seeds 0:3) or another method (--method bayesopt), and look "
        f"whether the bounds are as wide as they must be"
    )


def marker_noise(tracks: Sequence[MarkerTrack]) -> float | None:
    """Noise of a marker where it was seen, from frame to frame [m]; median over markers, mean over tracks."""
    scattered = [_scatter(track.positions) for track in tracks if track.marker_count]
    found = [float(np.sqrt(2) * np.nanmedian(one)) for one in scattered if np.isfinite(one).any()]
    return float(np.mean(found)) if found else None


def noise_of(trials: Sequence[Trial], sensors: Sequence[Sensor]) -> float | None:
    """Noise of the markers, and the mean error that noise of readings counts as [m]; None without either."""
    noise = marker_noise([trial.track for trial in trials])
    tables = [trial.sensors for trial in trials if trial.sensors is not None] if sensors else []
    mean = np.sqrt(2 / np.pi)  # absolute deviation of a normal distribution
    found = [sum(s.meters_per_unit * mean * float(_scatter(one.column(s.name))) for s in sensors) for one in tables]
    if not found or not np.isfinite(found).all():
        return noise
    return float(np.mean(found)) + (noise or 0.0)


def _scatter(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of noise in columns over time, NaN where nothing tells it. Shape (T, ...) to (...).

    Fifth differences in time leave little of the motion: those of white noise have 252 times its variance.
    """
    fifths = np.diff(values, n=5, axis=0)
    if not np.isfinite(fifths).any():
        return np.full(values.shape[1:], np.nan)
    return np.asarray(1.4826 * np.nanmedian(np.abs(fifths - np.nanmedian(fifths, axis=0)), axis=0) / np.sqrt(252))


def standing(
    entries: Sequence[RecordedEvaluation], settings: RunSettings, outcome: Outcome | None, space: ParameterSpace
) -> tuple[str, ...]:
    """State of a search without a budget, in sentences; none for a run that a budget ends.

    Args:
        entries: Evaluations on record.
        settings: Settings of the run.
        outcome: What it found; None for one that was interrupted.
        space: Parameters, on the run's scale.
    """
    best = incumbent(entries)
    if best is None or (settings.budget is not None and not settings.finish):
        return ()
    done, ends = _done(entries, outcome), ends_of(entries, outcome)
    near = agreeing([best.loss, *ends]) - 1
    last = _gain_lately(entries)
    state, more = ("is done", "") if done else ("isn't finished", "; --resume goes on with it")
    ended = f"of {len(ends)} starts followed to their end {near} agree within {100 * AGREEMENT:.0f} %"
    if len(ends) == 1:
        ended = "only one start was followed to its end, which no second one confirms yet"
    gained = f"lowered the loss by {100 * last:.0f} %" if last >= 0.005 else "gained nothing"
    said = [
        f"the search {state} after {len(entries)} evaluations, at {1e3 * best.loss:.2f} mm{more}",
        ended if ends else "no start has been followed to its end",
        f"the last quarter of the evaluations {gained}",
    ]
    places = dict(zip(space.names, space.to_cube(best.values), strict=True))
    bound = [name for name, place in places.items() if not _ON_BOUND < place < 1 - _ON_BOUND]
    if bound:
        said.append(f"at a bound: {', '.join(bound)}; widen the bounds if the robot may lie beyond")
    return tuple(said)


def _done(entries: Sequence[RecordedEvaluation], outcome: Outcome | None) -> bool:
    return outcome is not None and outcome.ending == "done" and outcome.evaluations == len(entries)


def ends_of(entries: Sequence[RecordedEvaluation], outcome: Outcome | None) -> list[float]:
    """Lowest loss of each start that was followed to the end of the last stage, in order [m].

    Args:
        entries: Evaluations on record.
        outcome: What was found; None for a run that was interrupted, whose last start isn't at its end.
    """
    done = _done(entries, outcome)
    lowest: dict[int, float] = {}
    ended: dict[int, None] = {}
    for index, entry in enumerate(entries):
        start = entry.note.start
        if start is None or entry.note.stage is None:
            continue
        if not entry.failed:
            lowest[start] = min(entry.loss, lowest.get(start, entry.loss))
        if entry.note.last and (done if index + 1 == len(entries) else not entries[index + 1].note.last):
            ended[start] = None
    return [lowest[start] for start in ended if start in lowest]


def _gain_lately(entries: Sequence[RecordedEvaluation]) -> float:
    """Share by which the last quarter of the evaluations lowered the best loss."""
    losses = best_losses(entries)
    before = losses[3 * len(losses) // 4 - 1]
    return (before - losses[-1]) / max(before, _LEAST)
