"""The calls of the advisor: what each took and what came of it, and their sums."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.transcript import Call, totals
from swim2real.report.recorded_calls import RecordedCalls
from swim2real.report.units import NOTHING, count, dollars, duration, listed, shortened, text

_OUTCOMES = {"used": "used", "unusable": "not usable", "failed": "failed"}


@dataclass(frozen=True)
class CallRow:
    """One call, as texts.

    Attributes:
        number: Within the run.
        round: That it belongs to.
        kind: `question` or `repair`.
        outcome: `used`, `not usable` or `failed`.
        model: That answered, by its own account.
        other: Whether it isn't the one that was asked.
        input_tokens: As the service counts them.
        output_tokens: Likewise.
        cost: [USD].
        seconds: Waiting included.
        attempts: How many.
        problems: In sentences: why it wasn't used, and what went wrong before it was answered.
    """

    number: str
    round: str
    kind: str
    outcome: str
    model: str
    other: bool
    input_tokens: str
    output_tokens: str
    cost: str
    seconds: str
    attempts: str
    problems: tuple[str, ...]


@dataclass(frozen=True)
class CallSection:
    """What the page says about the calls.

    Attributes:
        sums: Each an amount and what it is of.
        warnings: In sentences.
        rows: A row a call.
    """

    sums: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    rows: tuple[CallRow, ...]


def call_section(recorded: RecordedCalls | None) -> CallSection | None:
    """The section of the calls, None for a run that made none."""
    if recorded is None:
        return None
    calls = recorded.calls
    problems = (recorded.problem,) if recorded.problem else ()
    warnings = (*problems, *_other_models(calls), *_unanswered(calls))
    return CallSection(_sums(calls) if calls else (), warnings, tuple(_row(call) for call in calls))


def is_other(advisor: str, model: str | None) -> bool:
    """Whether a model answered that isn't the advisor that was asked, such as `google:gemini-3.1-pro-preview`."""
    asked = advisor.partition(":")[2]
    return bool(asked and model) and not same_model(asked, model or "")


def _row(call: Call) -> CallRow:
    reply = call.reply
    said = [call.problem] if call.problem else []
    for number, attempt in enumerate(call.attempts, start=1):
        if attempt.error and not any(attempt.error in sentence for sentence in said):
            waited = f", then waited {duration(attempt.waited)}" if attempt.waited else ""
            said.append(f"attempt {number}: {attempt.error}{waited}")
    return CallRow(
        number=str(call.number),
        round=str(call.round),
        kind="repair" if call.is_repair else "question",
        outcome=_OUTCOMES.get(call.outcome, call.outcome),
        model=shortened((reply and reply.model) or NOTHING),
        other=is_other(call.advisor, reply and reply.model),
        input_tokens=count(reply and reply.input_tokens),
        output_tokens=count(reply and reply.output_tokens),
        cost=text(reply and reply.cost, 4),
        seconds=text(call.seconds, 1),
        attempts=str(len(call.attempts)),
        problems=tuple(shortened(sentence) for sentence in said),
    )


def _sums(calls: Sequence[Call]) -> tuple[tuple[str, str], ...]:
    sums, replies = totals(calls), [call.reply for call in calls if call.reply is not None]
    repairs = sum(call.is_repair for call in calls)
    unusable = sum(call.outcome == "unusable" for call in calls)
    parts = [
        f"{sums.failed or 'none'} failed",
        *([f"{unusable} with a reply that wasn't usable"] if unusable else []),
        f"{repairs or 'no'} repair{'' if repairs == 1 else 's'}",
    ]
    found = [(str(sums.calls), f"call{'' if sums.calls == 1 else 's'}: {listed(parts)}")]
    if any(reply.input_tokens is not None for reply in replies):
        found += [(count(sums.input_tokens), "tokens in"), (count(sums.output_tokens), "tokens out")]
    else:
        found.append(("tokens", "not counted"))
    unpriced = sum(reply.cost is None for reply in replies)
    if sums.cost is None:
        found.append(("price", "not known"))
    else:
        rest = f", and {unpriced} repl{'y' if unpriced == 1 else 'ies'} of unknown price" if unpriced else ""
        found.append((dollars(sums.cost), f"spent{rest}"))
    found.append((duration(sums.seconds), "waited"))
    models = Counter(reply.model for reply in replies if reply.model)
    found += [
        (shortened(model), f"answered {times} time{'' if times == 1 else 's'}") for model, times in models.items()
    ]
    return tuple(found)


def _other_models(calls: Sequence[Call]) -> tuple[str, ...]:
    found: dict[tuple[str, str], list[int]] = {}
    for call in calls:
        model = call.reply.model if call.reply else None
        if model and is_other(call.advisor, model):
            found.setdefault((call.advisor.partition(":")[2], model), []).append(call.number)
    return tuple(
        f"Another model answered: {shortened(asked)} was asked, and {shortened(model)} answered call"
        f"{'' if len(numbers) == 1 else 's'} {listed(numbers)}. The result is not that of {shortened(asked)} alone."
        for (asked, model), numbers in found.items()
    )


def _unanswered(calls: Sequence[Call]) -> tuple[str, ...]:
    without = sorted({call.round for call in calls} - {call.round for call in calls if call.outcome == "used"})
    if not without:
        return ()
    return (
        f"Round{'' if len(without) == 1 else 's'} {listed(without)} got no usable reply, so nothing was proposed and "
        f"nothing simulated; --resume asks again.",
    )
