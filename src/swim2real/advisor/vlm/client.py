"""A client for the VLMs of three providers, and for any server that speaks the protocol of one of them.

Attempts are repeated by tenacity, around the whole exchange. The transports with retries that pydantic-ai offers work
below it, on single HTTP responses: they don't see a page of HTML or a broken body that came with status 200, they don't
bound an attempt whose bytes drip in, and they keep no record of attempts, which the transcript of a run holds.

pydantic-ai has exceptions for full contexts, spent quotas and refused keys, and they come first where a failure is
classified. Servers that only speak a provider's protocol use other words and status codes, so patterns are matched
against their messages.
"""

from __future__ import annotations

import asyncio
import os
import re
import time
import warnings
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar
from urllib.parse import urlsplit

from swim2real.advisor.vlm.exchange import Attempt, CallError, Finish, Reply, Request
from swim2real.advisor.vlm.providers import PLACEHOLDER, PROVIDERS, check_installed, price, read_key, redact, send
from swim2real.formatting import shortened
from swim2real.settings import MediaKind, VlmAccess, split_vlm_name
from swimbase.errors import ArgumentError

if TYPE_CHECKING:
    from pydantic_ai.messages import ModelResponse
    from tenacity import RetryCallState, Retrying

_FIRST_WAIT, _LONGEST_WAIT = 2.0, 60.0  # s, longest waits of our own choice: before the second attempt, and at all
_LONGEST_REQUESTED_WAIT = 120.0  # s, that a server may ask for
_VARIABLE = re.compile(r"[A-Z_][A-Z0-9_]{0,31}", re.IGNORECASE | re.ASCII)  # keys are longer, or have other characters
_RETRIED = (408, 409, 425, 429)  # beside all from 500 on

_TOO_LONG = re.compile(
    r"context.?(length|window|size)|prompt is too long|maximum model length|exceed context limit|too many tokens"
    r"|input token count|number of tokens allowed|input length exceeds|payload size exceeds|request_too_large"
    r"|request too large|request exceeds the maximum|entity too large",
    re.IGNORECASE,
)
_SCHEMA = re.compile(
    r"too many states|response_?(format|schema|json_?schema|mime_?type)|json_?schema|output_(config|format)|guided"
    r"|grammar|structured output|compiled schema|(invalid|complex|unsupported)\W+schema|schema\W+(is|produces)",
    re.IGNORECASE,
)
_BLOCKED = re.compile(
    r"content.?(policy|filter|management)|safety system|moderation_blocked|usage policy|prohibited", re.IGNORECASE
)
_SPENT = re.compile(r"insufficient_quota|credit balance|limit: 0\b|spend limit", re.IGNORECASE)
AttemptErrorKind = Literal["retry", "schema", "blocked", "too_long", "settings"]
T = TypeVar("T")


