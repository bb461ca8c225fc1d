"""A client for the VLMs of three providers, and for any server that speaks the protocol of one of them.

Attempts are repeated by tenacity, around the whole exchange. The transports with retries that pydantic-ai offers work
below it, on single HTTP responses: they don't see a page of HTML or a broken body that came with status 200, they don't
bound an attempt whose bytes drip in, and they keep no record of attempts, which the transcript of a run holds.
"""

from __future__ import annotations

import asyncio
import os
import re
import time
import warnings
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar
from urllib.parse import urlsplit

from swim2real.advisor.vlm.errors import (
    AttemptError,
    classify_error,
    classify_response,
    read_key,
    redact,
    reply_text,
)
from swim2real.advisor.vlm.exchange import Attempt, CallError, Client, Reply, Request
from swim2real.advisor.vlm.providers import (
    PLACEHOLDER,
    Provider,
    RawReply,
    check_installed,
    find_provider,
    price,
    send,
)
from swim2real.errors import ArgumentError

if TYPE_CHECKING:
    from tenacity import RetryCallState, Retrying

_VARIABLE = re.compile(r"[A-Z_][A-Z0-9_]{0,31}", re.IGNORECASE | re.ASCII)  # keys are longer, or have other characters

MediaChoice = Literal["auto", "video", "images"]
T = TypeVar("T")


@dataclass(frozen=True)
class RetryPolicy:
    """How often a request is sent, and how long to wait in between: exponential waits with full jitter.

    Attributes:
        tries: Attempts in all.
        first_wait: Longest wait before the second attempt; it doubles from there [s].
        longest_wait: Longest wait of our own choice [s].
        longest_requested_wait: Longest wait that a server may ask for [s].
        sleep: Function that waits so many seconds.
    """

    tries: int = 6
    first_wait: float = 2.0
    longest_wait: float = 60.0
    longest_requested_wait: float = 120.0
    sleep: Callable[[float], None] = time.sleep

    def __post_init__(self) -> None:
        if self.tries < 1:
            raise ArgumentError(f"tries is {self.tries}; it must be at least 1")

    def retrying(self, before_wait: Callable[[float], None]) -> Retrying:
        """A caller of functions that repeats them after an `AttemptError` of the kind `retry`.

        Args:
            before_wait: Called before each wait with its length [s].
        """
        import tenacity

        own_wait = tenacity.wait_random_exponential(multiplier=self.first_wait, max=self.longest_wait)

        def wait(state: RetryCallState) -> float:
            error = state.outcome.exception() if state.outcome else None
            requested = (error.retry_after if isinstance(error, AttemptError) else None) or 0.0
            return min(self.longest_requested_wait, max(own_wait(state), requested))

        return tenacity.Retrying(
            stop=tenacity.stop_after_attempt(self.tries),
            retry=tenacity.retry_if_exception(lambda error: isinstance(error, AttemptError) and error.kind == "retry"),
            wait=wait,
            before_sleep=lambda state: before_wait(state.upcoming_sleep),
            sleep=self.sleep,
            reraise=True,
        )


def make_client(
    name: str,
    base_url: str | None = None,
    key_variable: str | None = None,
    timeout: float = 180.0,
    media: MediaChoice = "auto",
    retry: RetryPolicy | None = None,
) -> Client:
    """A client for a model.

    The key comes from the environment. A server at `base_url` is never sent the provider's key, only the one that
    `key_variable` names.

    Args:
        name: Provider and model: `google:MODEL`, `openai:MODEL` or `anthropic:MODEL`.
        base_url: Base URL of another server that speaks the provider's protocol, such as `http://127.0.0.1:8000/v1`.
        key_variable: Environment variable that holds the key, if it isn't the provider's usual one.
        timeout: Time for one attempt, from the start to the last byte [s].
        media: `images` shows no films; `video` insists on them; `auto` shows them where the provider takes them.
        retry: How often an attempt is repeated; None for the usual policy.

    Raises:
        ArgumentError: The name, the address or the key is not allowed.
        MissingExtraError: The extra `vlm` isn't installed.
    """
    provider, model = find_provider(name)
    if media == "video" and not provider.takes_video:
        raise ArgumentError(f"media is 'video', which {provider.name} doesn't take; choose 'auto' or 'images'")
    if timeout <= 0:
        raise ArgumentError(f"timeout is {timeout:g} s; it must be positive")
    if base_url is not None:
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
    if key_variable is not None and key_variable not in os.environ and not _VARIABLE.fullmatch(key_variable):
        raise ArgumentError(
            "--key-variable must be the name of an environment variable that is set, such as MY_KEY; what was given "
            "isn't one and isn't repeated here: if it is the key itself, others on this machine may have seen it in "
            "the list of processes, so replace it by a new one"
        )
    check_installed()
    client = ModelClient(provider, model, base_url, key_variable, timeout, retry or RetryPolicy(), media)
    client.check_key()
    return client


