"""Which parameters the trials determine: intervals and directions of the sets that fit as well as the noise allows.

The study draws sets (`posterior`), beginning with what the run came upon. After each batch of evaluations what is known
is on the disk, so an interrupted study goes on there, to the same file and the same counts. Where it comes upon a lower
loss than the run's, that point is taken over.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import BaseModel, FiniteFloat, NonNegativeFloat, NonNegativeInt, model_validator

from swim2real.calibration.convergence import ends_of, noise_of
from swim2real.calibration.file_models import Share
from swim2real.calibration.loop import write_fit
from swim2real.calibration.provenance import made_by
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.sensitivity import Slopes
from swim2real.calibration.verdict import AT_NOISE
from swim2real.identification.evaluated import EvaluatedPoint, evaluated, independent_numbers
from swim2real.identification.finished_run import FinishedRun
from swim2real.identification.posterior import BATCH, Posterior, draw, first_points
from swim2real.optimizers.enough import AGREEMENT, agreeing
from swim2real.parameters import Values
from swim2real.parameters.known import Known, known
from swim2real.robots.robot import Robot
from swim2real.settings import IdentifiabilitySettings
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, TrialSet
from swimbase import store
from swimbase.arrays import Array
from swimbase.checking import read
from swimbase.errors import RunError

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 3
IDENTIFIABILITY = "identifiability.json"
IDENTIFIED = "identified.json"  # the parameters file of the lowest point that was seen
EVALUATED = "identifiability.npz"  # evaluated points with their residuals, from which an interrupted study goes on
_WIDER = 2.5  # times as wide as the draws' own, 95 % intervals hold 95 % of known truths (interval_coverage.py)
_SHARES = {"50": (25.0, 75.0, 1.15), "95": (2.5, 97.5, _WIDER)}  # percentiles of the draws, and how much wider
_FAR = 15.0  # times the noise of the markers; residuals of true values are 8 to 13 times as large in demo and snake
_NAMED = 0.8  # of a direction's square that its named parameters hold
_KEPT = 200  # draws in the file
PREDICTING = 25  # sets whose swims are a prediction
_FREQUENCIES, _SECONDS, _START_SPEED = 7, 4.0, 0.1  # of their swims; s; m/s, a first guess of the steady cycle


class _Point(BaseModel):
    """A point of the unit cube with its loss."""

    point: list[Share]
    loss: NonNegativeFloat


class Interval(BaseModel):
    """Interval of a parameter over the sets that fit, in its unit.

    Attributes:
        median: Half of the sets have more.
        interval_50: Holds the middle half of the sets.
        interval_95: Is as wide as it takes to hold 95 % of known true values.
        width: Of the latter, as a share of the parameter's range.
        known: How well the trials determine it, as `parameters.known` defines it.
    """

    median: FiniteFloat
    interval_50: tuple[FiniteFloat, FiniteFloat]
    interval_95: tuple[FiniteFloat, FiniteFloat]
    width: FiniteFloat
    known: Known


class Direction(BaseModel):
    """A principal axis of the sets that fit.

    Attributes:
        spread: Standard deviation along it, relative to that of a parameter that nothing determines.
        parameters: Those that hold most of it, with their shares of the unit vector, the largest first.
    """

    spread: FiniteFloat
    parameters: dict[str, FiniteFloat]


class _PredictedSpeeds(BaseModel):
    """Steady forward speed over the frequency of the motor, by the sets that fit.

    Attributes:
        frequencies: F frequencies [Hz].
        speeds: Ends of the interval that holds 90 % of the sets, and their median [m/s]; F of each.
    """

    frequencies: list[FiniteFloat]
    speeds: tuple[list[FiniteFloat], list[FiniteFloat], list[FiniteFloat]]


class Study(BaseModel, extra="allow"):
    """The file of a study; what is found is there once it is complete. The conditions of its run are further keys.

    Attributes:
        parameters: Their names.
        complete: Whether it is done.
        evaluations: Their number so far.
        start: The run's best point.
        lowest: The lowest point that run or study came upon.
        intervals: By parameter.
        directions: The best determined one first.
        determined: Number of directions that the trials determine.
        noise: Noise of the markers, or of the readings where there are none [m].
        doubt: Why no parameter counts as determined, in a sentence; empty where some may.
        misfit: Root of the lowest mean square of the residual [m].
        weight: What the mean square of one trial's residual counts in the draws' likelihood [1/m²].
        draws: Points of the unit cube, as likely as they fit.
        checked: Points near which the last draws were, with the losses that they had.
        speeds: What the sets predict, for robots whose trials have a beat.
    """

    format: Literal[3]
    parameters: list[str]
    complete: bool
    evaluations: NonNegativeInt
    start: _Point
    lowest: _Point
    intervals: dict[str, Interval] = {}
    directions: list[Direction] = []
    determined: FiniteFloat = 0.0
    noise: FiniteFloat | None = None
    misfit: FiniteFloat = 0.0
    doubt: str = ""
    weight: FiniteFloat = 0.0
    draws: list[list[Share]] = []
    checked: list[_Point] = []
    speeds: _PredictedSpeeds | None = None

    @model_validator(mode="after")
    def _one_number_per_parameter(self) -> Self:
        points = [self.start.point, self.lowest.point, *(one.point for one in self.checked), *self.draws]
        if any(len(point) != len(self.parameters) for point in points):
            raise ValueError("a point has another number of coordinates than there are 'parameters'")
        return self

    def content(self) -> dict[str, object]:
        """The file's content, without what isn't known yet."""
        return self.model_dump(mode="json", exclude_unset=True)

    def difference(self, conditions: Mapping[str, object]) -> str:
        """Conditions of the study that are others now, with their values then and now; empty if none is."""
        content = self.model_dump(mode="json")
        for key, value in conditions.items():
            if content.get(key) != value:
                then, now = (json.dumps(one)[:80] for one in (content.get(key), value))
                return f"another {key}: it was {then} and is now {now}"
        return ""

    def to_dataframe(self) -> pd.DataFrame:
        """The intervals by parameter, in its unit: `median`, `low` and `high` (95 %), `width` and `known`."""
        import pandas as pd

        rows = {name: (one.median, *one.interval_95, one.width, one.known) for name, one in self.intervals.items()}
        columns = ["median", "low", "high", "width", "known"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("parameter")


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study.

    Attributes:
        evaluations: Number of evaluations so far.
        most: Their number when it is done.
        lowest: Lowest loss so far [m].
    """

    evaluations: int
    most: int
    lowest: float


