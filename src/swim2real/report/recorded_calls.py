"""The calls of a run's advisor as the run folder keeps them, and what each of them showed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swim2real.advisor import replayed_run
from swim2real.advisor.vlm.transcript import CALLS, Call, Transcript
from swim2real.errors import AdvisorError
from swim2real.report.units import listed

Json = Mapping[str, Any]


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
    except AdvisorError as error:
        what = str(error).replace(f"{folder}/", "")
        return RecordedCalls(folder, problem=f"The transcript of the advisor's calls can't be read: {what}.")
    shown = {
        call.number: tuple(
            Shown(file.label, f"{CALLS}/{file.media}", file.media_type, file.sha256) for file in call.media
        )
        for call in calls
    }
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
