"""Which parameters the trials determine: intervals and directions of the sets that fit as well as the noise allows.

The study draws sets (`posterior`), beginning with what the run came upon. After each batch of evaluations what is known
is on the disk, so an interrupted study goes on there, to the same file and the same counts. Where it comes upon a lower
loss than the run's, that point is taken over.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, FiniteFloat, NonNegativeInt

from swim2real import store
from swim2real.calibration.convergence import marker_noise
from swim2real.calibration.file_models import Share
from swim2real.calibration.loop import write_fit
from swim2real.calibration.provenance import commit, versions
from swim2real.checking import check
from swim2real.errors import RunError
from swim2real.identification.evaluated import EvaluatedPoint, evaluated, independent_numbers
from swim2real.identification.finished_run import FinishedRun
from swim2real.identification.posterior import BATCH, Posterior, draw, first_points
from swim2real.settings import IdentifiabilitySettings

Array = NDArray[np.float64]

FORMAT = 2
IDENTIFIABILITY = "identifiability.json"
IDENTIFIED = "identified.json"  # the parameters file of the lowest point that was seen
EVALUATED = "identifiability.npz"  # evaluated points with their residuals, from which an interrupted study goes on
_SHARES = {"50": (25.0, 75.0), "95": (2.5, 97.5)}  # percentiles at the ends of each interval
_KNOWN, _OPEN = 0.25, 0.8  # of the range: widest 95 % interval of an identified parameter, narrowest of an unknown one
_NAMED = 0.8  # of a direction's square that its named parameters hold
_KEPT = 200  # draws in the file


class _Point(BaseModel):
    """A point of the unit cube with its loss."""

    point: list[Share]
    loss: FiniteFloat


class _Study(BaseModel):
    """The file of a study, as far as it is read again."""

    format: Literal[2]
    complete: bool
    evaluations: NonNegativeInt
    start: _Point
    lowest: _Point
    checked: list[_Point] = []


@dataclass(frozen=True)
class StudyProgress:
    """What a person wants to see while it goes on.

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
    on_progress: Callable[[StudyProgress], None] = lambda progress: None,
) -> dict[str, Any]:  # fmt: skip
    """Studies a run, or goes on with the study that is there, into identifiability.json of its folder.

    The point with the lowest loss is also a parameters file, identified.json.

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
        return _Studying(run, settings or IdentifiabilitySettings(), on_progress).run(again)


class _Studying:
    """A study as it goes on."""

    def __init__(
        self, run: FinishedRun, settings: IdentifiabilitySettings, on_progress: Callable[[StudyProgress], None]
    ) -> None:
        self._run, self._settings, self._tell = run, settings, on_progress
        self._first = first_points([(np.array(entry.point), entry.loss) for entry in run.record])
        self._most = len(self._first) + BATCH * settings.rounds
        self._evaluated: list[EvaluatedPoint] = []
        self._given = 0
        start = {"point": list(run.best.point), "loss": run.best.loss}
        self._state: dict[str, Any] = {
            "format": FORMAT, **run.conditions(), "settings": asdict(settings), "start": start, "lowest": start,
            "complete": False, "evaluations": 0,
        }  # fmt: skip

    def run(self, again: bool) -> dict[str, Any]:
        if not again:
            earlier = self._earlier()
            if earlier is not None and earlier["complete"]:
                self._write(earlier)
                return earlier
        blocks = self._run.problem.blocks()
        found = draw(
            self._evaluate, self._first, lambda residual: independent_numbers(residual, blocks), self._settings.rounds,
            self._settings.seed,
        )  # fmt: skip
        self._state |= self._content(found)
        self._state |= {"complete": True, "versions": versions(), "commit": commit()}
        self._state["created"] = datetime.now(UTC).isoformat(timespec="seconds")
        self._write(self._state)
        (self._run.folder.path / EVALUATED).unlink(missing_ok=True)
        return self._state

    def _evaluate(self, points: Sequence[Array]) -> list[EvaluatedPoint]:
        """Evaluates points, those apart that an interrupted study evaluated before."""
        for first in range(0, len(points), BATCH):
            batch = points[first : first + BATCH]
            if self._given + len(batch) > len(self._evaluated):
                self._evaluated += evaluated(self._run.problem, self._run.space, batch)
                self._keep()
            self._given += len(batch)
            self._tell(StudyProgress(self._given, self._most, self._state["lowest"]["loss"]))
        return self._evaluated[self._given - len(points) : self._given]

    def _keep(self) -> None:
        known = [one for one in self._evaluated if not one.failed]
        lowest = min(known, key=lambda one: one.loss, default=None)
        if lowest is not None and lowest.loss < self._state["lowest"]["loss"]:
            self._state["lowest"] = {"point": lowest.point.tolist(), "loss": lowest.loss}
        self._state["evaluations"] = len(self._evaluated)
        arrays = {
            "points": [one.point for one in self._evaluated], "losses": [one.loss for one in self._evaluated],
            "residuals": [one.residual for one in self._evaluated], "failed": [one.failed for one in self._evaluated],
        }  # fmt: skip
        try:
            store.write_arrays(self._run.folder.path / EVALUATED, arrays)
        except OSError as error:
            raise RunError(f"can't write '{EVALUATED}': {store.reason(error)}; the same command goes on") from error
        self._write(self._state)

    def _earlier(self) -> dict[str, Any] | None:
        """The study that is on the disk, None where there is none; what it evaluated is taken over."""
        path = self._run.folder.path / IDENTIFIABILITY
        if not path.is_file():
            return None
        study = read_study(path)
        for key in ("format", *self._run.conditions(), "settings", "start"):
            if study.get(key) != self._state[key]:
                raise RunError(
                    f"'{path}' is a study with another {key}: it was {json.dumps(study.get(key))[:80]} and is "
                    f"now {json.dumps(self._state[key])[:80]}; begin anew with --again"
                )
        kept = self._run.folder.path / EVALUATED
        if not study["complete"] and kept.is_file():
            try:
                tables = store.read_arrays(kept)
                rows = zip(*(tables[name] for name in ("points", "losses", "residuals", "failed")), strict=True)
                self._evaluated = [EvaluatedPoint(p, float(e), r, bool(f)) for p, e, r, f in rows]
            except (OSError, ValueError, KeyError) as error:
                raise RunError(f"'{kept}' can't be read: {error}; begin anew with --again") from error
            self._state |= {"lowest": study["lowest"], "evaluations": study["evaluations"]}
        return study

    def _content(self, found: Posterior) -> dict[str, Any]:
        space, noise = self._run.space, marker_noise([trial.track for trial in self._run.problem.trials])
        ends = {share: np.percentile(found.draws, at, axis=0) for share, at in _SHARES.items()}
        values = {share: [space.to_array(end) for end in both] for share, both in ends.items()}
        median = space.to_array(np.median(found.draws, axis=0))
        parameters = {
            name: {
                "median": float(median[i]),
                **{f"interval_{share}": [float(end[i]) for end in both] for share, both in values.items()},
                "width": float(ends["95"][1][i] - ends["95"][0][i]),
                "verdict": _verdict(float(ends["95"][1][i] - ends["95"][0][i])),
            }
            for i, name in enumerate(space.names)
        }
        kept = found.draws[np.linspace(0, len(found.draws) - 1, _KEPT).astype(int)]
        return {
            "parameters": parameters,
            "directions": directions(found.draws, space.names),
            "determined": found.determined,
            "weight": found.weight / len(self._run.problem.trials),  # of the mean square of one trial [1/m²]
            "noise": noise,
            "misfit": min(one.misfit for one in (*found.checked, found.lowest)),
            "draws": np.round(kept, 6).tolist(),
            "checked": [{"point": one.point.tolist(), "loss": one.loss} for one in found.checked],
        }

    def _write(self, state: dict[str, Any]) -> None:
        self._run.folder.write_json(IDENTIFIABILITY, state)
        place, lowest = self._run.folder.path / IDENTIFIED, state["lowest"]
        try:
            write_fit(place, self._run.problem, self._run.space.to_values(lowest["point"]), loss=lowest["loss"])
        except OSError as error:
            raise RunError(f"can't write '{place}': {store.reason(error)}; the same command goes on") from error


def _verdict(width: float) -> str:
    return "identified" if width <= _KNOWN else "not identified" if width >= _OPEN else "weak"


def directions(draws: Array, names: Sequence[str]) -> list[dict[str, Any]]:
    """Principal axes of sets, the one that is determined best first.

    Args:
        draws: Points of the unit cube. Shape (K, d).
        names: Of the parameters.

    Returns:
        For each the `spread`, the standard deviation along it, relative to that of a parameter that nothing
        determines, and the `parameters` that hold most of it with their shares of the vector, the largest first.
    """
    values, vectors = np.linalg.eigh(np.cov(draws.T))
    found: list[dict[str, Any]] = []
    for value, vector in zip(values, vectors.T, strict=True):
        order = np.argsort(-np.abs(vector))
        count = int(np.searchsorted(np.cumsum(vector[order] ** 2), _NAMED)) + 1
        sign = np.sign(vector[order[0]])
        held = {names[i]: float(sign * vector[i]) for i in order[:count]}
        found.append({"spread": float(np.sqrt(max(12 * value, 0.0))), "parameters": held})
    return found


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
