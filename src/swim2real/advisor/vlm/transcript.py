"""The transcript of a run's calls: one file per call, media beside them. It is also what a run is replayed from."""

from __future__ import annotations

import math
import mimetypes
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import AfterValidator, Field, FiniteFloat, TypeAdapter

from swim2real.advisor.vlm.exchange import Attempt, Media, Reply, Request
from swim2real.optimizers import Evaluation
from swimbase.checking import read
from swimbase.errors import AdvisorError
from swimbase.store import write_bytes, write_json, writing

CALLS = "advisor"  # folder of a run
MEDIA = "media"
Outcome = Literal["used", "asked", "unusable", "failed"]

_MOST_CALLS = 1_000_000  # calls or rounds; more is an error
_MEDIA_PATH = re.compile(rf"{MEDIA}/\w+\.\w+")
_SAME_LOSS = 0.01  # relative; the point decides, and another processor has other last digits


@dataclass(frozen=True)
class Incumbent:
    """The evaluation that a round began with, by what it is recognized by.

    Attributes:
        point: Point in the unit cube.
        loss: Loss [m].
    """

    point: tuple[FiniteFloat, ...]
    loss: FiniteFloat

    @classmethod
    def of(cls, evaluation: Evaluation) -> Incumbent:
        return cls(tuple(float(x) for x in evaluation.candidate.point), evaluation.loss)

    def matches(self, other: Incumbent) -> bool:
        """True if both are the same evaluation, perhaps simulated by another processor: its last digits may differ."""
        return self.point == other.point and math.isclose(self.loss, other.loss, rel_tol=_SAME_LOSS)


def _check_media_path(path: str) -> str:
    if not _MEDIA_PATH.fullmatch(path):
        raise ValueError("it names media outside of the transcript")
    return path


@dataclass(frozen=True)
class ShownMedia:
    """A picture or film of a request, as the transcript names it.

    Attributes:
        media: Path within the folder of the transcript.
        sha256: Hash of the file, as it was shown.
        label: What it shows.
        media_type: Such as `image/png`.
        bytes: Size of the file.
        fps: Frames per second that the model should look at; None for a picture.
    """

    media: Annotated[str, AfterValidator(_check_media_path)]
    sha256: str
    label: str
    media_type: str
    bytes: int = 0
    fps: float | None = None


@dataclass(frozen=True)
class _ShownRequest:
    """Record of what a request showed, with the fields of `Request`."""

    parts: tuple[ShownMedia | str, ...] = ()
    instructions: str = ""
    schema: Mapping[str, object] = field(default_factory=dict[str, object])
    max_tokens: int = 0


@dataclass(frozen=True)
class Call:
    """One call as it is on record; also the model that a file of the transcript is checked against.

    Attributes:
        number: Number within the run, from 1 on; 0 before it is written.
        round: Round that it belongs to.
        is_repair: Whether it asked to repair an earlier reply.
        advisor: Name of the advisor that was asked.
        outcome: `used` where a proposal was made of the reply, `asked` where it asked instruments, `unusable` where it
            asked for a repair, `failed` where there was no reply.
        problem: Why it wasn't used, in a sentence.
        incumbent: Evaluation that the round began with.
        reply: Reply, None when there was none.
        attempts: Attempts that were made.
        request: What was shown; given when the call is written.
        turn: Turn within the round: 1, and one more after each probe.
        solved: Values of the step that the instruments solved for the reply; None without.
        format: Of the file.
    """

    number: Annotated[int, Field(gt=0, lt=_MOST_CALLS)]
    round: Annotated[int, Field(gt=0, lt=_MOST_CALLS)]
    is_repair: bool
    advisor: str
    outcome: Outcome
    problem: str | None
    incumbent: Incumbent
    reply: Reply | None
    attempts: tuple[Attempt, ...]
    request: _ShownRequest = _ShownRequest()
    turn: Annotated[int, Field(gt=0, lt=_MOST_CALLS)] = 1
    solved: Mapping[str, FiniteFloat] | None = None
    format: Literal[1] = 1

    @property
    def seconds(self) -> float:
        """Time from the first attempt to the end, waiting included [s]."""
        return sum(attempt.seconds + attempt.waited for attempt in self.attempts)

    @property
    def media(self) -> tuple[ShownMedia, ...]:
        """Pictures and films that were shown."""
        return tuple(part for part in self.request.parts if isinstance(part, ShownMedia))


