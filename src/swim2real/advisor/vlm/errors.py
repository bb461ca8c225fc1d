"""What a failed attempt means and how a reply ended, whichever provider it came from; and keys kept out of all texts.

pydantic-ai has exceptions for full contexts, spent quotas and refused keys, and they come first here. Servers that only
speak a provider's protocol use other words and status codes, so patterns are matched against their messages.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Literal

from swim2real.advisor.vlm.exchange import Finish
from swim2real.errors import ArgumentError

if TYPE_CHECKING:
    from pydantic_ai.messages import ModelResponse

AttemptErrorKind = Literal["retry", "schema", "blocked", "too_long", "settings"]

KEY_VARIABLES = ("GOOGLE_API_KEY", "GEMINI_API_KEY", "OPENAI_API_KEY", "ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN")
SHORTEST_KEY = 8  # characters; what is shorter is a placeholder such as EMPTY, and may be a word of a reply
LONGEST_PIECE = 11  # characters of a key that may stay where a library has cut it off; a longer piece is replaced
LOUD = ("httpx", "httpx2", "httpcore", "httpcore2", "openai", "anthropic", "google_genai", "google", "pydantic_ai")

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


class AttemptError(Exception):
    """What went wrong in one attempt.

    Attributes:
        kind: `retry` may go better the next time, `schema` without the schema; the others are final.
        reason: What happened in a few words, with what the provider said.
        retry_after: Time to wait that the server asks for [s]; None where it doesn't.
    """

    def __init__(self, kind: AttemptErrorKind, reason: str, retry_after: float | None = None) -> None:
        super().__init__(reason)
        self.kind: AttemptErrorKind = kind
        self.reason, self.retry_after = reason, retry_after


def classify_error(error: Exception, key_source: str, model: str) -> AttemptError:
    """Classifies an exception of pydantic-ai or of a library below it.

    Args:
        error: Exception of `providers.send`.
        key_source: Environment variable that holds the key, or what to do to have one.
        model: Model that was asked.
    """
    from pydantic_ai import exceptions as known

    if isinstance(error, known.ModelHTTPError):
        return _classify_status(error, key_source, model)
    if isinstance(error, (known.ModelRequestTimeout, known.ModelTimeoutError)):
        return AttemptError("retry", "no answer in time")
    if isinstance(error, known.ModelConnectionError):
        return AttemptError("retry", f"the connection failed ({_shorten(_root(error))})")
    if isinstance(error, known.UserError):
        return AttemptError("settings", f"the request can't be made for '{model}' ({_shorten(str(error))})")
    if isinstance(error, known.ContentFilterError):
        return AttemptError("blocked", _shorten(str(error)))
    status = getattr(error.__cause__, "code", None) or getattr(error.__cause__, "status_code", None)
    if isinstance(status, int) and 300 <= status < 400:
        return AttemptError("settings", f"the server sends to another address ({status}); check --base-url")
    return AttemptError(
        "retry", f"what came back isn't of the protocol ({type(error).__name__}: {_shorten(str(error))})"
    )


def _classify_status(error: Any, key_source: str, model: str) -> AttemptError:
    from pydantic_ai import exceptions as known

    status: int = error.status_code
    message = _provider_message(error.body)
    words = f"{message} {error.provider_error_code or ''} {error.provider_error_type or ''}"
    quoted = f"{status}: {_shorten(message) or 'no reason given'}"
    refused = status in (400, 413, 422) or (status == 429 and "request too large" in words.lower())
    if isinstance(error, known.ModelContextWindowExceededError) or status == 413:
        return AttemptError("too_long", quoted)
    if isinstance(error, known.ModelQuotaExceededError) or (status in (400, 402, 403, 429) and SPENT.search(words)):
        return AttemptError("settings", f"the quota or credit of {key_source} is used up ({quoted})")
    if isinstance(error, known.ModelAuthenticationError) or status in (401, 403):
        return AttemptError("settings", f"access was refused ({quoted}); check {key_source}")
    if isinstance(error, known.ModelNotFoundError) or status == 404:
        return AttemptError("settings", f"there is no model '{model}' at this address ({quoted}); check its name")
    if (refused or status == 500) and TOO_LONG.search(words):
        return AttemptError("too_long", quoted)
    if (refused or status == 500) and SCHEMA.search(words):
        return AttemptError("schema", quoted)
    if status in RETRIED or status >= 500:
        return AttemptError("retry", quoted, error.retry_after)
    if refused and BLOCKED.search(words):
        return AttemptError("blocked", quoted)
    return AttemptError("settings", f"the request was refused ({quoted})")


def classify_response(response: ModelResponse) -> Finish:
    """How a reply ended.

    Raises:
        AttemptError: There is no reply in the response.
    """
    text = reply_text(response)
    details = response.provider_details or {}
    if response.finish_reason == "length":
        return "length"
    if "refusal" in details or details.get("finish_reason") == "refusal":
        return "refusal"
    reason = details.get("block_reason") or details.get("finish_reason")
    if response.finish_reason == "content_filter":
        raise AttemptError("blocked", str(reason or "content filter"))
    if response.finish_reason is None and not text:  # an answer without candidates, or one that isn't an answer
        if reason or response.usage.input_tokens:
            raise AttemptError("blocked", f"no reply and no more than '{reason or 'nothing'}' as a reason")
        raise AttemptError("retry", "what came back isn't of the protocol (no reply in it)")
    if response.finish_reason == "error" and not text:
        raise AttemptError("retry", f"the reply broke off ({reason})")
    return "stop"


def reply_text(response: ModelResponse) -> str:
    """The text of a reply without its thinking; of a refusal, what was said instead."""
    from pydantic_ai.messages import TextPart

    text = "".join(part.content for part in response.parts if isinstance(part, TextPart))
    return text or str((response.provider_details or {}).get("refusal") or "")


def _provider_message(body: object) -> str:
    """The provider's own words in the body of an error."""
    content: Any = body
    for _ in range(3):
        if isinstance(content, list) and content:
            content = content[0]
        if isinstance(content, dict):
            inner = content.get("error") or content.get("message") or content.get("detail")
            if inner is None:
                break
            content = inner
    text = str(content or "")
    return re.sub(r"<[^>]*>", " ", text) if text.lstrip().startswith("<") else text


