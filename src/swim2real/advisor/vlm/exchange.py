"""Exchange with a VLM as plain data: request, media, reply, attempts, and who carries them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal, Protocol

from pydantic import FiniteFloat, PlainSerializer

from swimbase.errors import AdvisorError

Finish = Literal["stop", "length", "refusal"]
FailureKind = Literal["unreachable", "blocked", "too_long", "settings"]
Seconds = Annotated[FiniteFloat, PlainSerializer(lambda seconds: round(seconds, 3))]


@dataclass(frozen=True)
class Media:
    """A picture or a film that is shown.

    Attributes:
        label: What it shows, in a line that is sent before it.
        media_type: `image/png`, `image/jpeg` or `video/mp4`.
        data: Content of the file.
        fps: Frames per second that the model should look at; None for a picture.
    """

    label: str
    media_type: str
    data: bytes = field(repr=False)
    fps: float | None = None

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()


@dataclass(frozen=True)
class Request:
    """One question to a VLM.

    Attributes:
        instructions: System prompt.
        parts: Texts and media in the order in which they are shown.
        schema: JSON schema of the reply, without bounds on numbers.
        max_tokens: Most tokens of the reply, those of its thinking included.
        lasting: Number of leading parts that later requests begin with as well, so that services may keep them.
        round: Round of the run, from 1 on.
        turn: Turn within the round: 1, and one more after each probe.
        problem: Why an earlier reply can't be used, which this request asks to repair; empty for a question.
        answers: What the instruments say that the last reply asked; empty for a question.
    """

    instructions: str
    parts: tuple[str | Media, ...]
    schema: Mapping[str, Any]
    max_tokens: int
    lasting: int = 0
    round: int = 1
    turn: int = 1
    problem: str = ""
    answers: str = ""

    @property
    def is_repair(self) -> bool:
        return bool(self.problem)

    @property
    def media(self) -> tuple[Media, ...]:
        return tuple(part for part in self.parts if isinstance(part, Media))


@dataclass(frozen=True)
class Attempt:
    """One attempt to have a request answered.

    Attributes:
        seconds: Time that it took [s].
        error: What went wrong in a sentence, None when it was answered.
        waited: Time before the next attempt [s].
    """

    seconds: Seconds
    error: str | None = None
    waited: Seconds = 0.0


@dataclass(frozen=True)
class Reply:
    """Answer of a VLM.

    Attributes:
        text: Text as it came, JSON or not.
        finish: `stop` for a complete reply, `length` when it was cut off, `refusal` when the model declined in words.
        model: Model that answered, by its own account; None where it doesn't say.
        input_tokens: Tokens of the request as the provider counts them; None where it doesn't say.
        output_tokens: Tokens of the reply with the thinking, as the provider counts them; None where it doesn't say.
        cost: Cost [USD], None where the price isn't known.
        notes: Remarks to keep, such as that the request was sent without its schema.
        attempts: All attempts that were made; the last one was answered.
    """

    text: str
    finish: Finish
    model: str | None
    input_tokens: int | None
    output_tokens: int | None
    cost: FiniteFloat | None
    notes: tuple[str, ...] = ()
    attempts: tuple[Attempt, ...] = ()


class CallError(AdvisorError):
    """A request wasn't answered.

    Attributes:
        kind: `unreachable` after all attempts failed, `blocked` by a safety filter, `too_long` for the model's
            context, or `settings` for a wrong key, model or address, which no further attempt can mend.
        attempts: All attempts that were made.
    """

    def __init__(self, kind: FailureKind, sentence: str, attempts: tuple[Attempt, ...] = ()) -> None:
        super().__init__(sentence)
        self.kind: FailureKind = kind
        self.attempts = attempts


class Client(Protocol):
    """Carries a request to a model and brings the reply.

    Attributes:
        name: Provider and model, such as `google:gemini-3.1-pro-preview`.
        takes_video: Whether the model can be shown films; if not, it gets pictures.
        price_known: Whether replies will have a cost.
    """

    name: str
    takes_video: bool
    price_known: bool

    def call(self, request: Request, on_attempt: Callable[[Attempt], None] = lambda attempt: None) -> Reply:
        """Sends a request, with a bounded number of attempts.

        Args:
            request: What is asked.
            on_attempt: Called after an attempt that failed and will be repeated, before the wait.

        Raises:
            CallError: No attempt was answered.
        """
        ...
