"""The calls of a run's advisor as the run folder keeps them, and what each of them showed."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swim2real.advisor import replayed_run
from swim2real.advisor.vlm.transcript import CALLS, Call, Transcript
from swim2real.errors import AdvisorError
from swim2real.report.units import listed, shortened

Json = Mapping[str, Any]

_MOST = 1_000_000  # calls or rounds, more is an error
_MEDIA = re.compile(r"media/\w+\.\w+")  # nothing outside of the transcript


@dataclass(frozen=True)
class Shown:
    """A picture or film of a question.

    Attributes:
        label: What it shows.
        path: Within the run folder, with forward slashes.
        media_type: Such as `image/png`.
        sha256: Of the file, as it was shown.
    """

    label: str
    path: str
    media_type: str
    sha256: str


@dataclass(frozen=True)
class RecordedCalls:
    """The transcript of a run whose advisor was asked over a wire or by files.

    Attributes:
        folder: Of the run.
        calls: In order; empty where the transcript is missing or damaged.
        shown: By the number of a call, its pictures and films.
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


def read_calls(folder: Path, settings: Json, entries: Sequence[Json]) -> RecordedCalls | None:
    """Gathers the calls of a run. A transcript that can't be read is a sentence, not an error.

    Args:
        folder: Of the run.
        settings: Of the run.
        entries: Its record, whose proposals name the calls that they came of.

    Returns:
        None for a run that made no calls: its advisor is built in, repeats another run's calls, or hasn't been asked.
    """
    has_files = any((folder / CALLS).glob("call_*.json"))
    told = {number for entry in entries for number in _told(entry)}
    if not has_files and (not told or replayed_run(str(settings.get("advisor"))) is not None):
        return None
    if not has_files:
        return RecordedCalls(
            folder,
            problem=f"The advisor's calls are on record, but their transcript, the folder '{CALLS}' of the run, is "
            f"missing: what they took and what was shown can't be told. Put the folder back and make the report again.",
        )
    try:
        calls = Transcript(folder).calls
        for call in calls:
            _check(call)
        shown = {call.number: _shown(folder / CALLS / _name(call)) for call in calls}
    except (AdvisorError, RecursionError) as error:
        what = str(error).replace(f"{folder}/", "")
        return RecordedCalls(folder, problem=f"The transcript of the advisor's calls can't be read: {what}.")
    lost = sorted((told | set(range(1, max(shown) + 1))) - set(shown))
    return RecordedCalls(folder, calls, shown, _missing(lost))


def _told(entry: Json) -> list[int]:
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


def _name(call: Call) -> str:
    return f"call_{call.number:04d}.json"


def _check(call: Call) -> None:
    """Whether its entries are of their kinds, which the transcript takes as they come."""
    reply = call.reply
    measured: list[Any] = [one for attempt in call.attempts for one in (attempt.seconds, attempt.waited)]
    known: list[Any] = [] if reply is None else [reply.input_tokens, reply.output_tokens, reply.cost]
    whole: list[Any] = [call.number, call.round]
    texts: list[Any] = [call.advisor, call.outcome]
    maybe: list[Any] = [call.problem, *(attempt.error for attempt in call.attempts)]
    if reply is not None:
        maybe += [reply.model, *reply.notes]
    right = (
        all(isinstance(one, int) and 0 < one < _MOST for one in whole)
        and all(isinstance(one, int | float) and math.isfinite(one) for one in measured)
        and all(one is None or (isinstance(one, int | float) and math.isfinite(one)) for one in known)
        and all(isinstance(one, str) for one in texts)
        and all(one is None or isinstance(one, str) for one in maybe)
    )
    if not right:
        named = f"call {call.number!r} of round {call.round!r}"
        raise AdvisorError(f"{shortened(named)} is damaged (an entry is of a wrong kind); restore it")


def _shown(path: Path) -> tuple[Shown, ...]:
    try:
        parts: list[Any] = json.loads(path.read_text(encoding="utf-8"))["request"]["parts"]
        media = [part for part in parts if not isinstance(part, str)]
        found = [Shown(str(m["label"]), m["media"], str(m["media_type"]), str(m["sha256"])) for m in media]
        if not all(_MEDIA.fullmatch(one.path) for one in found):
            raise ValueError("it names media outside of the transcript")
    except (OSError, ValueError, KeyError, TypeError) as error:
        what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
        raise AdvisorError(f"{CALLS}/{path.name} is damaged ({what}); restore it") from error
    return tuple(Shown(one.label, f"{CALLS}/{one.path}", one.media_type, one.sha256) for one in found)