@dataclass(frozen=True)
class Totals:
    """Totals of a run's calls: tokens, seconds and cost.

    Attributes:
        calls: Number of calls, repairs and failed ones included.
        failed: Number of calls that weren't answered.
        input_tokens: Tokens of the requests, as far as the services say.
        output_tokens: Tokens of the replies, as far as the services say.
        cost: Cost as far as prices are known [USD], None where none is.
        seconds: Time, waiting included [s].
    """

    calls: int = 0
    failed: int = 0
    input_tokens: int = 0
    output_tokens: int = 0
    cost: float | None = None
    seconds: float = 0.0


def totals(calls: Sequence[Call]) -> Totals:
    """Sums over some calls."""
    replies = [call.reply for call in calls if call.reply is not None]
    costs = [reply.cost for reply in replies if reply.cost is not None]
    return Totals(
        calls=len(calls),
        failed=sum(call.outcome == "failed" for call in calls),
        input_tokens=sum(reply.input_tokens or 0 for reply in replies),
        output_tokens=sum(reply.output_tokens or 0 for reply in replies),
        cost=sum(costs) if costs else None,
        seconds=sum(call.seconds for call in calls),
    )


class Transcript:
    """Reads and writes the calls of one run. Nothing in it is ever changed."""

    def __init__(self, run: str | Path) -> None:
        """The transcript of a run folder, whether it has one yet or not. It is read when it is first needed."""
        self.run, self.folder = Path(run), Path(run) / CALLS

    @cached_property
    def _calls(self) -> list[Call]:
        return [self._read(path) for path in sorted(self.folder.glob("call_*.json"))]

    @property
    def calls(self) -> tuple[Call, ...]:
        """All calls in order.

        Raises:
            AdvisorError: A file is damaged.
        """
        return tuple(self._calls)

    def of_round(self, number: int) -> tuple[Call, ...]:
        return tuple(call for call in self._calls if call.round == number)

    def of_turn(self, round_number: int, turn: int, incumbent: Evaluation) -> tuple[Call, ...]:
        """The calls of a turn of a round that began at this incumbent, as a run that was resumed has asked them."""
        began = Incumbent.of(incumbent)
        return tuple(c for c in self.of_round(round_number) if c.turn == turn and c.incumbent.matches(began))

    def answer(self, round_number: int, turn: int, incumbent: Evaluation) -> Call | None:
        """The call whose reply a turn's advice was made of, if the turn began at this incumbent; None without."""
        used = [call for call in self.of_turn(round_number, turn, incumbent) if call.outcome == "used"]
        return used[-1] if used else None

    def write(self, call: Call, request: Request) -> Call:
        """Adds a call with its media, each file whole or not at all.

        Args:
            call: Call to add; its number is given here.
            request: What was asked.

        Raises:
            AdvisorError: The disk failed.
        """
        number = max((earlier.number for earlier in self._calls), default=0) + 1
        path = self.folder / f"call_{number:04d}.json"
        remedy = "make room or allow writing there, --resume goes on"
        with writing(self.folder, AdvisorError, remedy, what="transcript"):
            (self.folder / MEDIA).mkdir(parents=True, exist_ok=True)
            parts = tuple(part if isinstance(part, str) else self._write_media(part) for part in request.parts)
            shown = _ShownRequest(parts, request.instructions, request.schema, request.max_tokens)
            # a failed call has attempts as well, so they stand beside the reply
            whole = _CALL.dump_python(replace(call, number=number, request=shown), exclude={"reply": {"attempts"}})
            write_json(path, _kept(whole), indent=1)
        self._calls.append(self._read(path))  # as a later reader will have it, to the last digit
        return self._calls[-1]

    def _write_media(self, media: Media) -> ShownMedia:
        ending = mimetypes.guess_extension(media.media_type) or ""
        path = self.folder / MEDIA / f"{media.sha256[:16]}{ending}"
        if not path.is_file():
            write_bytes(path, media.data)
        place = f"{MEDIA}/{path.name}"
        return ShownMedia(place, media.sha256, media.label, media.media_type, len(media.data), media.fps)

    @staticmethod
    def _read(path: Path) -> Call:
        return read(Call, path, "call", AdvisorError, "restore it, or remove it to ask again")


_CALL = TypeAdapter(Call)


def _kept(content: Any) -> Any:
    """The same without what no file keeps: a NUL or half a character, which a reply may well hold, is replaced."""
    if isinstance(content, Mapping):
        return {_kept(key): _kept(value) for key, value in cast("Mapping[str, Any]", content).items()}
    if isinstance(content, list | tuple):
        return [_kept(value) for value in cast("list[Any]", content)]
    if not isinstance(content, str):
        return content
    return content.replace("\0", "\N{REPLACEMENT CHARACTER}").encode("utf-8", "replace").decode()
