"""Which parameters the trials determine at a run's best fit, and which make up for one another.

First the fit is improved, since profiles around a point that isn't a minimum say little. Then come its neighborhood and
the profile of each parameter. When a profile comes upon a clearly better fit, the study begins again there. After each
of these what is known is on the disk, so an interrupted study goes on there, to the same file and the same counts.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, FiniteFloat, NonNegativeInt

from swim2real import store
from swim2real.calibration.file_models import Share
from swim2real.calibration.loop import write_fit
from swim2real.calibration.provenance import commit, versions
from swim2real.checking import check
from swim2real.errors import RunError
from swim2real.identification.finished_run import FinishedRun
from swim2real.identification.gauss_newton import STEP, EvaluatedPoint, Evaluator, jacobian, refit
from swim2real.identification.neighborhood import DRAWS, neighborhood, pulls
from swim2real.identification.profile import DISTANCES, ProfilePoint, profile, summarize
from swim2real.settings import IdentifiabilitySettings

FORMAT = 1
IDENTIFIABILITY = "identifiability.json"
IDENTIFIED = "identified.json"  # the parameters file of the lowest point that was seen
_POLISH_ROUNDS = 2
_RECENTERS = 3  # times that a study begins again at a clearly better fit that a profile came upon
_BETTER = 0.5  # of the rise that counts, by which a fit is clearly better


class _Point(BaseModel):
    """A point of the unit cube with its loss."""

    point: list[Share]
    loss: FiniteFloat


class _Profile(BaseModel):
    """The profile of a parameter, as far as it is read again."""

    points: list[_Point]


class _Study(BaseModel):
    """The file of a study, as far as it is read again."""

    format: Literal[1]
    complete: bool
    evaluations: NonNegativeInt
    recentered: NonNegativeInt
    start: _Point
    fit: _Point | None = None
    lowest: _Point | None = None
    profiles: dict[str, _Profile] = {}


@dataclass(frozen=True)
class StudyProgress:
    """What a person wants to see while it goes on.

    Attributes:
        evaluations: Number of evaluations so far.
        most: An upper limit for their number; it grows when the study begins again at a better fit.
        stage: What is being worked out.
        finished: A profile that has just been finished, or None.
    """

    evaluations: int
    most: int
    stage: str
    finished: dict[str, Any] | None = None


def identify(
    run: FinishedRun, settings: IdentifiabilitySettings | None = None, again: bool = False,
    on_progress: Callable[[StudyProgress], None] = lambda progress: None,
) -> dict[str, Any]:  # fmt: skip
    """Studies a run's best fit, or goes on with the study that is there, into identifiability.json of its folder.

    The lowest point that is on record there is also a parameters file, identified.json.

    Args:
        run: The run; its folder is locked meanwhile.
        settings: Settings of the study.
        again: Whether to begin anew even if there is a study.
        on_progress: Called after each batch of evaluations; what it raises ends the study, which goes on from there
            when called again.

    Returns:
        The content of the file.

    Raises:
        RunError: The study that is there was made with other settings, or the folder can't be written.
    """
    with run.folder.locked():
        return _Profiling(run, settings or IdentifiabilitySettings(), on_progress).run(again)


def most_evaluations(settings: IdentifiabilitySettings, dimension: int, starts_are_seen: bool = False) -> int:
    """An upper limit for a study of this many parameters that needn't begin again."""
    values = 2 * len(DISTANCES)
    polish = _POLISH_ROUNDS * (2 * dimension + 3 * settings.polish) if settings.polish else 0
    draws = 1 + DRAWS if starts_are_seen else 0
    return 2 + polish + 2 * dimension + draws + dimension * values * (5 + 3 * settings.steps)


