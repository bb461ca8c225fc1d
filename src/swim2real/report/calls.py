"""The calls of a run's advisor: what the run folder keeps of them, what each took, what came of it, and their sums."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.transcript import CALLS, Call, Transcript, totals
from swim2real.calibration import RunSettings
from swim2real.errors import AdvisorError
from swim2real.report.units import NOTHING, count, dollars, duration, listed, shortened, text
from swim2real.settings import replayed_run

Json = Mapping[str, Any]

_OUTCOMES = {"used": "used", "unusable": "not usable", "failed": "failed"}


@dataclass(frozen=True)
class Shown:
    """A picture or film of a question.

    Attributes:
        label: What it shows.
        path: Path within the run folder, with forward slashes.
        media_type: Such as `image/png`.
        sha256: Digest of the file, as it was shown.
    """

    label: str
    path: str
    media_type: str
    sha256: str


@dataclass(frozen=True)
class RecordedCalls:
    """The transcript of a run whose advisor was asked over a wire or by files.

    Attributes:
        folder: Folder of the run.
        calls: In order; empty where the transcript is missing or damaged.
        shown: Pictures and films of each call, by its number.
        problem: What is wrong with the transcript, in sentences; empty where it is whole.
    """

    folder: Path
    calls: tuple[Call, ...] = ()
    shown: Mapping[int, tuple[Shown, ...]] = field(default_factory=dict[int, tuple[Shown, ...]])
    problem: str = ""

    def of_round(self, number: int) -> tuple[Shown, ...]:
        """What the question showed that the proposal of a round came of."""
        calls = [call for call in self.calls if call.round == number]
        used = max((call.number for call in calls if call.outcome == "used"), default=0)
        asked = max((call.number for call in calls if not call.is_repair and call.number <= used), default=0)
        return self.shown.get(asked, ())


def read_calls(folder: Path, settings: RunSettings, entries: Sequence[Json]) -> RecordedCalls | None:
    """Gathers the calls of a run. A transcript that can't be read is a sentence, not an error.

    Args:
        folder: Folder of the run.
        settings: Settings of the run.
        entries: The record, whose proposals name the calls that they came of.

    Returns:
        None for a run that made no calls: its advisor is built in, repeats another run's calls, or hasn't been asked.
    """
    has_files = any((folder / CALLS).glob("call_*.json"))
    named = {number for entry in entries for number in _calls_of(entry)}
    if not has_files and (not named or replayed_run(settings.advisor) is not None):
        return None
    if not has_files:
        return RecordedCalls(
            folder,
            problem=f"The advisor's calls are on record, but their transcript, the folder '{CALLS}' of the run, is "
            f"missing: what they took and what was shown can't be told. Put the folder back and make the report again.",
        )
    try:
        calls = Transcript(folder).calls
    except AdvisorError as error:
        what = str(error).replace(f"{folder}/", "")
        return RecordedCalls(folder, problem=f"The transcript of the advisor's calls can't be read: {what}.")
    shown = {
        call.number: tuple(
            Shown(file.label, f"{CALLS}/{file.media}", file.media_type, file.sha256) for file in call.media
        )
        for call in calls
    }
    lost = sorted((named | set(range(1, max(shown) + 1))) - set(shown))
    return RecordedCalls(folder, calls, shown, _missing(lost))


def _calls_of(entry: Json) -> list[int]:
    notes = (entry["note"].get("proposal") or {}).get("notes") or {}
    numbers: Any = notes.get("calls")
    return [number for number in numbers if isinstance(number, int)] if isinstance(numbers, list) else []


def _missing(numbers: Sequence[int]) -> str:
    if not numbers:
        return ""
    one = len(numbers) == 1
    return (
        f"Call{'' if one else 's'} {listed(numbers)} {'is' if one else 'are'} missing in the transcript, the folder "
        f"'{CALLS}' of the run; the sums below are without {'it' if one else 'them'}."
    )


@dataclass(frozen=True)
class CallRow:
    """One call, as texts.

    Attributes:
        number: Number within the run.
        round: Round that it belongs to.
        kind: `question` or `repair`.
        outcome: `used`, `not usable` or `failed`.
        model: Model that answered, by its own account.
        other: Whether it isn't the one that was asked.
        input_tokens: As the service counts them.
        output_tokens: As the service counts them.
        cost: [USD].
        seconds: Time that it took, waiting included.
        attempts: How many attempts it took.
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
    problems = [call.problem] if call.problem else []
    for number, attempt in enumerate(call.attempts, start=1):
        if attempt.error and not any(attempt.error in sentence for sentence in problems):
            waited = f", then waited {duration(attempt.waited)}" if attempt.waited else ""
            problems.append(f"attempt {number}: {attempt.error}{waited}")
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
        problems=tuple(shortened(sentence) for sentence in problems),
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
    amounts = [(str(sums.calls), f"call{'' if sums.calls == 1 else 's'}: {listed(parts)}")]
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
    models = Counter(reply.model for reply in replies if reply.model)
    amounts += [
        (shortened(model), f"answered {times} time{'' if times == 1 else 's'}") for model, times in models.items()
    ]
    return tuple(amounts)


def _other_models(calls: Sequence[Call]) -> tuple[str, ...]:
    numbers_of: dict[tuple[str, str], list[int]] = {}
    for call in calls:
        model = call.reply.model if call.reply else None
        if model and is_other(call.advisor, model):
            numbers_of.setdefault((call.advisor.partition(":")[2], model), []).append(call.number)
    return tuple(
        f"Another model answered: {shortened(asked)} was asked, and {shortened(model)} answered call"
        f"{'' if len(numbers) == 1 else 's'} {listed(numbers)}. The result is not that of {shortened(asked)} alone."
        for (asked, model), numbers in numbers_of.items()
    )


def _unanswered(calls: Sequence[Call]) -> tuple[str, ...]:
    without = sorted({call.round for call in calls} - {call.round for call in calls if call.outcome == "used"})
    if not without:
        return ()
    return (
        f"Round{'' if len(without) == 1 else 's'} {listed(without)} got no usable reply, so nothing was proposed and "
        f"nothing simulated; --resume asks again.",
    )
