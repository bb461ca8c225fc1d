"""The advisor's rounds, read back from the record: what was proposed, what was tried and what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swim2real.parameters import ParameterSpace
from swim2real.report.asked import TOLD, Asked, Exhibit, asked_in, exhibits_of
from swim2real.report.run import Json, ReportedRun, incumbent
from swim2real.report.units import mm, significant, text

_MOVES = 3
_SMALLEST_MOVE = 0.005  # of the range
_LONG_NOTE = 160


@dataclass(frozen=True)
class TriedStep:
    """One step of a round, as texts.

    Attributes:
        evaluation: Its number, from 1 on.
        size: Share of the proposed move.
        loss: [mm], or that it diverged.
        change: Against the loss before the round [mm], signed.
        better: Whether it improved on it.
        failed: Whether the simulation diverged.
    """

    evaluation: int
    size: str
    loss: str
    change: str
    better: bool
    failed: bool


@dataclass(frozen=True)
class AdvisorRound:
    """One proposal and its steps.

    Attributes:
        number: From 1 on.
        status: `accepted`, `rejected` or `cut short`.
        diagnosis: The advisor's words.
        reasoning: Likewise.
        notes: What else the advisor left, short texts by name.
        moves: The largest proposed changes, such as `motor_arm_length 0.042 → 0.05 m`.
        steps: As tried, at least one.
        before: Loss before the round [mm].
        after: Loss of the accepted step, else as before [mm].
        asked: What it took of a VLM; None for a proposal that came of no call.
    """

    number: int
    status: str
    diagnosis: str
    reasoning: str
    notes: tuple[tuple[str, str], ...]
    moves: tuple[str, ...]
    steps: tuple[TriedStep, ...]
    before: str
    after: str
    asked: Asked | None


def advisor_rounds(run: ReportedRun) -> tuple[AdvisorRound, ...]:
    """All rounds of a run in order; none for a method without an advisor."""
    grouped = _grouped(run)
    longest = int(run.settings.get("max_steps") or max((len(indices) for _, indices in grouped), default=0))
    exhibits = _exhibits(run, [number for number, _ in grouped])
    found: list[AdvisorRound] = []
    for number, indices in grouped:
        before = incumbent(run.entries[: indices[0]])
        steps = [run.entries[i] for i in indices]
        proposal: Json = steps[0]["note"].get("proposal") or {}
        accepted = accepted_step(run, indices)
        notes: Json = proposal.get("notes") or {}
        asks = run.calls is not None and "calls" in notes
        is_last = indices[-1] == len(run.entries) - 1
        missed = "cut short" if is_last and len(steps) < longest else "rejected"
        found.append(
            AdvisorRound(
                number=number,
                status=missed if accepted is None else "accepted",
                diagnosis=str(proposal.get("diagnosis") or ""),
                reasoning=str(proposal.get("reasoning") or ""),
                notes=_notes({name: value for name, value in notes.items() if not asks or name not in TOLD}),
                moves=_moves(run.space, before or run.entries[0], proposal),
                steps=tuple(_step(i, run.entries[i], before) for i in indices),
                before=_loss(before),
                after=_loss(before if accepted is None else run.entries[accepted]),
                asked=asked_in(notes, run.space, exhibits.get(number, ())) if asks else None,
            )
        )
    return tuple(found)


def accepted_steps(run: ReportedRun) -> tuple[tuple[int, int], ...]:
    """Index of the accepted step and number of its round, for every accepted round."""
    pairs = [(accepted_step(run, indices), number) for number, indices in _grouped(run)]
    return tuple((index, number) for index, number in pairs if index is not None)


def accepted_step(run: ReportedRun, indices: Sequence[int]) -> int | None:
    """The step of a round that improved on the incumbent before it, None for a round without one."""
    before = incumbent(run.entries[: indices[0]])
    for index in indices:
        entry = run.entries[index]
        if not entry["failed"] and (before is None or entry["loss"] < before["loss"]):
            return index
    return None


def _exhibits(run: ReportedRun, rounds: Sequence[int]) -> dict[int, list[Exhibit]]:
    """What each round showed; the pictures of the first and of the last accepted one are put on the page."""
    if run.calls is None:
        return {}
    accepted = [number for _, number in accepted_steps(run)]
    return exhibits_of(run.calls, rounds, [*accepted[:1], *accepted[-1:]])


def _grouped(run: ReportedRun) -> list[tuple[int, list[int]]]:
    rounds: dict[int, list[int]] = {}
    for index, entry in enumerate(run.entries):
        number = entry["note"].get("round")
        if isinstance(number, int):
            rounds.setdefault(number, []).append(index)
    return sorted(rounds.items())


def _step(index: int, entry: Json, before: Json | None) -> TriedStep:
    failed = bool(entry["failed"])
    change = None if failed or before is None or entry.get("lower_bound") else entry["loss"] - before["loss"]
    return TriedStep(
        evaluation=index + 1,
        size=f"{text(100 * float(entry['note'].get('step_size', 1.0)), 1).removesuffix('.0')} %",
        loss=_loss(entry),
        change="" if change is None else f"{mm(change, 2, signed=True)} mm",
        better=change is not None and change < 0,
        failed=failed,
    )


def _loss(entry: Json | None) -> str:
    if entry is None or entry["failed"]:
        return "diverged"
    return f"{'over ' if entry.get('lower_bound') else ''}{mm(entry['loss'], 2)} mm"


def _moves(space: ParameterSpace, start: Json, proposal: Json) -> tuple[str, ...]:
    point = np.asarray(proposal.get("point") or [], dtype=float)
    if point.shape != (len(space),):
        return ()
    moved = point - np.asarray(start["point"], dtype=float)
    proposed = space.to_values(np.clip(point, 0.0, 1.0))
    largest = [int(i) for i in np.argsort(-np.abs(moved), kind="stable")[:_MOVES] if abs(moved[i]) > _SMALLEST_MOVE]
    return tuple(
        f"{p.name} {significant(start['values'][p.name])} → {significant(proposed[p.name])} {p.unit}".removesuffix(" -")
        for p in (space.parameters[i] for i in largest)
    )


def _notes(notes: Json) -> tuple[tuple[str, str], ...]:
    short: list[tuple[str, str]] = []
    for name, value in notes.items():
        if isinstance(value, str | int | float | bool):
            shown = significant(value) if isinstance(value, float) else str(value)
            short.append((str(name), shown if len(shown) <= _LONG_NOTE else shown[: _LONG_NOTE - 1] + "…"))
    return tuple(short)
