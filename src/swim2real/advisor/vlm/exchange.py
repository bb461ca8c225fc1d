"""What goes to a VLM and what comes back: plain data, whoever carries it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Protocol

from swim2real.errors import AdvisorError

Finish = Literal["stop", "length", "refusal"]
Failure = Literal["unreachable", "blocked", "too_long", "settings"]


@dataclass(frozen=True)
class Media:
    """A picture or a film that is shown.

    Attributes:
        label: What it shows, in a line that stands before it.
        media_type: `image/png`, `image/jpeg` or `video/mp4`.
        data: The file.
        fps: Frames a second that the model should look at; None for a picture.
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
        instructions: The system's part of the prompt.
        parts: Texts and media in the order in which they are shown.
        schema: JSON schema of the reply, without bounds on numbers.
        max_tokens: Most tokens of the reply, those of its thinking included.
        round: Of the run that it belongs to.
        problem: Of an earlier reply that this request asks to mend; empty for a question.
    """

    instructions: str
    parts: tuple[str | Media, ...]
    schema: Mapping[str, Any]
    max_tokens: int
    round: int = 1
    problem: str = ""

    @property
    def is_repair(self) -> bool:
        return bool(self.problem)

    @property
    def media(self) -> tuple[Media, ...]:
        return tuple(part for part in self.parts if isinstance(part, Media))


@dataclass(frozen=True)
class Attempt:
    """One try to get a request through.

    Attributes:
        seconds: That it took [s].
        error: What went wrong in a sentence, None when it was answered.
        waited: Before the next one [s].
    """

    seconds: float
    error: str | None = None
    waited: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {"seconds": round(self.seconds, 3), "error": self.error, "waited": round(self.waited, 3)}


@dataclass(frozen=True)
class Reply:
    """What a VLM answered.

    Attributes:
        text: As it came, JSON or not.
        finish: `length` when it was cut off, `refusal` when the model declined in so many words.
        model: That answered, by its own account; None where it doesn't say.
        input_tokens: As the provider counts them; None where it doesn't say.
        output_tokens: Likewise, with the thinking.
        cost: [USD], None where the price isn't known.
        attempts: All that were made, the last one answered.
        notes: What else should be kept, such as a request that went without its schema.
    """

    text: str
    finish: Finish
    model: str | None
    input_tokens: int | None
    output_tokens: int | None
    cost: float | None
    attempts: tuple[Attempt, ...]
    notes: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """From the first attempt to the reply, waiting included [s]."""
        return sum(attempt.seconds + attempt.waited for attempt in self.attempts)


class CallError(AdvisorError):
    """A request wasn't answered.

    Attributes:
        kind: `unreachable`: after all attempts. `blocked`: by a safety filter. `too_long`: for the model's context.
            `settings`: a wrong key, model or address, which no further attempt can mend.
        attempts: All that were made.
    """

    def __init__(self, kind: Failure, sentence: str, attempts: tuple[Attempt, ...] = ()) -> None:
        super().__init__(sentence)
        self.kind: Failure = kind
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
        """Asks, with a bounded number of attempts.

        Args:
            request: The question.
            on_attempt: Called after an attempt that failed and will be repeated, before the wait.

        Raises:
            CallError: No reply was had.
        """
        ...