def _root(error: BaseException) -> str:
    """What the lowest library says."""
    while error.__cause__ is not None:
        error = error.__cause__
    return str(error) or type(error).__name__


def _shorten(text: str) -> str:
    words = " ".join(text.split())
    return words if len(words) <= LONGEST_MESSAGE else words[: LONGEST_MESSAGE - 1] + "…"


def read_key(variables: Iterable[str]) -> str | None:
    """The key in the first of these environment variables that is set; None if none is.

    Raises:
        ArgumentError: It holds what can't stand in a header, such as a space or a line break.
    """
    for variable in variables:
        if key := os.environ.get(variable, "").strip():
            if not (key.isascii() and key.isprintable()) or " " in key:
                raise ArgumentError(
                    f"{variable} holds no key: a key has no spaces, line breaks or letters beyond ASCII; set it again"
                )
            return key
    return None


def redact(text: str, variables: Iterable[str] = ()) -> str:
    """The text with every key that the environment holds replaced by the name of its variable, and pieces of it too.

    Args:
        text: Text of a provider, which may echo what it was sent, cut off anywhere.
        variables: Environment variables that hold keys, beside the usual ones.
    """
    keys = {os.environ.get(name, "").strip(): name for name in (*KEY_VARIABLES, *variables)}
    for key in sorted(keys, key=len, reverse=True):  # one may begin with another
        if len(key) >= SHORTEST_KEY:
            text = _without_pieces(text.replace(key, f"[{keys[key]}]"), key, f"[{keys[key]}]")
    return text


def _without_pieces(text: str, key: str, instead: str) -> str:
    """The text with pieces of a key replaced; those that are short, for the key too, stay."""
    size = max(SHORTEST_KEY, min(LONGEST_PIECE + 1, len(key) // 2))
    hit = bytearray(len(text))
    for i in range(len(key) - size + 1):
        at = text.find(key[i : i + size])
        while at >= 0:
            hit[at : at + size] = b"\1" * size
            at = text.find(key[i : i + size], at + 1)
    if not any(hit):
        return text
    return "".join(
        instead if mark else "".join(character for character, _ in run)
        for mark, run in groupby(zip(text, hit, strict=True), key=itemgetter(1))
    )


def quiet_libraries() -> None:
    """Keeps headers and media out of logs, even where everything else is logged."""
    for name in LOUD:
        logging.getLogger(name).setLevel(logging.WARNING)
