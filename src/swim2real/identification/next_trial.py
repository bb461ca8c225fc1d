"""Which trial to film next: the one that is expected to leave the least of the region of the sets that fit.

For each possible trial the set that fits best stands in for the robot: what it does is simulated, and other sets of the
study are compared with that. How their residuals differ says which of them the trial would distinguish. A residual's
weight is the study's, so model error counts as noise here as well. All is taken as linear in the sets (ensemble Kalman
update: Evensen, Ocean Dynamics 53, 343 (2003)); what of the residuals isn't linear in the parameters counts as noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from markertrack.track import MarkerTrack
from motorline.commands import CommandTable, write_table
from swim2real.calibration.problem import Problem
from swim2real.calibration.provenance import made_by
from swim2real.identification.evaluated import EvaluatedPoint, evaluated
from swim2real.identification.finished_run import FinishedRun
from swim2real.identification.identifiability import IDENTIFIABILITY, study_of
from swim2real.identification.possible_trials import PossibleTrial, column_names
from swim2real.trials import TrialSet
from swimbase import store
from swimbase.arrays import Array
from swimbase.errors import RunError, TrialError

FORMAT = 1
NEXT, COMMANDS = "next.json", "next.csv"
_FEWEST = 8  # sets, beyond twice the parameters
_SETS, _EACH = 40, 5  # sets that are compared: so many, or so many times the parameters where that is more
_BATCH = 8  # sets between two looks at whether to stop
_MOST_FAILED = 1 / 3  # of the sets
_FLOOR = 1e-6  # of the largest spread, below which a direction isn't one


@dataclass(frozen=True)
class FittingSets:
    """The sets of a study.

    Attributes:
        draws: Points of the unit cube that fit. Shape (K, d).
        lowest: The one with the lowest loss. Shape (d,).
        weight: What a trial's mean square counts: the likelihood is exp(-weight S / 2) [1/m²].
    """

    draws: Array
    lowest: Array
    weight: float


@dataclass(frozen=True)
class JudgedTrial:
    """A possible trial and what is expected of it.

    Attributes:
        possible: The trial.
        volume: Expected volume of the sets' region, relative to now; infinite where nothing can be said.
        widths: Expected width of each parameter's interval, relative to now, by name.
        reason: Why nothing can be said; else empty.
    """

    possible: PossibleTrial
    volume: float = np.inf
    widths: dict[str, float] = field(default_factory=dict[str, float])
    reason: str = ""


def fitting_sets(run: FinishedRun) -> FittingSets:
    """The sets that `identify` found to fit.

    Raises:
        RunError: There is no study of this run, or it isn't complete.
    """
    path = run.folder.path / IDENTIFIABILITY
    first = f"run swim2real identify {run.folder.path} first"
    if (study := study_of(run.folder)) is None:
        raise RunError(f"run '{run.folder.path}' has no study of the sets that fit; {first}")
    if not study.complete:
        raise RunError(f"the study in '{path}' isn't complete; {first}, which goes on with it")
    if changed := study.difference(run.conditions()):
        raise RunError(f"'{path}' is a study with {changed}; {first}, with --again")
    fewest = 2 * len(run.space) + _FEWEST
    if len(study.draws) < fewest or study.weight <= 0:
        raise RunError(
            f"'{path}' has {len(study.draws)} sets of weight {study.weight:g}; there must be {fewest} or more, of a "
            f"weight above 0; {first}, with --again"
        )
    return FittingSets(np.array(study.draws), np.array(study.lowest.point), study.weight)


def judged_trials(
    run: FinishedRun, sets: FittingSets, possible: Sequence[PossibleTrial], seed: int = 0,
    pause: Callable[[], None] = lambda: None,
) -> Iterator[JudgedTrial]:  # fmt: skip
    """Judges possible trials, one after the other.

    Args:
        run: The run whose sets they are.
        sets: That fit.
        possible: The trials.
        seed: Decides which of the sets are compared.
        pause: Called every few seconds; what it raises ends the judging.
    """
    count = min(len(sets.draws), max(_SETS, _EACH * len(run.space)))
    spacing = len(sets.draws) / count
    places = (np.arange(count) + np.random.default_rng(seed).random()) * spacing
    chosen = list(sets.draws[places.astype(int)])
    values = run.space.to_values(sets.lowest)
    for one in possible:
        try:
            filmed = simulated_trial(run.problem, one, values)
            yield _judged(run, one, run.problem.of(filmed), chosen, sets.weight, pause)
        except TrialError as error:
            yield JudgedTrial(one, reason=str(error))


def simulated_trial(problem: Problem, possible: PossibleTrial, values: dict[str, float]) -> TrialSet:
    """A possible trial as if a robot with these values had been filmed in it.

    Raises:
        TrialError: The simulation diverged.
    """
    made = problem.simulator.simulate(values, [possible.request]).trials[0]
    if made.divergence:
        raise TrialError(f"with the set that fits best {made.divergence}")
    times, sampled = possible.trial.track.times, made.track
    since = sampled.times - sampled.times[0]
    track = MarkerTrack(times, CubicSpline(since, sampled.positions, axis=0)(times - times[0]))
    return TrialSet((replace(possible.trial, track=track, sensors=made.sensors),), problem.robot.marker_names)


def expected_reduction(points: Array, residuals: Array, weight: float) -> tuple[float, Array]:
    """Share of the region of sets that a trial is expected to leave.

    With the anomalies A of the points and R of the residuals, centered and divided by the root of m - 1, the covariance
    C = A Aᵀ becomes A (1 + w Rᵀ R)⁻¹ Aᵀ.

    Args:
        points: Points of the unit cube, more than parameters. Shape (m, d).
        residuals: What each would leave in the trial [m]. Shape (m, n).
        weight: What their squares count [1/m²].

    Returns:
        The volume, the root of the covariance's determinant, and each parameter's standard deviation, relative to now.
        Shape (d,).
    """
    scale = np.sqrt(len(points) - 1)
    around, apart = ((values - values.mean(axis=0)) / scale for values in (points, residuals))
    left, sizes, rows = np.linalg.svd(around.T, full_matrices=False)
    kept = sizes > _FLOOR * max(float(sizes[0]), _FLOOR)
    left, sizes, rows = left[:, kept], sizes[kept], rows[kept]
    told = np.eye(len(points)) + weight * np.einsum("in,jn->ij", apart, apart)
    shrunk = rows @ np.linalg.solve(told, rows.T)
    after = np.einsum("ai,ij,aj->a", left * sizes, shrunk, left * sizes)
    before = np.square(left * sizes).sum(axis=1)
    widths = np.sqrt(np.divide(after, before, out=np.ones_like(after), where=before > 0))
    return float(np.exp(0.5 * np.linalg.slogdet(shrunk)[1])), widths


def write_next(folder: Path, run: FinishedRun, judged: Sequence[JudgedTrial]) -> dict[str, Any]:
    """Writes next.json, and the commands of the proposed trial as next.csv.

    Args:
        folder: To write; made where it isn't there.
        run: The run.
        judged: All trials.

    Returns:
        The content of next.json: the trials sorted, the proposed one first.

    Raises:
        RunError: Nothing can be said of any of them, or the folder can't be written.
    """
    ranked = sorted(judged, key=lambda one: one.volume)
    if not ranked or ranked[0].reason:
        why = ranked[0].reason if ranked else "there is none"
        raise RunError(f"nothing can be said of any of the {len(ranked)} possible trials: {why}")
    content = {
        "format": FORMAT, "kind": "next trial", **run.conditions(), "run": str(run.folder.path),
        "candidates": [
            {"label": one.possible.label, "volume": one.volume, "widths": one.widths}
            for one in ranked if not one.reason
        ],
        "left_out": [{"label": one.possible.label, "reason": one.reason} for one in ranked if one.reason],
        **made_by(),
    }  # fmt: skip
    columns = column_names(run.problem.robot, ranked[0].possible.columns)
    with store.writing(folder, RunError, "give another folder with --out"):
        folder.mkdir(parents=True, exist_ok=True)
        write_table(folder / COMMANDS, CommandTable.of({name: column.tolist() for name, column in columns.items()}))
        store.write_json(folder / NEXT, content)
    return content


def _judged(
    run: FinishedRun, possible: PossibleTrial, problem: Problem, points: Sequence[Array], weight: float,
    pause: Callable[[], None],
) -> JudgedTrial:  # fmt: skip
    """Judges a trial by the sets that it would leave."""
    done: list[EvaluatedPoint] = []
    for first in range(0, len(points), _BATCH):
        done += evaluated(problem, run.space, points[first : first + _BATCH])
        pause()
    good = [one for one in done if not one.failed]
    failed = len(done) - len(good)
    if failed > _MOST_FAILED * len(done) or len(good) <= len(run.space):
        return JudgedTrial(possible, reason=f"the simulations of {failed} of {len(done)} sets diverge")
    volume, widths = expected_reduction(
        np.array([one.point for one in good]), np.array([one.residual for one in good]), weight
    )
    return JudgedTrial(possible, volume, dict(zip(run.space.names, map(float, widths), strict=True)))
