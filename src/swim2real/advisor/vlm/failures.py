"""What a failed attempt means, and what a reply's end means, whichever provider it came from."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from swim2real.advisor.vlm.exchange import Finish

if TYPE_CHECKING:
    from pydantic_ai.messages import ModelResponse

Kind = Literal["again", "schema", "blocked", "too_long", "settings"]

LONGEST_MESSAGE = 300  # characters of what a provider says
RETRIED = (408, 409, 425, 429)  # beside all from 500 on

TOO_LONG = re.compile(
    r"context.?(length|window|size)|prompt is too long|maximum model length|exceed context limit|too many tokens"
    r"|input token count|number of tokens allowed|input length exceeds|payload size exceeds|request_too_large"
    r"|request too large|request exceeds the maximum|entity too large",
    re.IGNORECASE,
)
SCHEMA = re.compile(
    r"too many states|response_?(format|schema|json_?schema|mime_?type)|json_?schema|output_(config|format)|guided"
    r"|grammar|structured output|compiled schema|(invalid|complex|unsupported)\W+schema|schema\W+(is|produces)",
    re.IGNORECASE,
)
BLOCKED = re.compile(
    r"content.?(policy|filter|management)|safety system|moderation_blocked|usage policy|prohibited", re.IGNORECASE
)
SPENT = re.compile(r"insufficient_quota|credit balance|limit: 0\b|spend limit", re.IGNORECASE)


@dataclass(frozen=True)
class Failure:
    """What went wrong in one attempt.

    Attributes:
        kind: `again` may go better the next time, `schema` without its schema; the others are final.
        reason: In a few words, with what the provider said.
        asked: The wait that the server asks for [s].
    """

    kind: Kind
    reason: str
    asked: float | None = None


def judge(error: Exception, key_from: str, model: str) -> Failure:
    """What an exception of pydantic-ai, or of a library below, means.

    Args:
        error: From `providers.send`.
        key_from: The environment variable that holds the key, or what to do to have one.
        model: That was asked.
    """
    from pydantic_ai import exceptions as known

    if isinstance(error, known.ModelHTTPError):
        return _judge_status(error, key_from, model)
    if isinstance(error, (known.ModelRequestTimeout, known.ModelTimeoutError)):
        return Failure("again", "no answer in time")
    if isinstance(error, known.ModelConnectionError):
        return Failure("again", f"the connection failed ({_shorten(_root(error))})")
    if isinstance(error, known.UserError):
        return Failure("settings", f"the request can't be made for '{model}' ({_shorten(str(error))})")
    if isinstance(error, known.ContentFilterError):
        return Failure("blocked", _shorten(str(error)))
    status = getattr(error.__cause__, "code", None) or getattr(error.__cause__, "status_code", None)
    if isinstance(status, int) and 300 <= status < 400:
        return Failure("settings", f"the server sends to another address ({status}); check --base-url")
    return Failure("again", f"what came back isn't of the protocol ({type(error).__name__}: {_shorten(str(error))})")


def _judge_status(error: Any, key_from: str, model: str) -> Failure:
    from pydantic_ai import exceptions as known

    status: int = error.status_code
    said = _said(error.body)
    words = f"{said} {error.provider_error_code or ''} {error.provider_error_type or ''}"
    quoted = f"{status}: {_shorten(said) or 'no reason given'}"
    refused = status in (400, 413, 422) or (status == 429 and "request too large" in words.lower())
    if isinstance(error, known.ModelContextWindowExceededError) or status == 413:
        return Failure("too_long", quoted)
    if isinstance(error, known.ModelQuotaExceededError) or (status in (400, 402, 403, 429) and SPENT.search(words)):
        return Failure("settings", f"the quota or credit of {key_from} is used up ({quoted})")
    if isinstance(error, known.ModelAuthenticationError) or status in (401, 403):
        return Failure("settings", f"access was refused ({quoted}); check {key_from}")
    if isinstance(error, known.ModelNotFoundError) or status == 404:
        return Failure("settings", f"there is no model '{model}' at this address ({quoted}); check its name")
    if (refused or status == 500) and TOO_LONG.search(words):
        return Failure("too_long", quoted)
    if (refused or status == 500) and SCHEMA.search(words):
        return Failure("schema", quoted)
    if status in RETRIED or status >= 500:
        return Failure("again", quoted, error.retry_after)
    if refused and BLOCKED.search(words):
        return Failure("blocked", quoted)
    return Failure("settings", f"the request was refused ({quoted})")


def judge_reply(response: ModelResponse) -> Finish | Failure:
    """How a reply ended; a failure if there is none in it."""
    text = reply_text(response)
    details = response.provider_details or {}
    if response.finish_reason == "length":
        return "length"
    if "refusal" in details or details.get("finish_reason") == "refusal":
        return "refusal"
    reason = details.get("block_reason") or details.get("finish_reason")
    if response.finish_reason == "content_filter":
        return Failure("blocked", str(reason or "content filter"))
    if response.finish_reason is None and not text:  # an answer without candidates, or one that isn't an answer
        if reason or response.usage.input_tokens:
            return Failure("blocked", f"no reply and no more than '{reason or 'nothing'}' as a reason")
        return Failure("again", "what came back isn't of the protocol (no reply in it)")
    if response.finish_reason == "error" and not text:
        return Failure("again", f"the reply broke off ({reason})")
    return "stop"


def reply_text(response: ModelResponse) -> str:
    """The text of a reply without its thinking; of a refusal, what was said instead."""
    from pydantic_ai.messages import TextPart

    text = "".join(part.content for part in response.parts if isinstance(part, TextPart))
    return text or str((response.provider_details or {}).get("refusal") or "")


def _said(body: object) -> str:
    """The provider's own words in the body of an error."""
    seen: Any = body
    for _ in range(3):
        if isinstance(seen, list) and seen:
            seen = seen[0]
        if isinstance(seen, dict):
            inner = seen.get("error") or seen.get("message") or seen.get("detail")
            if inner is None:
                break
            seen = inner
    text = str(seen or "")
    return re.sub(r"<[^>]*>", " ", text) if text.lstrip().startswith("<") else text


def _root(error: BaseException) -> str:
    """What the lowest library says."""
    while error.__cause__ is not None:
        error = error.__cause__
    return str(error) or type(error).__name__


def _shorten(text: str) -> str:
    words = " ".join(text.split())
    return words if len(words) <= LONGEST_MESSAGE else words[: LONGEST_MESSAGE - 1] + "…"
