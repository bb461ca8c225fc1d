"""The transcript of a run's calls: one file a call, media beside them. It is also what a run is repeated from."""

from __future__ import annotations

import json
import mimetypes
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from swim2real.advisor.vlm.exchange import Attempt, Media, Reply, Request
from swim2real.errors import AdvisorError
from swim2real.optimizers import Evaluation

FORMAT = 1
CALLS = "advisor"  # folder of a run
MEDIA = "media"
Outcome = Literal["used", "unusable", "failed"]


@dataclass(frozen=True)
class Call:
    """One call as it is on record.

    Attributes:
        number: Within the run, from 1 on.
        round: That it belongs to.
        is_repair: Whether it asked to mend an earlier reply.
        advisor: Who was asked.
        outcome: `used`: a proposal was made of the reply. `unusable`: it asked for a repair. `failed`: no reply.
        problem: Why it wasn't used, in a sentence.
        incumbent: Point and loss of the evaluation that the round began with.
        reply: None when there was none.
        attempts: That were made.
    """

    number: int
    round: int
    is_repair: bool
    advisor: str
    outcome: Outcome
    problem: str | None
    incumbent: Mapping[str, Any]
    reply: Reply | None
    attempts: tuple[Attempt, ...]

    @property
    def seconds(self) -> float:
        return sum(attempt.seconds + attempt.waited for attempt in self.attempts)


@dataclass(frozen=True)
class Totals:
    """What the calls of a run took.

    Attributes:
        calls: Repairs and failed ones included.
        failed: Of them, those that weren't answered.
        input_tokens: As far as the services say.
        output_tokens: Likewise.
        cost: As far as prices are known [USD], None where none is.
        seconds: Waiting included [s].
    """

    calls: int = 0
    failed: int = 0
    input_tokens: int = 0
    output_tokens: int = 0
    cost: float | None = None
    seconds: float = 0.0


def totals(calls: Sequence[Call]) -> Totals:
    """The sum of some calls."""
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
        self.folder = Path(run) / CALLS

    @cached_property
    def _calls(self) -> list[Call]:
        return [_read(path) for path in sorted(self.folder.glob("call_*.json"))]

    @property
    def calls(self) -> tuple[Call, ...]:
        """All calls in order.

        Raises:
            AdvisorError: A file is damaged.
        """
        return tuple(self._calls)

    def of_round(self, number: int) -> tuple[Call, ...]:
        return tuple(call for call in self._calls if call.round == number)

    def answer(self, round_number: int, incumbent: Evaluation) -> Call | None:
        """The call that a round's proposal came of, if the round began at this incumbent; None without one."""
        for call in reversed(self.of_round(round_number)):
            if call.outcome == "used" and _is(call.incumbent, incumbent):
                return call
        return None

    def write(self, call: Call, request: Request) -> Call:
        """Adds a call, with its media; it is on the disk when this returns.

        Args:
            call: Its number is given here.
            request: What was asked.

        Raises:
            AdvisorError: The disk failed.
        """
        numbered = replace(call, number=max((one.number for one in self._calls), default=0) + 1)
        try:
            (self.folder / MEDIA).mkdir(parents=True, exist_ok=True)
            asked = [part if isinstance(part, str) else self._keep(part) for part in request.parts]
            path = self.folder / f"call_{numbered.number:04d}.json"
            _replace(path, json.dumps(_content(numbered, request, asked), indent=1, allow_nan=False).encode())
        except OSError as error:
            raise AdvisorError(
                f"can't write the transcript '{self.folder}': {error.strerror or error}; make room or allow writing "
                f"there, --resume goes on"
            ) from error
        self._calls.append(_read(path))  # as a later reader will find it, to the last digit
        return self._calls[-1]

    def _keep(self, media: Media) -> dict[str, Any]:
        ending = mimetypes.guess_extension(media.media_type) or ""
        path = self.folder / MEDIA / f"{media.sha256[:16]}{ending}"
        if not path.is_file():
            _replace(path, media.data)
        return {
            "media": f"{MEDIA}/{path.name}", "sha256": media.sha256, "bytes": len(media.data), "label": media.label,
            "media_type": media.media_type, "fps": media.fps,
        }  # fmt: skip


def stated(incumbent: Evaluation) -> dict[str, Any]:
    """Point and loss of an evaluation, to know it by."""
    return {"point": [float(x) for x in incumbent.candidate.point], "loss": incumbent.loss}


def _is(kept: Mapping[str, Any], incumbent: Evaluation) -> bool:
    return kept["loss"] == incumbent.loss and np.array_equal(kept["point"], incumbent.candidate.point)


def _content(call: Call, request: Request, asked: list[Any]) -> dict[str, Any]:
    reply = call.reply
    return {
        "format": FORMAT,
        "number": call.number,
        "round": call.round,
        "is_repair": call.is_repair,
        "advisor": call.advisor,
        "outcome": call.outcome,
        "problem": call.problem,
        "incumbent": dict(call.incumbent),
        "reply": None if reply is None else {
            "text": reply.text, "finish": reply.finish, "model": reply.model, "input_tokens": reply.input_tokens,
            "output_tokens": reply.output_tokens, "cost": reply.cost, "notes": list(reply.notes),
        },
        "attempts": [attempt.as_dict() for attempt in call.attempts],
        "request": {
            "instructions": request.instructions, "parts": asked, "schema": dict(request.schema),
            "max_tokens": request.max_tokens,
        },
    }  # fmt: skip


def _read(path: Path) -> Call:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}, this version of swim2real reads {FORMAT}")
        attempts = tuple(Attempt(one["seconds"], one["error"], one["waited"]) for one in content["attempts"])
        said = content["reply"]
        reply = None if said is None else Reply(
            said["text"], said["finish"], said["model"], said["input_tokens"], said["output_tokens"], said["cost"],
            attempts, tuple(said["notes"]),
        )  # fmt: skip
        return Call(
            content["number"], content["round"], content["is_repair"], content["advisor"], content["outcome"],
            content["problem"], content["incumbent"], reply, attempts,
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError) as error:
        what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else error
        raise AdvisorError(f"{path} is damaged ({what}); restore it, or remove it to ask again") from error


def _replace(path: Path, data: bytes) -> None:
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