def identify(
    run: FinishedRun, settings: IdentifiabilitySettings | None = None, again: bool = False,
    on_progress: Callable[[StudyProgress], None] = lambda progress: None, check: Callable[[], None] = lambda: None,
) -> Study:  # fmt: skip
    """Studies a run, or goes on with the study that is there, into identifiability.json of its folder.

    The point with the lowest loss is also a parameters file, identified.json.

    Args:
        run: The run; its folder is locked meanwhile.
        settings: Settings of the study.
        again: Whether to begin anew even if there is a study.
        on_progress: Called after each evaluation.
        check: Called after each evaluation, and as chains go on; what it raises ends the study, which goes on from
            there when called again.

    Returns:
        The content of the file.

    Raises:
        RunError: The study that is there was made with other settings, or the folder can't be written.
    """
    with run.folder.locked():
        return _Studying(run, settings or IdentifiabilitySettings(), on_progress, check).run(again)


def known_so_far(run: FinishedRun) -> tuple[float, dict[str, tuple[float, float]]]:
    """Findings of an interrupted study: its lowest loss [m], and values within which its error rises by less than 10 %.

    Raises:
        RunError: There is no study, or it can't be read.
    """
    study, slopes = read_study(run.folder.path / IDENTIFIABILITY), Slopes(run.space)
    path = run.folder.path / EVALUATED
    tables = store.read_arrays(path) if path.is_file() else {"points": [], "residuals": [], "failed": []}
    for point, residual, failed in zip(tables["points"], tables["residuals"], tables["failed"], strict=True):
        if not failed:
            slopes.add(point, residual)
    return study.lowest.loss, slopes.ranges()


