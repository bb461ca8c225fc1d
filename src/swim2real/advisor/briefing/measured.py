"""What single changes did that were measured, as plain data and in words: the sensitivities that a run has seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.differences import differences, mean
from swim2real.advisor.briefing.formatting import mm, number, table, value
from swim2real.optimizers import Evaluation, Situation
from swim2real.parameters import ParameterSpace

Facts = Mapping[str, Any]
TrialsOf = Callable[[Evaluation], Sequence[Facts]]

_HOW = (
    "A row a measurement: what was changed from the best point of its time, all else the same, and by how much other "
    "figures then differed from that point's. Such a change costs an evaluation and says more than a guess; effects of "
    "small changes add up, those of large ones don't."
)


def measured(situation: Situation, space: ParameterSpace, trials_of: TrialsOf) -> list[dict[str, Any]]:
    """Every measurement of the run in order: its change, and what it did to each trial.

    Args:
        situation: Situation as an advisor gets it.
        space: Parameters, as the optimizer uses them.
        trials_of: Facts of the trials of an evaluation.
    """
    best, rows = situation.first, list[dict[str, Any]]()
    turns = [(finished.measurements, finished.steps) for finished in situation.rounds]
    for measurements, steps in (*turns, (situation.measurements, ())):
        for one in measurements:
            rows.append({"changes": _changes(best, one, space), **_effects(trials_of(best), trials_of(one), best, one)})
            best = min((best, one), key=_loss)
        best = min((best, *(step.evaluation for step in steps)), key=_loss)
    return rows


def describe_measured(facts: Facts) -> str | None:
    """The section on measurements, None without any."""
    rows = facts["history"]["measured"]
    if not rows:
        return None
    trials = facts["incumbent"]["trials"]
    beats, named = facts["robot"]["beats"], max((len(row["by_trial"] or ()) for row in rows), default=0)
    speeds = facts["compared"]["score_progress"]
    names = [f"{t['frequency']:.2f} Hz" if beats else t["name"] for t in trials][:named]
    parts = [part for part in ("shape", "recoil") if any(row[part] is not None for row in rows)]
    unit = "% speed" if speeds else "mm"
    columns = ["change", "loss mm", *(f"{name} {unit}" for name in names), *(f"{part} mm" for part in parts)]
    columns.append(f"{facts['robot']['markers'][-1]} % wider" if beats else "% wider")
    yaws = any(row["yaw"] is not None for row in rows)
    cells = [
        [
            ", ".join(f"{c['name']} {value(c['from'], 3)} → {value(c['to'], 3)}" for c in row["changes"]),
            "diverged" if row["failed"] else mm(row["loss"], 1, signed=True),
            *(_cell(change, speeds) for change in row["by_trial"] or [None] * named),
            *(mm(row[part], 1, signed=True) for part in parts),
            number(row["amplitude"], 1, 100, signed=True),
            *([number(row["yaw"], 1, 100, signed=True)] if yaws else []),
        ]
        for row in rows
    ]
    return f"## What was measured\n\n{_HOW}\n\n{table([*columns, *(['yaw % wider'] if yaws else [])], cells)}"


def _cell(change: float | None, speeds: bool) -> str:
    return number(change, 1, 100, signed=True) if speeds else mm(change, 1, signed=True)


def _loss(evaluation: Evaluation) -> float:
    return float("inf") if evaluation.failed else evaluation.loss


def _changes(before: Evaluation, after: Evaluation, space: ParameterSpace) -> list[dict[str, Any]]:
    old, new = (space.to_values(one.candidate.point) for one in (before, after))
    moved = before.candidate.point != after.candidate.point
    return [
        {"name": name, "from": old[name], "to": new[name]}
        for name, there in zip(space.names, moved, strict=True)
        if there
    ]


def _effects(
    before: Sequence[Facts], after: Sequence[Facts], first: Evaluation, second: Evaluation
) -> dict[str, Any]:  # fmt: skip
    """By how much figures differ: speeds and widths relative to the real ones, else in m; None where unknown."""
    failed = second.failed or first.failed
    known = not failed and len(before) == len(after)
    whole = [differences(trials) for trials in (before, after)]
    speeds = [[row["speed_ratio"] for row in one["by_trial"]] for one in whole]
    errors = [[trial["error"] for trial in trials] for trials in (before, after)]
    told = speeds if any(ratio is not None for side in speeds for ratio in side) else errors
    return {
        "failed": failed,
        "loss": None if failed else second.loss - first.loss,
        "by_trial": [_less(new, old) for old, new in zip(*told, strict=True)] if known else None,
        **{
            part: _less(*(mean(t["figures"].get(f"{part}_error") for t in trials) for trials in (after, before)))
            for part in ("shape", "recoil")
        },
        **{name: _less(*(one["median"][f"{name}_ratio"] for one in reversed(whole))) for name in ("amplitude", "yaw")},
    }


def _less(new: float | None, old: float | None) -> float | None:
    return None if new is None or old is None else new - old
