"""The calibration loop: budget, incumbent, failure rule, record and resume.

It knows neither how candidates are found nor what they are compared with: an optimizer asks, a problem evaluates, and
every evaluation is on the disk before the optimizer hears of it. To resume is to replay: the optimizer is asked again
for every recorded candidate, and a mismatch is refused.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration.file_models import RecordedEvaluation
from swim2real.calibration.problem import Problem
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.sensitivity import Slopes
from swim2real.objective import Comparison, evidence
from swim2real.optimizers import Candidate, Evaluation, Optimizer
from swim2real.parameters import ParameterSpace, Values, write_parameters
from swimbase.errors import RunError
from swimbase.store import writing

Ending = Literal["done", "most", "budget", "minutes", "stopped", "interrupted"]

_PRIOR = 0.01  # of the first residual's length: what the way over a parameter's whole range adds


@dataclass(frozen=True)
class Search:
    """A search as it ended.

    Attributes:
        ending: What ended it.
        conclusion: Reason why it is done, in words; empty otherwise.
        made: Evaluations.
        ends: Losses at which descents from independent starts ended [m].
        seconds: Time that it would probably still take [s]; None where that isn't known.
    """

    ending: Ending = "budget"
    conclusion: str = ""
    made: int = 0
    ends: Sequence[float] = ()
    seconds: float | None = None


class StoppedError(Exception):
    """The wish of a callback that a search ends now and is concluded."""


@dataclass(frozen=True)
class Progress:
    """Progress of a run after an evaluation.

    Attributes:
        done: Evaluations so far.
        budget: Evaluations in all; None for a search that ends when it is done.
        loss: Loss of this evaluation [m].
        best: Lowest loss so far [m].
        note: The optimizer's note on the candidate.
        improved: Whether this one is the new incumbent.
        seconds_left: Estimate by the pace so far [s]; None for a search that may end at any time, or nothing ends.
        replayed: True for an evaluation that was read from the record.
        ends: Losses at which descents from independent starts ended [m].
        gained: Share by which the last quarter of the evaluations, those on record included, lowered the best loss:
            about what the next as many may gain.
        error: Error of the best parameters so far, as pages show it [m]; None while every simulation diverged.
        values: Best parameters so far, by name.
    """

    done: int
    budget: int | None
    loss: float
    best: float
    note: Mapping[str, Any]
    improved: bool
    seconds_left: float | None
    replayed: bool
    ends: Sequence[float] = ()
    gained: float = 1.0
    error: float | None = None
    values: Values = field(default_factory=dict[str, float])

    def stop(self) -> NoReturn:
        """Ends the search after this evaluation; the run is concluded, and can be resumed."""
        raise StoppedError


def minimize(
    problem: Problem, space: ParameterSpace, optimizer: Optimizer, budget: int | None, folder: RunFolder,
    on_progress: Callable[[Progress], None] = lambda progress: None, prior: NDArray[np.float64] | None = None,
    minutes: float | None = None, slopes: Slopes | None = None,
) -> tuple[RecordedEvaluation, Search]:  # fmt: skip
    """Runs or goes on with a calibration until the optimizer is done or the budget is spent.

    Args:
        problem: What evaluates a candidate.
        space: Maps the unit cube to values.
        optimizer: Fresh: recorded evaluations are replayed into it.
        budget: Most simulation evaluations, those on record included; None for any number.
        folder: Locked by the caller, with settings written.
        on_progress: Called after every evaluation. Its KeyboardInterrupt, or `Progress.stop`, ends the run.
        prior: Point of the unit cube that undetermined parameters stay near; least squares gets the distance as extra
            residuals, a whole range as a hundredth of the first residual. Losses don't contain it. Shape (d,).
        minutes: Longest search from its first evaluation that isn't on record; None for any.
        slopes: Takes the residuals that an optimizer asks for.

    Returns:
        The record's entry of the incumbent, and how the search ended.

    Raises:
        RunError: The record doesn't fit the optimizer, or the disk failed.
    """
    if budget is not None and budget < 1:
        raise RunError(f"budget is {budget}; it must be at least 1")
    folder.drop_cut_line()
    best: RecordedEvaluation | None = None
    started, fresh, pace = time.monotonic(), 0, 0.0
    ending: Ending = "budget"
    stopped = False
    lowest: list[float] = []
    recorded, scale, ahead = folder.record(), None, _Ahead(problem, space, optimizer)
    most = sys.maxsize if budget is None else max(budget, len(recorded))
    for index in itertools.count():
        replayed = index < len(recorded)
        if index == len(recorded):
            started = time.monotonic()
        if not replayed and stopped:
            ending = "stopped"
            break
        if not replayed and (ended := _ended(optimizer, index, budget, started, minutes)):
            ending = ended
            break
        candidate = optimizer.ask()
        comparison = None
        if replayed:
            entry = recorded[index]
            _check_replay(entry, candidate, index, folder, space)
            if optimizer.needs_residual:
                comparison = ahead.comparison(candidate, most - index)
        else:
            began = time.monotonic()
            comparison = ahead.comparison(candidate, most - index)
            content = _entry(index, candidate, space, comparison)
            content["seconds"] = round(time.monotonic() - began, 3)
            folder.append(content)
            entry = RecordedEvaluation.model_validate(content)
            fresh += 1
        improved = not entry.failed and (best is None or entry.loss < best.loss)
        before = best
        if improved or best is None:
            best = entry
        if (best is not before and not replayed) or index == len(recorded) - 1:  # once for all that is replayed
            with writing(folder.best_path, RunError, "--resume goes on"):
                write_fit(folder.best_path, problem, best.values, loss=best.loss, evaluation=best.index)
        residual = comparison.residual_vector() if comparison is not None and optimizer.needs_residual else None
        if residual is not None and slopes is not None and not entry.failed:
            slopes.add(candidate.point, residual)
        if residual is not None and prior is not None:
            scale = scale or (_PRIOR * float(np.linalg.norm(residual)) if not entry.failed else None)
            residual = np.concatenate([residual, (scale or 0.0) * (candidate.point - prior)])
        stages = () if residual is None or comparison is None or entry.failed else comparison.residual_stages()
        figures = entry.evidence.model_dump(exclude_unset=True)
        made = Evaluation(candidate, entry.loss, entry.failed, figures, residual, stages)
        if comparison is not None and stages:
            made = replace(
                made, margins=comparison.first_beats, parts=comparison.residual_parts, widths=comparison.residual_widths
            )
        optimizer.tell(made)
        pace = (time.monotonic() - started) / (fresh or index + 1)
        left = [one for one in (optimizer.left or None, None if budget is None else budget - index - 1)
                if one is not None]  # fmt: skip
        lowest.append(best.loss)
        quarter = lowest[3 * len(lowest) // 4 - 1]
        gained = (quarter - best.loss) / max(quarter, 1e-300) if index else 1.0
        seconds = pace * min(left) if left else None
        progress = Progress(
            index + 1, budget, entry.loss, best.loss, candidate.note, improved, seconds, replayed, optimizer.ends,
            gained, best.evidence.error, best.values,
        )  # fmt: skip
        try:
            on_progress(progress)
        except StoppedError:
            stopped = True
        except KeyboardInterrupt:
            if replayed:  # nothing is new
                raise
            ending = "interrupted"
            break
    if best is None:
        raise RunError("nothing was evaluated")
    seconds = None if optimizer.left is None else pace * optimizer.left
    return best, Search(ending, optimizer.conclusion, len(lowest), tuple(optimizer.ends), seconds)


def _ended(optimizer: Optimizer, made: int, budget: int | None, started: float, minutes: float | None) -> Ending | None:
    """What ends a search before its next evaluation; None where nothing does."""
    if optimizer.done:
        return "most" if optimizer.gave_up else "done"
    if budget is not None and made >= budget:
        return "budget"
    return "minutes" if minutes is not None and time.monotonic() - started > 60 * minutes else None


class _Ahead:
    """Evaluates a candidate together with those that the optimizer will ask next whatever comes of it."""

    def __init__(self, problem: Problem, space: ParameterSpace, optimizer: Optimizer) -> None:
        self._problem, self._space, self._optimizer = problem, space, optimizer
        self._coming: deque[Candidate] = deque()
        self._comparisons: Iterator[Comparison] = iter(())

    def comparison(self, candidate: Candidate, most: int) -> Comparison:
        """The comparison of the candidate that was asked last; no more than so many are made at a time."""
        if not self._coming:
            self._coming.extend([candidate, *self._optimizer.upcoming()][:most])
            values = [self._space.to_values(one.point) for one in self._coming]
            self._comparisons = self._problem.evaluate_each(values)
        self._coming.popleft()
        return next(self._comparisons)


def _entry(index: int, candidate: Candidate, space: ParameterSpace, comparison: Comparison) -> dict[str, object]:
    return {
        "index": index,
        "loss": comparison.loss,
        "failed": comparison.divergence is not None,
        "reason": comparison.divergence,
        "point": [float(x) for x in candidate.point],
        "values": space.to_values(candidate.point),
        "note": dict(candidate.note),
        "evidence": evidence(comparison),
    }


def _check_replay(
    entry: RecordedEvaluation, candidate: Candidate, index: int, folder: RunFolder, space: ParameterSpace
) -> None:
    if not np.array_equal(entry.point, candidate.point) or not _same_values(
        entry.values, space.to_values(candidate.point)
    ):
        raise RunError(
            f"run '{folder.path}' can't go on: evaluation {index + 1} on record isn't the one that these settings ask "
            f"for (another version of swim2real, another kind of processor, or an edited record?); begin a new run"
        )


def _same_values(recorded: Values, values: Values) -> bool:
    """True if values are those of a candidate; another processor may give its logarithms other last digits."""
    return all(
        name in recorded and math.isclose(recorded[name], value, rel_tol=1e-9, abs_tol=1e-300)
        for name, value in values.items()
    )


def write_fit(path: Path, problem: Problem, values: Values, **notes: Any) -> None:
    """Writes values as a parameters file of the problem's robot and physics, whole or not at all.

    Raises:
        OSError: It can't be written.
    """
    robot, engine = problem.robot, problem.engine
    write_parameters(path, robot.name, values, engine.name, engine.as_dict(), robot.source, **notes)
