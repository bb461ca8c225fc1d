"""The advisor's rounds, read back from the record: what was proposed, what was tried and what came of it.

Of a VLM's round also: what it took, what had to be put right in the reply, and what was shown.
"""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from swim2real.parameters import ParameterSpace
from swim2real.report.calls import RecordedCalls, Shown, is_other
from swim2real.report.run import Json, ReportedRun, incumbent
from swim2real.report.units import count, dollars, duration, listed, mm, shortened, significant, text

MOST_PICTURES = 1_200_000  # bytes on one page; as text they are a third more
_SHOWN_APART = (
    "advisor", "model", "calls", "input_tokens", "output_tokens", "cost", "seconds", "clipped", "ignored", "missing",
    "remarks",
)  # fmt: skip
_EMBEDDED = ("image/png", "image/jpeg")
_MOST_NAMES = 6  # in one list
_MOVES = 3
_SMALLEST_MOVE = 0.005  # of the range
_LONG_NOTE = 160


@dataclass(frozen=True)
class Step:
    """One step of a round, as texts.

    Attributes:
        evaluation: Number of the evaluation, from 1 on.
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
class Exhibit:
    """A picture or film that an advisor was shown.

    Attributes:
        label: What it shows.
        path: Path within the run folder.
        picture: The picture as a data URI; empty where it isn't on the page.
        problem: Why the file isn't what was shown; empty where it is, or wasn't looked at.
    """

    label: str
    path: str
    picture: str = ""
    problem: str = ""

    @property
    def brief(self) -> str:
        """The label up to its colon, such as `Trial f1_50, 1.50 Hz`."""
        return self.label.partition(":")[0]


@dataclass(frozen=True)
class Consultation:
    """What a round took and showed.

    Attributes:
        model: Model that answered.
        instead: Model that was asked, where another answered; else empty.
        took: Calls, tokens, cost and time, as texts.
        mended: What was put right in the reply: a name and a text each.
        exhibits: What was shown.
    """

    model: str
    instead: str
    took: tuple[str, ...]
    mended: tuple[tuple[str, str], ...]
    exhibits: tuple[Exhibit, ...]

    @property
    def pictures(self) -> tuple[Exhibit, ...]:
        """Those on the page."""
        return tuple(one for one in self.exhibits if one.picture)

    @property
    def files(self) -> tuple[Exhibit, ...]:
        """The others."""
        return tuple(one for one in self.exhibits if not one.picture)


@dataclass(frozen=True)
class AdvisorRound:
    """One proposal and its steps.

    Attributes:
        number: Number of the round, from 1 on.
        status: `accepted`, `rejected` or `cut short`.
        diagnosis: The advisor's words.
        reasoning: The advisor's reasons.
        notes: What else the advisor left, short texts by name.
        moves: The largest proposed changes, such as `motor_arm_length 0.042 → 0.05 m`.
        steps: Steps as they were tried, at least one.
        before: Loss before the round [mm].
        after: Loss of the accepted step, else as before [mm].
        consultation: What it took of a VLM; None for a proposal that came of no call.
    """

    number: int
    status: str
    diagnosis: str
    reasoning: str
    notes: tuple[tuple[str, str], ...]
    moves: tuple[str, ...]
    steps: tuple[Step, ...]
    before: str
    after: str
    consultation: Consultation | None


def advisor_rounds(run: ReportedRun) -> tuple[AdvisorRound, ...]:
    """All rounds of a run in order; none for a method without an advisor."""
    grouped = _grouped(run)
    longest = run.settings.max_steps
    exhibits = _exhibits(run, [number for number, _ in grouped])
    rounds: list[AdvisorRound] = []
    for number, indices in grouped:
        before = incumbent(run.entries[: indices[0]])
        steps = [run.entries[i] for i in indices]
        proposal: Json = steps[0]["note"].get("proposal") or {}
        accepted = accepted_step(run, indices)
        notes: Json = proposal.get("notes") or {}
        asks = run.calls is not None and "calls" in notes
        is_last = indices[-1] == len(run.entries) - 1
        missed = "cut short" if is_last and len(steps) < longest else "rejected"
        rounds.append(
            AdvisorRound(
                number=number,
                status=missed if accepted is None else "accepted",
                diagnosis=str(proposal.get("diagnosis") or ""),
                reasoning=str(proposal.get("reasoning") or ""),
                notes=_notes({name: value for name, value in notes.items() if not asks or name not in _SHOWN_APART}),
                moves=_moves(run.space, before or run.entries[0], proposal),
                steps=tuple(_step(i, run.entries[i], before) for i in indices),
                before=_loss(before),
                after=_loss(before if accepted is None else run.entries[accepted]),
                consultation=consultation(notes, run.space, exhibits.get(number, ())) if asks else None,
            )
        )
    return tuple(rounds)


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


def _step(index: int, entry: Json, before: Json | None) -> Step:
    failed = bool(entry["failed"])
    change = None if failed or before is None else entry["loss"] - before["loss"]
    return Step(
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
    return f"{mm(entry['loss'], 2)} mm"


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


def consultation(notes: Mapping[str, Any], space: ParameterSpace, exhibits: Sequence[Exhibit]) -> Consultation:
    """What the notes of a VLM's proposal tell.

    Args:
        notes: Notes as on record.
        space: Space of the parameters.
        exhibits: Those of the round.
    """
    advisor, model = str(notes.get("advisor") or ""), notes.get("model")
    named = model if isinstance(model, str) else ""
    return Consultation(
        model=shortened(named or advisor),
        instead=shortened(advisor.partition(":")[2]) if is_other(advisor, named) else "",
        took=_costs(notes),
        mended=_mended(notes, space),
        exhibits=tuple(exhibits),
    )


def exhibits_of(recorded: RecordedCalls, rounds: Sequence[int], on_page: Sequence[int]) -> dict[int, list[Exhibit]]:
    """What each round showed; a file that isn't what was shown then is said to be so.

    Args:
        recorded: The calls.
        rounds: Numbers of the rounds.
        on_page: Numbers of the rounds whose pictures are put on the page, as far as they fit.
    """
    each = MOST_PICTURES // max(1, len(set(on_page)))
    exhibits: dict[int, list[Exhibit]] = {}
    for number in rounds:
        left = each if number in on_page else 0
        exhibits[number] = []
        for shown in recorded.of_round(number):
            exhibit, size = _exhibit(recorded, shown, left)
            left -= size
            exhibits[number].append(exhibit)
    return exhibits


def _exhibit(recorded: RecordedCalls, shown: Shown, left: int) -> tuple[Exhibit, int]:
    """With its picture if that takes at most `left` bytes, and how many it takes."""
    path = recorded.folder / shown.path
    label = shortened(shown.label)
    if not path.is_file():
        return Exhibit(label, shown.path, problem="the file is missing"), 0
    if not left or shown.media_type not in _EMBEDDED:
        return Exhibit(label, shown.path), 0
    try:
        data = path.read_bytes()
    except OSError as error:
        return Exhibit(label, shown.path, problem=f"the file can't be read: {error.strerror or error}"), 0
    if hashlib.sha256(data).hexdigest() != shown.sha256:
        return Exhibit(label, shown.path, problem="the file has changed since it was shown"), 0
    if len(data) > left:
        return Exhibit(label, shown.path), 0
    return Exhibit(label, shown.path, f"data:{shown.media_type};base64,{base64.b64encode(data).decode()}"), len(data)


def _costs(notes: Mapping[str, Any]) -> tuple[str, ...]:
    parts: list[str] = []
    calls = [number for number in _list(notes.get("calls")) if isinstance(number, int)]
    if calls:
        parts.append(f"call{'' if len(calls) == 1 else 's'} {listed(calls)}")
    tokens = [notes.get("input_tokens"), notes.get("output_tokens")]
    if any(isinstance(one, int) and one for one in tokens):
        inside, outside = (count(one) if isinstance(one, int) else "–" for one in tokens)
        parts.append(f"{inside} tokens in, {outside} out")
    for key, shown in (("cost", dollars), ("seconds", duration)):
        amount = notes.get(key)
        if isinstance(amount, int | float) and math.isfinite(amount):
            parts.append(shown(amount))
    return tuple(parts)


def _mended(notes: Mapping[str, Any], space: ParameterSpace) -> tuple[tuple[str, str], ...]:
    corrections: list[tuple[str, str]] = []
    clipped: Any = notes.get("clipped")
    moved = cast(dict[str, Any], clipped) if isinstance(clipped, dict) else {}
    for name, value in moved.items():
        if name in space.names and isinstance(value, int | float):
            bound = min(max(value, space[name].lower), space[name].upper)
            unit = "" if space[name].unit == "-" else f" {space[name].unit}"
            corrections.append(("clipped", f"{name} {significant(value)} → {significant(bound)}{unit}"))
    for key, what in (("ignored", "no parameter of this name"), ("missing", "kept as before")):
        names = [shortened(str(name)) for name in _list(notes.get(key))]
        if names:
            corrections.append((key, f"{listed(names, _MOST_NAMES)} ({what})"))
    corrections += [("remark", shortened(str(one))) for one in _list(notes.get("remarks"))]
    return tuple(corrections)


def _list(value: Any) -> list[Any]:
    return cast(list[Any], value) if isinstance(value, list) else []