class _Studying:
    """A study as it goes on."""

    def __init__(
        self, run: FinishedRun, settings: IdentifiabilitySettings, on_progress: Callable[[StudyProgress], None],
        check: Callable[[], None],
    ) -> None:  # fmt: skip
        self._run, self._settings, self._tell, self._check = run, settings, on_progress, check
        self._first = first_points([(np.array(entry.point), entry.loss) for entry in run.record])
        self._most = len(self._first) + BATCH * settings.rounds
        self._evaluated: list[EvaluatedPoint] = []
        self._given = 0
        start = _start(run)
        self._study = Study.model_validate({
            "format": FORMAT, **run.conditions(), "settings": asdict(settings), "start": start, "lowest": start,
            "complete": False, "evaluations": 0,
        })  # fmt: skip

    def run(self, again: bool) -> Study:
        earlier = None if again else self._earlier()
        if earlier is not None and earlier.complete:
            self._write(earlier)
            return earlier
        blocks = self._run.problem.blocks()
        found = draw(
            self._evaluate, self._first, lambda residual: independent_numbers(residual, blocks), self._settings.rounds,
            self._settings.seed, self._check,
        )  # fmt: skip
        self._study = self._completed(found)
        self._write(self._study)
        return self._study

    def _evaluate(self, points: Sequence[Array]) -> list[EvaluatedPoint]:
        """Evaluates points, those apart that an interrupted study evaluated before."""
        for first in range(0, len(points), BATCH):
            batch = points[first : first + BATCH]
            if missing := batch[max(len(self._evaluated) - self._given, 0) :]:
                try:
                    for one in evaluated(self._run.problem, self._run.space, missing):
                        self._take(one)
                        self._tell(StudyProgress(len(self._evaluated), self._most, self._study.lowest.loss))
                        self._check()
                finally:
                    self._keep()
            self._given += len(batch)
        return self._evaluated[self._given - len(points) : self._given]

    def _take(self, one: EvaluatedPoint) -> None:
        self._evaluated.append(one)
        self._study.evaluations = len(self._evaluated)
        if not one.failed and one.loss < self._study.lowest.loss:
            self._study.lowest = _Point(point=one.point.tolist(), loss=one.loss)

    def _keep(self) -> None:
        arrays = {
            "points": [one.point for one in self._evaluated], "losses": [one.loss for one in self._evaluated],
            "residuals": [one.residual for one in self._evaluated], "failed": [one.failed for one in self._evaluated],
        }  # fmt: skip
        place = self._run.folder.path / EVALUATED
        with store.writing(place, RunError, "the same command goes on"):
            store.write_arrays(place, arrays)
        self._write(self._study)

    def _earlier(self) -> Study | None:
        """The study that is on the disk, None where there is none; what it evaluated is taken over."""
        if (study := study_of(self._run.folder)) is None:
            return None
        wanted = {**self._run.conditions(), "settings": asdict(self._settings), "start": _start(self._run)}
        if changed := study.difference(wanted):
            path = self._run.folder.path / IDENTIFIABILITY
            raise RunError(f"'{path}' is a study with {changed}; begin anew with --again")
        kept = self._run.folder.path / EVALUATED
        if not study.complete and kept.is_file():
            try:
                tables = store.read_arrays(kept)
                rows = zip(*(tables[name] for name in ("points", "losses", "residuals", "failed")), strict=True)
                for p, e, r, f in rows:  # they may be ahead of the file, if it was killed before that was written
                    self._take(EvaluatedPoint(p, float(e), r, bool(f)))
            except (OSError, ValueError, KeyError) as error:
                raise RunError(f"'{kept}' can't be read: {error}; begin anew with --again") from error
        return study

    def _completed(self, found: Posterior) -> Study:
        space, problem = self._run.space, self._run.problem
        noise = noise_of(problem.trials, problem.robot.trials.sensors)
        within = {share: interval(found.draws, share) for share in _SHARES}
        values = {share: [space.to_array(end) for end in both] for share, both in within.items()}
        median = space.to_array(np.median(found.draws, axis=0))
        misfit = min(one.misfit for one in (*found.checked, found.lowest))
        ends = ends_of(self._run.folder.record(), self._run.folder.outcome())
        doubt = doubted(misfit, noise, found.lowest.loss, ends)
        intervals = {
            name: Interval.model_validate(
                {
                    "median": float(median[i]),
                    **{f"interval_{share}": [float(end[i]) for end in both] for share, both in values.items()},
                    "width": float(within["95"][1][i] - within["95"][0][i]),
                    "known": known(float(within["95"][1][i] - within["95"][0][i]), not doubt),
                }
            )
            for i, name in enumerate(space.names)
        }
        axes = directions(found.draws, space.names)
        kept = found.draws[np.linspace(0, len(found.draws) - 1, _KEPT).astype(int)]
        content = {
            "complete": True,
            "intervals": intervals,
            "directions": axes,
            "determined": sum(1 - one.spread**2 for one in axes),
            "doubt": doubt,
            "weight": found.weight / len(problem.trials),  # of the mean square of one trial [1/m²]
            "noise": noise,
            "misfit": misfit,
            "draws": np.round(kept, 6).tolist(),
            "checked": [_Point(point=one.point.tolist(), loss=one.loss) for one in found.checked],
            "speeds": self._predicted(kept),
            **made_by(),
        }
        return self._study.model_copy(update=content)

    def _predicted(self, draws: Array) -> _PredictedSpeeds | None:
        """Speeds of steady swims that some of the sets predict, a third beyond the trials' frequencies."""
        problem = self._run.problem
        filmed = [trial.nominal_frequency for trial in problem.trials]
        if not isinstance(problem.simulator, Simulator) or None in filmed:
            return None
        known = [frequency for frequency in filmed if frequency is not None]
        frequencies = np.geomspace(min(known) / 1.3, max(known) * 1.3, _FREQUENCIES).round(3).tolist()
        swims = [Swim(f"{f:g} Hz", Actuation(f, 0.0, _START_SPEED), _SECONDS) for f in frequencies]
        sets = [self._run.space.to_values(draw) for draw in draws[:: len(draws) // PREDICTING]]
        made: list[TrialSet] = []
        for one in sets:  # one by one, so that Ctrl-C is answered between them
            self._check()
            made += problem.simulator.simulate_many([one], swims)
        speeds = [[trial.track.speed for trial in trials] for trials in made if not any(t.divergence for t in trials)]
        if not speeds:
            return None
        ends = np.percentile(speeds, (5, 50, 95), axis=0)
        return _PredictedSpeeds(frequencies=frequencies, speeds=ends.tolist())

    def _write(self, study: Study) -> None:
        self._run.folder.write_json(IDENTIFIABILITY, study.content())
        place, lowest = self._run.folder.path / IDENTIFIED, study.lowest
        with store.writing(place, RunError, "the same command goes on"):
            write_fit(place, self._run.problem, self._run.space.to_values(lowest.point), loss=lowest.loss)
        if study.complete:
            (self._run.folder.path / EVALUATED).unlink(missing_ok=True)


def interval(draws: Array, share: str) -> Array:
    """Interval of each parameter in the unit cube that holds that percentage of known true values.

    Args:
        draws: Points of the unit cube. Shape (K, d).
        share: Percentage, `50` or `95`.

    Returns:
        Lower and upper ends. Shape (2, d).
    """
    low, high, wider = _SHARES[share]
    median = np.median(draws, axis=0)
    return np.clip(median + wider * (np.percentile(draws, (low, high), axis=0) - median), 0.0, 1.0)


def doubted(misfit: float, noise: float | None, lowest: float, ends: Sequence[float]) -> str:
    """Why no parameter counts as determined; empty where some may.

    Args:
        misfit: Root of the lowest mean square of the residual [m].
        noise: Of the markers, or of the readings [m]; None where nothing tells it.
        lowest: Lowest loss that is known [m].
        ends: Losses at which descents from independent starts ended [m].
    """
    near = agreeing([lowest, *ends]) - 1
    if noise and misfit > _FAR * noise:
        why = (
            f"the residual's root mean square is {1e3 * misfit:.2f} mm, {misfit / noise:.0f} times the noise of the "
            f"data ({1e3 * noise:.2g} mm): the model is wrong, or a better fit wasn't found"
        )
    elif len(ends) < 2:
        why = (
            f"the run has followed {len(ends)} of its starts to the end, so one minimum was looked at, at most, and "
            f"another may fit as well"
        )
    elif near < 2 and (noise is None or misfit > AT_NOISE * noise):
        why = (
            f"of {len(ends)} starts that were followed to their end, {near} ended within {100 * AGREEMENT:.0f} % of "
            f"the lowest loss, {1e3 * lowest:.2f} mm, which is above the noise: a lower minimum may be left"
        )
    else:
        return ""
    return (
        f"No parameter counts as determined: {why}. Search on with swim2real calibrate --resume, without --budget, or "
        f"from another --seed; where that finds nothing, the model lacks something"
    )


def directions(draws: Array, names: Sequence[str]) -> list[Direction]:
    """Principal axes of sets, the one that is determined best first, as much wider as 95 % intervals are.

    Args:
        draws: Points of the unit cube. Shape (K, d).
        names: Of the parameters.
    """
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(draws.T)))
    found: list[Direction] = []
    for value, vector in zip(values, vectors.T, strict=True):
        order = np.argsort(-np.abs(vector))
        count = int(np.searchsorted(np.cumsum(vector[order] ** 2), _NAMED)) + 1
        sign = np.sign(vector[order[0]])
        held = {names[int(i)]: float(sign * vector[i]) for i in order[:count]}
        found.append(Direction(spread=float(np.sqrt(np.clip(12 * _WIDER**2 * value, 0.0, 1.0))), parameters=held))
    return found


