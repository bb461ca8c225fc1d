"""The advisor's rounds and its calls, read back: what was proposed, what was tried and what came of it.

Of a VLM also: what each call and each round took, what had to be put right in the reply, and what was shown.
"""

from __future__ import annotations

import base64
import hashlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.transcript import CALLS, Call, ShownMedia, totals
from swim2real.calibration.convergence import incumbent
from swim2real.calibration.file_models import Proposal, RecordedEvaluation
from swim2real.formatting import count, dollars, duration, listed, shortened, significant
from swim2real.parameters import ParameterSpace
from swim2real.report.run import RecordedCalls, ReportedRun, calls_of

_MOST_PICTURES = 1_200_000  # bytes on one page; as text they are a third more
_SHOWN_APART = (
    "advisor", "model", "calls", "input_tokens", "output_tokens", "cost", "seconds", "clipped", "ignored", "missing",
    "remarks",
)  # fmt: skip
_EMBEDDED = ("image/png", "image/jpeg")
_MOST_NAMES = 6  # in one list
_MOVES = 3
_SMALLEST_MOVE = 0.005  # of the range
_LONG_NOTE = 160

Texts = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Exhibit:
    """A picture or film that an advisor was shown.

    Attributes:
        label: What it shows.
        path: Path within the run folder, with forward slashes.
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
class _Consultation:
    """Cost and media of a round.

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
    mended: Texts
    exhibits: tuple[_Exhibit, ...]

    @property
    def pictures(self) -> tuple[_Exhibit, ...]:
        """Those on the page."""
        return tuple(one for one in self.exhibits if one.picture)

    @property
    def files(self) -> tuple[_Exhibit, ...]:
        """The others."""
        return tuple(one for one in self.exhibits if not one.picture)


@dataclass(frozen=True)
class AdvisorRound:
    """One proposal and its steps.

    Attributes:
        number: Number of the round, from 1 on.
        status: `accepted`, `rejected` or `cut short`.
        proposal: The advisor's words, and the proposed point.
        notes: What else the advisor left, short texts by name.
        moves: The largest proposed changes, such as `motor_arm_length 0.042 → 0.05 m`.
        steps: Evaluations of the steps as they were tried, at least one.
        before: The incumbent before the round; None where all had failed.
        accepted: The accepted step; None without one.
        consultation: What it took of a VLM; None for a proposal that came of no call.
    """

    number: int
    status: str
    proposal: Proposal
    notes: Texts
    moves: tuple[str, ...]
    steps: tuple[RecordedEvaluation, ...]
    before: RecordedEvaluation | None
    accepted: RecordedEvaluation | None
    consultation: _Consultation | None

    def change(self, step: RecordedEvaluation) -> float | None:
        """Change of the loss against that before the round [m]; None where either isn't known."""
        return None if step.failed or self.before is None else step.loss - self.before.loss


def advisor_rounds(run: ReportedRun) -> tuple[AdvisorRound, ...]:
    """All rounds of a run in order; none for a method without an advisor."""
    accepted = accepted_steps(run)
    shown = {} if run.calls is None else _exhibits(run.calls, list(accepted))
    return tuple(_round(run, number, steps, accepted.get(number), shown) for number, steps in _grouped(run).items())


def accepted_steps(run: ReportedRun) -> dict[int, RecordedEvaluation]:
    """The step of each round that improved on the incumbent before it, by the number of the round."""
    found: dict[int, RecordedEvaluation] = {}
    for number, steps in _grouped(run).items():
        before = incumbent(run.entries[: steps[0].index])
        for step in steps:
            if not step.failed and (before is None or step.loss < before.loss):
                found[number] = step
                break
    return found


def _grouped(run: ReportedRun) -> dict[int, list[RecordedEvaluation]]:
    rounds: dict[int, list[RecordedEvaluation]] = {}
    for entry in run.entries:
        if entry.note.round is not None:
            rounds.setdefault(entry.note.round, []).append(entry)
    return dict(sorted(rounds.items()))


def _round(
    run: ReportedRun, number: int, steps: list[RecordedEvaluation], accepted: RecordedEvaluation | None,
    shown: Mapping[int, tuple[_Exhibit, ...]],
) -> AdvisorRound:  # fmt: skip
    before = incumbent(run.entries[: steps[0].index])
    proposal = steps[0].note.proposal or Proposal(point=[])
    notes = proposal.notes
    asks = run.calls is not None and "calls" in notes
    is_short = len(steps) < run.settings.steps_of_a_rejection
    missed = "cut short" if steps[-1] is run.entries[-1] and is_short else "rejected"
    return AdvisorRound(
        number=number,
        status=missed if accepted is None else "accepted",
        proposal=proposal,
        notes=_notes({name: value for name, value in notes.items() if not asks or name not in _SHOWN_APART}),
        moves=_moves(run.space, before or run.entries[0], proposal),
        steps=tuple(steps),
        before=before,
        accepted=accepted,
        consultation=_consultation(steps[0], run.space, shown.get(number, ())) if asks else None,
    )