class ModelClient:
    """Asks one model. Implements the protocol `Client`.

    It holds neither the key, which is read from the environment for every call, nor an open connection. A server at
    another address is never sent the provider's key, only the one whose variable is named.

    Attributes:
        name: Provider and model.
        takes_video: Whether it is shown films.
        price_known: Whether replies will have a cost.
    """

    def __init__(
        self, name: str, access: VlmAccess, media: MediaKind = "auto", sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """Prepares the client.

        Args:
            name: Provider and model: `google:MODEL`, `openai:MODEL` or `anthropic:MODEL`.
            access: Address, variable of the key, timeout and attempts.
            media: `images` shows no films; `video` insists on them; `auto` shows them where the provider takes them.
            sleep: Waits so many seconds between attempts.

        Raises:
            ArgumentError: The name, the address or the key is not allowed.
            MissingExtraError: The extra `vlm` isn't installed.
        """
        provider_name, self._model = split_vlm_name(name)
        self._provider, self._access, self._sleep = PROVIDERS[provider_name], access, sleep
        if media == "video" and not self._provider.takes_video:
            raise ArgumentError(f"media is 'video', which {provider_name} doesn't take; choose 'auto' or 'images'")
        _check_address(access.base_url)
        variable = access.key_variable
        if variable is not None and variable not in os.environ and not _VARIABLE.fullmatch(variable):
            raise ArgumentError(
                "--key-variable must be the name of an environment variable that is set, such as MY_KEY; what was "
                "given isn't one and isn't repeated here: if it is the key itself, others on this machine may have "
                "seen it in the list of processes, so replace it by a new one"
            )
        check_installed()
        self.name = f"{provider_name}:{self._model}"
        self.takes_video = self._provider.takes_video and media != "images"
        self.price_known = access.base_url is None and price(provider_name, self._model, 1, 1) is not None
        usual = () if access.base_url else self._provider.key_variables
        self._variables = (variable,) if variable else usual
        self._with_schema = True  # until the server refuses it
        self._key()

    def __repr__(self) -> str:
        return f"ModelClient({self.name!r})"

    def _key(self) -> str:
        """The key, or a placeholder for a server without one."""
        key = read_key(self._variables)
        if key is None and self._variables:
            names = " or ".join(self._variables)
            raise ArgumentError(f"there is no key for '{self.name}': set the environment variable {names}")
        return key or PLACEHOLDER

    def call(self, request: Request, on_attempt: Callable[[Attempt], None] = lambda attempt: None) -> Reply:
        """Sends a request, with a bounded number of attempts; see `Client.call`."""
        key = self._key()
        attempts: list[Attempt] = []

        def attempt() -> Reply:
            while True:
                started = time.monotonic()
                result = self._attempt(request, key)
                seconds = time.monotonic() - started
                if isinstance(result, Reply):
                    attempts.append(Attempt(seconds))
                    return result
                attempts.append(Attempt(seconds, result.reason))
                if result.kind != "schema" or not self._with_schema:
                    raise result
                self._with_schema = False  # the same request without it is no repetition
                on_attempt(attempts[-1])

        def before_wait(seconds: float) -> None:
            attempts[-1] = replace(attempts[-1], waited=seconds)
            on_attempt(attempts[-1])

        try:
            reply = retrying(self._access.tries, before_wait, self._sleep)(attempt)
        except AttemptError as error:
            raise self._call_error(error, tuple(attempts)) from None
        return replace(reply, attempts=tuple(attempts))

    def _attempt(self, request: Request, key: str) -> Reply | AttemptError:
        """One attempt. Its texts are free of keys; the error is returned, so that no cause with a key hangs on it."""
        base_url, with_schema = self._access.base_url, self._with_schema
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DeprecationWarning)  # of models that will be switched off
            try:
                sending = send(
                    self._provider, self._model, base_url, key, request, with_schema, self._access.timeout
                )  # fmt: skip
                response, model, with_schema = _run(sending)
                finish = _finish_of(response)
            except AttemptError as error:
                return AttemptError(error.kind, self._redact(error.reason))
            except Exception as error:
                key_source = self._variables[0] if self._variables else "the key, which --key-variable names"
                return classify_error(error, key_source, self._model, self._quoted)
        notes = [self._redact(str(warning.message).split("\n")[0]) for warning in caught]
        if not with_schema:
            notes.append("asked for JSON in words, since the model or its server takes no schema")
        usage, cost = response.usage, None
        if base_url is None and usage.input_tokens:
            cached = usage.cache_read_tokens, usage.cache_write_tokens
            cost = price(self._provider.name, model or self._model, usage.input_tokens, usage.output_tokens, *cached)
        return Reply(
            text=self._redact(_reply_text(response)),
            finish=finish,
            model=None if model is None else self._redact(model),
            input_tokens=usage.input_tokens or None,
            output_tokens=usage.output_tokens if usage.input_tokens else None,
            cost=cost,
            notes=tuple(notes),
        )

    def _call_error(self, error: AttemptError, attempts: tuple[Attempt, ...]) -> CallError:
        match error.kind:
            case "too_long":
                return CallError("too_long", f"the request is too long for '{self.name}' ({error.reason})", attempts)
            case "blocked":
                return CallError("blocked", f"'{self.name}' blocked the request ({error.reason})", attempts)
            case "settings" | "schema":
                return CallError("settings", f"'{self.name}' can't be asked: {error.reason}", attempts)
            case "retry":
                count = f"{len(attempts)} attempt{'s' if len(attempts) > 1 else ''}"
                sentence = f"'{self.name}' gave no reply in {count}, at last: {error.reason}"
                return CallError("unreachable", f"{sentence}; check the network, or try again later", attempts)

    def _quoted(self, text: str) -> str:
        return shortened(" ".join(self._redact(text).split()))

    def _redact(self, text: str) -> str:
        """Text without keys, and without what can't be written in UTF-8."""
        return redact(text, self._variables).encode("utf-8", "replace").decode("utf-8")


def retrying(tries: int, before_wait: Callable[[float], None], sleep: Callable[[float], None]) -> Retrying:
    """A caller of functions that repeats them after an `AttemptError` of the kind `retry`.

    The waits in between are exponential with full jitter, or as long as the server asks for.

    Args:
        tries: Attempts in all.
        before_wait: Called before each wait with its length [s].
        sleep: Waits so many seconds.
    """
    import tenacity

    own_wait = tenacity.wait_random_exponential(multiplier=_FIRST_WAIT, max=_LONGEST_WAIT)

    def wait(state: RetryCallState) -> float:
        error = state.outcome.exception() if state.outcome else None
        requested = (error.retry_after if isinstance(error, AttemptError) else None) or 0.0
        return min(_LONGEST_REQUESTED_WAIT, max(own_wait(state), requested))

    return tenacity.Retrying(
        stop=tenacity.stop_after_attempt(tries),
        retry=tenacity.retry_if_exception(lambda error: isinstance(error, AttemptError) and error.kind == "retry"),
        wait=wait,
        before_sleep=lambda state: before_wait(state.upcoming_sleep),
        sleep=sleep,
        reraise=True,
    )