def outdated(run: FinishedRun) -> bool:
    """True if there is a study of the run from before it went on to a lower loss.

    Raises:
        RunError: The study is damaged.
    """
    study = study_of(run.folder)
    return study is not None and bool(study.difference({"start": _start(run)}))


def _start(run: FinishedRun) -> dict[str, object]:
    return {"point": list(run.best.point), "loss": run.best.loss}


def sets_that_fit(folder: RunFolder, robot: Robot) -> list[Values]:
    """Some of the sets that a run's study found to fit, for predictions; none where it wasn't studied.

    Args:
        folder: Of the run.
        robot: That it calibrated.

    Raises:
        RunError: The study is damaged.
    """
    if (study := study_of(folder)) is None:
        return []
    space, draws = replace(robot.space, scale=folder.settings().resolved_scale), study.draws
    return [space.to_values(draw) for draw in draws[:: max(1, len(draws) // PREDICTING)]]


def study_of(folder: RunFolder) -> Study | None:
    """The study of a run, complete or not; None without one.

    Raises:
        RunError: The study is damaged.
    """
    path = folder.path / IDENTIFIABILITY
    return read_study(path) if path.is_file() else None


def read_study(path: str | Path) -> Study:
    """An identifiability.json, complete or not.

    Raises:
        RunError: Not there, damaged, or of another format.
    """
    return read(Study, path, "study", RunError, "begin anew with --again")