def _moves(space: ParameterSpace, start: RecordedEvaluation, proposal: Proposal) -> tuple[str, ...]:
    point = np.array(proposal.point)
    if point.shape != (len(space),):
        return ()
    moved = point - start.point
    proposed = space.to_values(np.clip(point, 0.0, 1.0))
    largest = [int(i) for i in np.argsort(-np.abs(moved), kind="stable")[:_MOVES] if abs(moved[i]) > _SMALLEST_MOVE]
    return tuple(
        f"{p.name} {significant(start.values[p.name])} → {significant(proposed[p.name])} {p.unit}".removesuffix(" -")
        for p in (space.parameters[i] for i in largest)
    )


def _notes(notes: Mapping[str, Any]) -> Texts:
    return tuple(
        (name, significant(value) if isinstance(value, float) else shortened(str(value), _LONG_NOTE))
        for name, value in notes.items()
        if isinstance(value, str | int | float)
    )


def _consultation(
    first: RecordedEvaluation, space: ParameterSpace, exhibits: tuple[_Exhibit, ...]
) -> _Consultation:  # fmt: skip
    """Reads the notes of a VLM's proposal, and leaves out what isn't of its kind."""
    notes = first.note.proposal.notes if first.note.proposal else {}
    advisor, model = str(notes.get("advisor") or ""), notes.get("model")
    named = model if isinstance(model, str) else ""
    took: list[str] = []
    if calls := calls_of(first):
        took.append(f"{_plural(len(calls), 'call')} {listed(calls)}")
    tokens = [notes.get("input_tokens"), notes.get("output_tokens")]
    if any(isinstance(one, int) and one for one in tokens):
        inside, outside = (count(one) if isinstance(one, int) else "–" for one in tokens)
        took.append(f"{inside} tokens in, {outside} out")
    for key, shown in (("cost", dollars), ("seconds", duration)):
        amount = notes.get(key)
        if isinstance(amount, int | float) and math.isfinite(amount):
            took.append(shown(amount))
    instead = shortened(advisor.partition(":")[2]) if is_other(advisor, named) else ""
    return _Consultation(shortened(named or advisor), instead, tuple(took), _mended(notes, space), exhibits)


def _mended(notes: Mapping[str, Any], space: ParameterSpace) -> Texts:
    corrections: list[tuple[str, str]] = []
    clipped = notes.get("clipped")
    for name, value in (cast("dict[str, object]", clipped) if isinstance(clipped, dict) else {}).items():
        if name in space.names and isinstance(value, int | float):
            bound = min(max(value, space[name].lower), space[name].upper)
            moved = f"{name} {significant(value)} → {significant(bound)} {space[name].unit}".removesuffix(" -")
            corrections.append(("clipped", moved))
    lists = {key: cast("list[Any]", value) for key, value in notes.items() if isinstance(value, list)}
    for key, what in (("ignored", "no parameter of this name"), ("missing", "kept as before")):
        if names := [shortened(str(name)) for name in lists.get(key, [])]:
            corrections.append((key, f"{listed(names, _MOST_NAMES)} ({what})"))
    return (*corrections, *(("remark", shortened(str(one))) for one in lists.get("remarks", [])))


def _exhibits(recorded: RecordedCalls, accepted: Sequence[int]) -> dict[int, tuple[_Exhibit, ...]]:
    """Evaluations behind the proposal of each round, with the pictures of the first and of the last accepted round."""
    on_page = {*accepted[:1], *accepted[-1:]}
    exhibits: dict[int, tuple[_Exhibit, ...]] = {}
    for number in {call.round for call in recorded.calls}:
        calls = [call for call in recorded.calls if call.round == number]
        used = max((call.number for call in calls if call.outcome == "used"), default=0)
        asked = [call for call in calls if not call.is_repair and call.number <= used]
        left, shown = _MOST_PICTURES // len(on_page) if number in on_page else 0, []
        for media in asked[-1].media if asked else ():
            exhibit, size = _exhibit(recorded, media, left)
            left -= size
            shown.append(exhibit)
        exhibits[number] = tuple(shown)
    return exhibits