class ModelClient:
    """Asks one model. Implements the protocol `Client`.

    It holds neither the key, which is read from the environment for every call, nor an open connection.

    Attributes:
        name: Provider and model.
        takes_video: Whether it is shown films.
        price_known: Whether replies will have a cost.
    """

    def __init__(
        self, provider: Provider, model: str, base_url: str | None, key_variable: str | None, timeout: float,
        retry: RetryPolicy, media: MediaChoice,
    ) -> None:  # fmt: skip
        self.name = f"{provider.name}:{model}"
        self.takes_video = provider.takes_video and media != "images"
        self.price_known = base_url is None and price(provider.name, model, 1, 1) is not None
        self._provider, self._model, self._base_url = provider, model, base_url
        usual = () if base_url else provider.key_variables
        self._variables = (key_variable,) if key_variable else usual
        self._timeout, self._retry = timeout, retry
        self._with_schema = True  # until the server refuses it

    def __repr__(self) -> str:
        return f"ModelClient({self.name!r})"

    def check_key(self) -> str:
        """The key, or a placeholder for a server without one.

        Raises:
            ArgumentError: The variable isn't set, or holds no key.
        """
        key = read_key(self._variables)
        if key is None and self._variables:
            names = " or ".join(self._variables)
            raise ArgumentError(f"there is no key for '{self.name}': set the environment variable {names}")
        return key or PLACEHOLDER

    def call(self, request: Request, on_attempt: Callable[[Attempt], None] = lambda attempt: None) -> Reply:
        """Sends a request, with a bounded number of attempts; see `Client.call`."""
        key = self.check_key()
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
            reply = self._retry.retrying(before_wait)(attempt)
        except AttemptError as error:
            raise self._call_error(error, tuple(attempts)) from None
        return replace(reply, attempts=tuple(attempts))

    def _attempt(self, request: Request, key: str) -> Reply | AttemptError:
        """One attempt. Its texts are free of keys; the error is returned, so that no cause with a key hangs on it."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DeprecationWarning)  # of models that will be switched off
            try:
                raw = _run(
                    send(self._provider, self._model, self._base_url, key, request, self._with_schema, self._timeout)
                )
                finish = classify_response(raw.response)
            except AttemptError as error:
                return self._redacted(error)
            except Exception as error:
                key_source = self._variables[0] if self._variables else "the key, which --key-variable names"
                return self._redacted(classify_error(error, key_source, self._model))
        notes = [self._redact(str(warning.message).split("\n")[0]) for warning in caught]
        if not raw.with_schema:
            notes.append("asked for JSON in words, since the model or its server takes no schema")
        usage = raw.response.usage
        return Reply(
            text=self._redact(reply_text(raw.response)),
            finish=finish,
            model=None if raw.model is None else self._redact(raw.model),
            input_tokens=usage.input_tokens or None,
            output_tokens=usage.output_tokens if usage.input_tokens else None,
            cost=self._cost(raw),
            notes=tuple(notes),
        )

    def _cost(self, raw: RawReply) -> float | None:
        usage = raw.response.usage
        if self._base_url is not None or not usage.input_tokens:
            return None
        model, cached = raw.model or self._model, (usage.cache_read_tokens, usage.cache_write_tokens)
        return price(self._provider.name, model, usage.input_tokens, usage.output_tokens, *cached)

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

    def _redacted(self, error: AttemptError) -> AttemptError:
        return AttemptError(error.kind, self._redact(error.reason), error.retry_after)

    def _redact(self, text: str) -> str:
        """Text without keys, and without what can't be written in UTF-8."""
        return redact(text, self._variables).encode("utf-8", "replace").decode("utf-8")


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Runs it in a loop of its own, in another thread if this one has a loop already, as in a notebook."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()