def _check_address(base_url: str | None) -> None:
    if base_url is None:
        return
    address = urlsplit(base_url)
    if address.scheme not in ("http", "https") or not address.hostname:
        raise ArgumentError(f"base URL is '{base_url}'; it must begin with http:// or https:// and name a server")
    if address.username or address.password:
        raise ArgumentError("the base URL holds a password; put the key in a variable and name it: --key-variable")
    if address.query or address.fragment:
        raise ArgumentError(
            f"the base URL of '{address.hostname}' goes on after a '?' or '#'; give it without: a key goes into a "
            f"variable, which --key-variable names"
        )


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Runs it in a loop of its own, in another thread if this one has a loop already, as in a notebook."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


class AttemptError(Exception):
    """Failure of one attempt.

    Attributes:
        kind: `retry` may go better the next time, `schema` without the schema; the others are final.
        reason: What happened in a few words, with what the provider said.
        retry_after: Time to wait that the server asks for [s]; None where it doesn't.
    """

    def __init__(self, kind: AttemptErrorKind, reason: str, retry_after: float | None = None) -> None:
        super().__init__(reason)
        self.kind: AttemptErrorKind = kind
        self.reason, self.retry_after = reason, retry_after


def classify_error(error: Exception, key_source: str, model: str, shown: Callable[[str], str]) -> AttemptError:
    """Classifies an exception of pydantic-ai or of a library below it.

    Args:
        error: Exception of `providers.send`.
        key_source: Environment variable that holds the key, or what to do to have one.
        model: Model that was asked.
        shown: A text of the provider as it may be repeated: short, and without keys.
    """
    from pydantic_ai import exceptions as known

    if isinstance(error, known.ModelHTTPError):
        return _classify_status(error, key_source, model, shown)
    if isinstance(error, (known.ModelRequestTimeout, known.ModelTimeoutError)):
        return AttemptError("retry", "no answer in time")
    if isinstance(error, known.ModelConnectionError):
        return AttemptError("retry", f"the connection failed ({shown(_root(error))})")
    if isinstance(error, known.UserError):
        return AttemptError("settings", f"the request can't be made for '{model}' ({shown(str(error))})")
    if isinstance(error, known.ContentFilterError):
        return AttemptError("blocked", shown(str(error)))
    status = getattr(error.__cause__, "code", None) or getattr(error.__cause__, "status_code", None)
    if isinstance(status, int) and 300 <= status < 400:
        return AttemptError("settings", f"the server sends to another address ({status}); check --base-url")
    return AttemptError("retry", f"what came back isn't of the protocol ({type(error).__name__}: {shown(str(error))})")


def _classify_status(error: Any, key_source: str, model: str, shown: Callable[[str], str]) -> AttemptError:
    from pydantic_ai import exceptions as known

    status: int = error.status_code
    message = _provider_message(error.body)
    words = f"{message} {error.provider_error_code or ''} {error.provider_error_type or ''}"
    quoted = f"{status}: {shown(message) or 'no reason given'}"
    refused = status in (400, 413, 422) or (status == 429 and "request too large" in words.lower())
    if isinstance(error, known.ModelContextWindowExceededError) or status == 413:
        return AttemptError("too_long", quoted)
    if isinstance(error, known.ModelQuotaExceededError) or (status in (400, 402, 403, 429) and _SPENT.search(words)):
        return AttemptError("settings", f"the quota or credit of {key_source} is used up ({quoted})")
    if isinstance(error, known.ModelAuthenticationError) or status in (401, 403):
        return AttemptError("settings", f"access was refused ({quoted}); check {key_source}")
    if isinstance(error, known.ModelNotFoundError) or status == 404:
        return AttemptError("settings", f"there is no model '{model}' at this address ({quoted}); check its name")
    if (refused or status == 500) and _TOO_LONG.search(words):
        return AttemptError("too_long", quoted)
    if (refused or status == 500) and _SCHEMA.search(words):
        return AttemptError("schema", quoted)
    if status in _RETRIED or status >= 500:
        return AttemptError("retry", quoted, error.retry_after)
    if refused and _BLOCKED.search(words):
        return AttemptError("blocked", quoted)
    return AttemptError("settings", f"the request was refused ({quoted})")


def _finish_of(response: ModelResponse) -> Finish:
    """Classifies the end of a reply.

    Raises:
        AttemptError: There is no reply in the response.
    """
    text = _reply_text(response)
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


def _reply_text(response: ModelResponse) -> str:
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
    return re.sub(r"<[^<>]*>", " ", text) if text.lstrip().startswith("<") else text


def _root(error: BaseException) -> str:
    """Message of the lowest library."""
    while error.__cause__ is not None:
        error = error.__cause__
    return str(error) or type(error).__name__