def _exhibit(recorded: RecordedCalls, media: ShownMedia, left: int) -> tuple[_Exhibit, int]:
    """With its picture if that takes at most `left` bytes, and how many it takes."""
    name = f"{CALLS}/{media.media}"
    path, label = recorded.folder / name, shortened(media.label)
    if not path.is_file():
        return _Exhibit(label, name, problem="the file is missing"), 0
    if not left or media.media_type not in _EMBEDDED:
        return _Exhibit(label, name), 0
    try:
        data = path.read_bytes()
    except OSError as error:
        return _Exhibit(label, name, problem=f"the file can't be read: {error.strerror or error}"), 0
    if hashlib.sha256(data).hexdigest() != media.sha256:
        return _Exhibit(label, name, problem="the file has changed since it was shown"), 0
    if len(data) > left:
        return _Exhibit(label, name), 0
    return _Exhibit(label, name, f"data:{media.media_type};base64,{base64.b64encode(data).decode()}"), len(data)


@dataclass(frozen=True)
class _CallRow:
    """One call.

    Attributes:
        call: As it is on record.
        is_other: Whether another model answered than the one that was asked.
        problems: In sentences: why it wasn't used, and what went wrong before it was answered.
    """

    call: Call
    is_other: bool
    problems: tuple[str, ...]


@dataclass(frozen=True)
class CallSection:
    """Section of the page about the calls.

    Attributes:
        sums: Each an amount and what it is of.
        warnings: In sentences.
        rows: A row per call.
    """

    sums: Texts
    warnings: tuple[str, ...]
    rows: tuple[_CallRow, ...]


def call_section(recorded: RecordedCalls | None) -> CallSection | None:
    """The section of the calls, None for a run that made none."""
    if recorded is None:
        return None
    calls = recorded.calls
    warnings = [recorded.problem] if recorded.problem else []
    others: dict[tuple[str, str], list[int]] = {}
    for call in calls:
        if call.reply is not None and is_other(call.advisor, call.reply.model):
            asked = call.advisor.partition(":")[2]
            others.setdefault((shortened(asked), shortened(call.reply.model or "")), []).append(call.number)
    warnings += [
        f"Another model answered: {asked} was asked, and {model} answered {_plural(len(numbers), 'call')} "
        f"{listed(numbers)}. The result is not that of {asked} alone."
        for (asked, model), numbers in others.items()
    ]
    without = sorted({call.round for call in calls} - {call.round for call in calls if call.outcome == "used"})
    if without:
        warnings.append(
            f"{_plural(len(without), 'Round')} {listed(without)} got no usable reply, so nothing was proposed and "
            f"nothing simulated; --resume asks again."
        )
    rows = [_CallRow(call, is_other(call.advisor, call.reply and call.reply.model), _problems(call)) for call in calls]
    return CallSection(_sums(calls) if calls else (), tuple(warnings), tuple(rows))


def is_other(advisor: str, model: str | None) -> bool:
    """True if a model answered that isn't the advisor that was asked, such as `google:gemini-3.1-pro-preview`."""
    asked = advisor.partition(":")[2]
    return bool(asked and model) and not same_model(asked, model or "")


def _plural(number: int, word: str) -> str:
    """A word for one thing or for several."""
    return word if number == 1 else f"{word}s"


def _problems(call: Call) -> tuple[str, ...]:
    problems = [call.problem] if call.problem else []
    for number, attempt in enumerate(call.attempts, start=1):
        if attempt.error and not any(attempt.error in sentence for sentence in problems):
            waited = f", then waited {duration(attempt.waited)}" if attempt.waited else ""
            problems.append(f"attempt {number}: {attempt.error}{waited}")
    return tuple(shortened(sentence) for sentence in problems)


def _sums(calls: Sequence[Call]) -> Texts:
    sums, replies = totals(calls), [call.reply for call in calls if call.reply is not None]
    repairs, unusable = sum(call.is_repair for call in calls), sum(call.outcome == "unusable" for call in calls)
    parts = [f"{sums.failed or 'none'} failed", f"{repairs or 'no'} {_plural(repairs, 'repair')}"]
    if unusable:
        parts.insert(1, f"{unusable} with a reply that wasn't usable")
    amounts = [(str(sums.calls), f"{_plural(sums.calls, 'call')}: {listed(parts)}")]
    if any(reply.input_tokens is not None for reply in replies):
        amounts += [(count(sums.input_tokens), "tokens in"), (count(sums.output_tokens), "tokens out")]
    else:
        amounts.append(("tokens", "not counted"))
    unpriced = sum(reply.cost is None for reply in replies)
    if sums.cost is None:
        amounts.append(("price", "not known"))
    else:
        rest = f", and {unpriced} repl{'y' if unpriced == 1 else 'ies'} of unknown price" if unpriced else ""
        amounts.append((dollars(sums.cost), f"spent{rest}"))
    amounts.append((duration(sums.seconds), "waited"))
    models = Counter(shortened(reply.model) for reply in replies if reply.model)
    return (*amounts, *((model, f"answered {times} {_plural(times, 'time')}") for model, times in models.items()))