class _Profiling:
    """A study as it goes on."""

    def __init__(
        self, run: FinishedRun, settings: IdentifiabilitySettings, on_progress: Callable[[StudyProgress], None]
    ) -> None:
        self._run, self._settings, self._tell = run, settings, on_progress
        self._names = run.space.names
        self._path = run.folder.path / IDENTIFIABILITY
        self._starts_are_seen = any(trial.start_is_seen for trial in run.problem.prepared)
        self._most_of_one = most_evaluations(settings, len(self._names), self._starts_are_seen)
        self._most = self._most_of_one
        self._stage = ""
        self._before = 0
        self._evaluate = Evaluator(run.problem, run.space, self._count)
        self._begun = {
            "format": FORMAT,
            **run.conditions(),
            "settings": asdict(settings),
            "start": {"point": list(run.best.point), "loss": run.best.loss},
        }

    def _count(self, count: int) -> None:
        self._tell(StudyProgress(self._before + count, self._most, self._stage))

    def run(self, again: bool) -> dict[str, Any]:
        earlier = None if again else self._earlier()
        state: dict[str, Any] = earlier or {}
        if earlier is None:
            state = {**self._begun, "complete": False, "evaluations": 0, "recentered": 0}
        if state["complete"]:
            self._write_lowest(state)
            return state
        self._before = state["evaluations"]
        if "fit" not in state:
            self._fit(state, np.array(state["start"]["point"]))
        while not self._profiled(state):
            state["recentered"] += 1
            self._most = state["evaluations"] + self._most_of_one
            self._fit(state, np.array(state["lowest"]["point"]))
        state["complete"] = True
        state.update(versions=versions(), commit=commit(), created=datetime.now(UTC).isoformat(timespec="seconds"))
        self._write(state)
        return state

    def _fit(self, state: dict[str, Any], point: NDArray[np.float64]) -> None:
        self._stage = "improving the fit"
        best = self._polished(point)
        state["fit"] = {"point": best.point.tolist(), "loss": best.loss}
        state["profiles"] = {}
        state.pop("local", None)
        self._write(state)

    def _profiled(self, state: dict[str, Any]) -> bool:
        """Neighborhood and profiles around the fit; False when one came upon a clearly better fit."""
        self._stage = "slopes"
        counted, known = self._evaluate.count, "local" in state
        best = self._evaluate([np.array(state["fit"]["point"])])[0]
        slopes, jumps = jacobian(self._evaluate, best)
        if known:  # the study goes on, and counted these before
            self._before -= self._evaluate.count - counted
        else:
            state["local"] = self._local_content(best, slopes)
            state["local"]["jumps"] = [self._names[i] for i in jumps]
            self._write(state)
        rise = self._settings.rise * best.loss
        for index, name in enumerate(self._names):
            if name not in state["profiles"]:
                self._stage = name
                points = profile(self._evaluate, best, slopes, index, rise, self._settings.steps)
                state["profiles"][name] = self._summary(points, index, rise)
                state["lowest"] = self._lowest(state)
                self._write(state)
                done = {"name": name, **state["profiles"][name]}
                self._tell(StudyProgress(state["evaluations"], self._most, name, done))
            if state["lowest"]["loss"] < best.loss - _BETTER * rise and state["recentered"] < _RECENTERS:
                return False
        return True

    def _earlier(self) -> dict[str, Any] | None:
        """The study that is on the disk, None where there is none."""
        if not self._path.is_file():
            return None
        study = read_study(self._path)
        for key, value in self._begun.items():
            if study.get(key) != value:
                raise RunError(
                    f"'{self._path}' is a study with another {key}: it was {json.dumps(study.get(key))[:80]} and is "
                    f"now {json.dumps(value)[:80]}; begin anew with --again"
                )
        return study

    def _polished(self, point: NDArray[np.float64]) -> EvaluatedPoint:
        best = self._evaluate([point])[0]
        free = np.ones(len(best.point), dtype=bool)
        for _ in range(_POLISH_ROUNDS if self._settings.polish else 0):
            slopes, _ = jacobian(self._evaluate, best)
            refitted, _ = refit(self._evaluate, best, slopes, free, self._settings.polish)
            best = min((best, refitted), key=lambda point: point.loss)
        return best

    def _local_content(self, best: EvaluatedPoint, slopes: NDArray[np.float64]) -> dict[str, Any]:
        drawn = pulls(self._evaluate, best, slopes) if self._starts_are_seen else np.zeros((0, len(self._names)))
        enough = 2 * len(drawn) >= DRAWS
        around = neighborhood(slopes, best.residual, self._run.problem.blocks(), drawn if enough else None)
        errors = around.standard_errors
        values = [_around(self._run, best.point, i, float(e)) for i, e in enumerate(errors)]
        return {
            "step": STEP,
            "misfit": best.misfit,
            "rise": self._settings.rise * best.loss,
            "effective_count": around.effective_count,
            "starts_left_out": self._starts_are_seen and not enough,
            "standard_errors": {
                name: {"cube": float(e) if np.isfinite(e) else None, "values": v}
                for name, e, v in zip(self._names, errors, values, strict=True)
            },
            "correlations": around.correlations.tolist(),
            "directions": around.directions(self._names),
            "normal": around.normal.tolist(),
        }

    def _summary(self, points: list[ProfilePoint], index: int, rise: float) -> dict[str, Any]:
        summary = summarize(points, index, self._names, rise)
        ends = [_value(self._run, index, at) for at in summary["interval"]]
        return {**summary, "values": ends, "points": [point.as_dict() for point in points]}

    def _lowest(self, state: dict[str, Any]) -> dict[str, Any]:
        points = [point for summary in state["profiles"].values() for point in summary["points"]]
        lowest = min(points, key=lambda point: point["loss"])
        return {"point": lowest["point"], "loss": lowest["loss"]}

    def _write(self, state: dict[str, Any]) -> None:
        state["evaluations"] = self._before + self._evaluate.count
        self._run.folder.write_json(self._path.name, state)
        self._write_lowest(state)

    def _write_lowest(self, state: dict[str, Any]) -> None:
        known = [state[key] for key in ("start", "fit", "lowest") if key in state]
        lowest = min(known, key=lambda point: point["loss"])
        place = self._run.folder.path / IDENTIFIED
        try:
            write_fit(place, self._run.problem, self._run.space.to_values(lowest["point"]), loss=lowest["loss"])
        except OSError as error:
            raise RunError(f"can't write '{place}': {store.reason(error)}; the same command goes on") from error


def _value(run: FinishedRun, index: int, at: float) -> float:
    point = np.full(len(run.space), 0.5)
    point[index] = at
    return float(run.space.to_array(point)[index])


def _around(run: FinishedRun, point: NDArray[np.float64], index: int, error: float) -> list[float]:
    """Values a standard error below and above, cut at the bounds."""
    return [_value(run, index, float(np.clip(point[index] + sign * error, 0.0, 1.0))) for sign in (-1.0, 1.0)]


def read_study(path: str | Path) -> dict[str, Any]:
    """The content of an identifiability.json, complete or not.

    Raises:
        RunError: Not there, damaged, or of another format.
    """
    try:
        content = store.read_json(path)
    except FileNotFoundError:
        raise RunError(f"'{path}' is not there; swim2real identify writes it") from None
    except (OSError, ValueError) as error:
        raise RunError(f"'{path}' can't be read: {error}; begin anew with --again") from error
    check(_Study, content, f"'{path}'", RunError, "begin anew with --again")
    return content
