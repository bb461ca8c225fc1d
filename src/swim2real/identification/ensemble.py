"""Many parameter sets that fit nearly as well as the best: what a policy should be trained on instead of one fit.

Sets come from the records of runs and from what `identify` found to fit as well as the noise allows. A subset that is
spread out is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import MinLen
from pydantic import BaseModel

from swim2real.calibration.provenance import made_by
from swim2real.identification.finished_run import FinishedRun
from swim2real.identification.identifiability import study_of
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.settings import EnsembleSettings
from swimbase import store
from swimbase.arrays import Array
from swimbase.checking import read
from swimbase.errors import ArgumentError, ParameterError, RunError

FORMAT = 1


@dataclass(frozen=True)
class Member:
    """A parameter set.

    Attributes:
        point: Coordinates in the unit cube. Shape (d,).
        loss: Its loss [m].
        source: Where it is from: `record` or `identify`.
    """

    point: Array
    loss: float
    source: str


def make_ensemble(runs: Sequence[FinishedRun], settings: EnsembleSettings | None = None) -> dict[str, Any]:
    """Gathers and thins out near-best parameter sets.

    Args:
        runs: Runs with the same robot, protocol, trials, reference and engine.
        settings: Settings of the ensemble.

    Returns:
        The content of the file: `members` with `parameters`, `loss` and `source`, the best first; `ranges` of each
        parameter with `unit`, `min`, `p5`, `median`, `p95`, `max` of its values; and the conditions of the runs.

    Raises:
        RunError: The runs don't fit together.
    """
    wanted = settings or EnsembleSettings()
    conditions = _common_conditions(runs)
    first = runs[0]
    pool = [member for run in runs for member in _gathered(run)]
    best = min(pool, key=lambda member: member.loss)
    limit = best.loss * wanted.within
    pool = _near(pool, limit)
    kept = spread_out(pool, wanted.count)
    values = np.array([first.space.to_array(member.point) for member in kept])
    members = [
        {"parameters": first.space.to_values(m.point), "loss": m.loss, "source": m.source, "point": m.point.tolist()}
        for m in kept
    ]
    return {
        "format": FORMAT,
        "kind": "ensemble",
        **conditions,
        "runs": [str(run.folder.path) for run in runs],
        "settings": asdict(wanted),
        "best_loss": best.loss,
        "limit": limit,
        "candidates": len(pool),
        "ranges": _ranges(runs[0], values),
        "members": members,
        **made_by(),
    }


def spread_out(members: Sequence[Member], count: int) -> list[Member]:
    """The best, then always the member farthest from those that were taken, sorted by loss."""
    left = sorted(members, key=lambda member: member.loss)
    points = np.array([member.point for member in left])
    taken, distance = [0], np.linalg.norm(points - points[0], axis=1)
    while len(taken) < min(count, len(left)):
        farthest = int(np.argmax(distance))
        if distance[farthest] <= 0:  # what is left are doubles
            break
        taken.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(points - points[farthest], axis=1))
    return [left[i] for i in sorted(taken)]


def write_ensemble(path: str | Path, content: dict[str, Any]) -> None:
    """Writes an ensemble, whole or not at all."""
    with store.writing(path, RunError, what="ensemble"):
        store.write_json(path, content)


class _MemberFile(BaseModel):
    parameters: dict[str, object]


class _EnsembleFile(BaseModel):
    kind: Literal["ensemble"]
    format: Literal[1]
    robot: str
    members: Annotated[list[_MemberFile], MinLen(1)]


def read_ensemble(path: str | Path, robot: Robot) -> list[Values]:
    """The parameter sets of an ensemble file, the best first, checked against the robot's space.

    Raises:
        ParameterError: Not there, not JSON, no ensemble, of another robot, or with a value that is not allowed.
    """
    content = read(_EnsembleFile, path, "ensemble", ParameterError, "swim2real ensemble writes one")
    if content.robot != robot.name:
        raise ParameterError(f"ensemble '{path}' is for robot {content.robot!r}, not '{robot.name}'")
    return [
        robot.space.check(member.parameters, where=f"'{path}', member {number}")
        for number, member in enumerate(content.members, start=1)
    ]


def _common_conditions(runs: Sequence[FinishedRun]) -> dict[str, object]:
    if not runs:
        raise ArgumentError("an ensemble needs at least one run")
    first = runs[0].conditions()
    for run in runs[1:]:
        for key, value in run.conditions().items():
            if value != first[key]:
                raise RunError(
                    f"runs '{runs[0].folder.path}' and '{run.folder.path}' can't be put together: {key} is "
                    f"{str(first[key])[:60]} and {str(value)[:60]}"
                )
    return first


def _gathered(run: FinishedRun) -> list[Member]:
    """The points that the run evaluated, and those that a study of it found to fit."""
    recorded = [Member(np.array(entry.point), entry.loss, "record") for entry in run.record]
    study = study_of(run.folder)
    if study is None or study.difference(run.conditions()):
        return recorded
    return recorded + [Member(np.array(one.point), one.loss, "identify") for one in (study.lowest, *study.checked)]


def _near(members: Sequence[Member], limit: float) -> list[Member]:
    seen: set[bytes] = set()
    kept: list[Member] = []
    for member in members:
        if member.loss <= limit and member.point.tobytes() not in seen:
            seen.add(member.point.tobytes())
            kept.append(member)
    return kept


def _ranges(run: FinishedRun, values: Array) -> dict[str, dict[str, str | float]]:
    quantiles = np.percentile(values, (0, 5, 50, 95, 100), axis=0).T
    names = ("min", "p5", "median", "p95", "max")
    return {
        parameter.name: {"unit": parameter.unit, **dict(zip(names, map(float, row), strict=True))}
        for parameter, row in zip(run.space, quantiles, strict=True)
    }
