"""What a round of a VLM took, what had to be put right in its reply, and what it was shown."""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from swim2real.parameters import ParameterSpace
from swim2real.report.call_table import is_other
from swim2real.report.recorded_calls import RecordedCalls, Shown
from swim2real.report.units import count, dollars, duration, listed, shortened, significant

MOST_PICTURES = 1_200_000  # bytes on one page; as text they are a third more
TOLD = (
    "advisor", "model", "calls", "input_tokens", "output_tokens", "cost", "seconds", "clipped", "ignored", "missing",
    "remarks",
)  # fmt: skip
_EMBEDDED = ("image/png", "image/jpeg")
_MOST_NAMES = 6  # in one list


@dataclass(frozen=True)
class Exhibit:
    """A picture or film that an advisor was shown.

    Attributes:
        label: What it shows.
        path: Within the run folder.
        picture: As a data URI; empty where it isn't on the page.
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
class Asked:
    """What a round took and showed.

    Attributes:
        model: That answered.
        instead: The one that was asked, where another answered; else empty.
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


def asked_in(notes: Mapping[str, Any], space: ParameterSpace, exhibits: Sequence[Exhibit]) -> Asked:
    """What the notes of a VLM's proposal tell.

    Args:
        notes: As on record.
        space: Of the parameters.
        exhibits: Of the round.
    """
    advisor, model = str(notes.get("advisor") or ""), notes.get("model")
    named = model if isinstance(model, str) else ""
    return Asked(
        model=shortened(named or advisor),
        instead=shortened(advisor.partition(":")[2]) if is_other(advisor, named) else "",
        took=_took(notes),
        mended=_mended(notes, space),
        exhibits=tuple(exhibits),
    )


def exhibits_of(recorded: RecordedCalls, rounds: Sequence[int], on_page: Sequence[int]) -> dict[int, list[Exhibit]]:
    """What each round showed; a file that isn't what was shown then is said to be so.

    Args:
        recorded: The calls.
        rounds: All that are asked for.
        on_page: Those whose pictures are put on the page, as far as they fit.
    """
    each = MOST_PICTURES // max(1, len(set(on_page)))
    found: dict[int, list[Exhibit]] = {}
    for number in rounds:
        left = each if number in on_page else 0
        found[number] = []
        for shown in recorded.of_round(number):
            exhibit, size = _exhibit(recorded, shown, left)
            left -= size
            found[number].append(exhibit)
    return found


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


def _took(notes: Mapping[str, Any]) -> tuple[str, ...]:
    found: list[str] = []
    calls = [number for number in _list(notes.get("calls")) if isinstance(number, int)]
    if calls:
        found.append(f"call{'' if len(calls) == 1 else 's'} {listed(calls)}")
    tokens = [notes.get("input_tokens"), notes.get("output_tokens")]
    if any(isinstance(one, int) and one for one in tokens):
        inside, outside = (count(one) if isinstance(one, int) else "–" for one in tokens)
        found.append(f"{inside} tokens in, {outside} out")
    for key, shown in (("cost", dollars), ("seconds", duration)):
        amount = notes.get(key)
        if isinstance(amount, int | float) and math.isfinite(amount):
            found.append(shown(amount))
    return tuple(found)


def _mended(notes: Mapping[str, Any], space: ParameterSpace) -> tuple[tuple[str, str], ...]:
    found: list[tuple[str, str]] = []
    clipped: Any = notes.get("clipped")
    moved = cast(dict[str, Any], clipped) if isinstance(clipped, dict) else {}
    for name, value in moved.items():
        if name in space.names and isinstance(value, int | float):
            bound = min(max(value, space[name].lower), space[name].upper)
            unit = "" if space[name].unit == "-" else f" {space[name].unit}"
            found.append(("clipped", f"{name} {significant(value)} → {significant(bound)}{unit}"))
    for key, what in (("ignored", "no parameter of this name"), ("missing", "kept as before")):
        names = [shortened(str(name)) for name in _list(notes.get(key))]
        if names:
            found.append((key, f"{listed(names, _MOST_NAMES)} ({what})"))
    found += [("remark", shortened(str(one))) for one in _list(notes.get("remarks"))]
    return tuple(found)


def _list(value: Any) -> list[Any]:
    return cast(list[Any], value) if isinstance(value, list) else []
