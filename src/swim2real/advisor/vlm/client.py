"""A client for the VLMs of three providers, and for any server that speaks like one of them."""

from __future__ import annotations

import asyncio
import time
import warnings
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Literal, TypeVar
from urllib.parse import urlsplit

from swim2real.advisor.vlm.exchange import Attempt, CallError, Client, Reply, Request
from swim2real.advisor.vlm.failures import Failure, judge, judge_reply, reply_text
from swim2real.advisor.vlm.prices import price
from swim2real.advisor.vlm.providers import PLACEHOLDER, Provider, Sent, check_installed, find_provider, send
from swim2real.advisor.vlm.redaction import quiet_libraries, read_key, redact
from swim2real.advisor.vlm.retrying import Patience
from swim2real.errors import ArgumentError

MediaChoice = Literal["auto", "video", "images"]
T = TypeVar("T")


def make_client(
    name: str,
    base_url: str | None = None,
    key_variable: str | None = None,
    timeout: float = 180.0,
    tries: int = 6,
    media: MediaChoice = "auto",
    patience: Patience | None = None,
) -> Client:
    """A client for a model.

    The key comes from the environment. A server at `base_url` is never sent the provider's key, only the one that
    `key_variable` names.

    Args:
        name: Provider and model: `google:MODEL`, `openai:MODEL` or `anthropic:MODEL`.
        base_url: Of another server that speaks the provider's protocol, such as `http://127.0.0.1:8000/v1`.
        key_variable: The environment variable that holds the key, if it isn't the provider's usual one.
        timeout: For one attempt, from the start to the last byte [s].
        tries: Attempts for one request.
        media: `images` shows no films; `video` insists on them; `auto` shows them where the provider takes them.
        patience: How to wait between attempts; `tries` is then without effect.

    Raises:
        ArgumentError: The name, the address or the key won't do.
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
    check_installed()
    client = ModelClient(provider, model, base_url, key_variable, timeout, patience or Patience(tries), media)
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
        self,
        provider: Provider,
        model: str,
        base_url: str | None,
        key_variable: str | None,
        timeout: float,
        patience: Patience,
        media: MediaChoice = "auto",
    ) -> None:
        self.name = f"{provider.name}:{model}"
        self.takes_video = provider.takes_video and media != "images"
        self.price_known = base_url is None and price(provider.name, model, 1, 1) is not None
        self._provider = provider
        self._model = model
        self._base_url = base_url
        usual = () if base_url else provider.key_variables
        self._variables = (key_variable,) if key_variable else usual
        self._timeout = timeout
        self._patience = patience
        self._schema = True  # until the server refuses it

    def __repr__(self) -> str:
        return f"ModelClient({self.name!r})"

    def check_key(self) -> str:
        """The key, or a placeholder for a server without one.

        Raises:
            ArgumentError: The variable isn't set, or holds no key.
        """
        key = read_key(self._variables)
        if key is None and self._variables:
            named = " or ".join(self._variables)
            raise ArgumentError(f"there is no key for '{self.name}': set the environment variable {named}")
        return key or PLACEHOLDER

    def call(self, request: Request, on_attempt: Callable[[Attempt], None] = lambda attempt: None) -> Reply:
        """Asks, with a bounded number of attempts; see `Client.call`."""
        key = self.check_key()
        attempts: list[Attempt] = []
        failed = 0
        while True:
            started = time.monotonic()
            outcome = self._try(request, key)
            seconds = time.monotonic() - started
            if isinstance(outcome, Reply):
                return replace(outcome, attempts=(*attempts, Attempt(seconds)))
            failed += 1
            wait = 0.0
            if outcome.kind == "schema" and self._schema:
                self._schema = False
                failed -= 1  # the same request without it is no repetition
            elif outcome.kind == "again" and failed < self._patience.tries:
                wait = self._patience.wait(failed, outcome.asked)
            else:
                raise self._error(outcome, (*attempts, Attempt(seconds, outcome.reason)))
            attempts.append(Attempt(seconds, outcome.reason, wait))
            on_attempt(attempts[-1])
            if wait > 0:
                self._patience.sleep(wait)

    def _try(self, request: Request, key: str) -> Reply | Failure:
        """One attempt. Texts in what comes back are free of keys."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", DeprecationWarning)  # of models that will be switched off
            try:
                sent = _run(self._send(request, key))
                finish = judge_reply(sent.response)
            except Exception as error:
                key_from = self._variables[0] if self._variables else "the key, which --key-variable names"
                failure = judge(error, key_from, self._model)
                return replace(failure, reason=self._redact(failure.reason))
        if isinstance(finish, Failure):
            return replace(finish, reason=self._redact(finish.reason))
        notes = [self._redact(str(warning.message).split("\n")[0]) for warning in caught]
        if not sent.schema:
            notes.append("asked for JSON in words, since the model or its server takes no schema")
        usage = sent.response.usage
        return Reply(
            text=self._redact(reply_text(sent.response)),
            finish=finish,
            model=None if sent.model is None else self._redact(sent.model),
            input_tokens=usage.input_tokens or None,
            output_tokens=usage.output_tokens if usage.input_tokens else None,
            cost=self._cost(sent),
            attempts=(),
            notes=tuple(notes),
        )

    def _cost(self, sent: Sent) -> float | None:
        usage = sent.response.usage
        if self._base_url is not None or not usage.input_tokens:
            return None
        model, cached = sent.model or self._model, (usage.cache_read_tokens, usage.cache_write_tokens)
        return price(self._provider.name, model, usage.input_tokens, usage.output_tokens, *cached)

    async def _send(self, request: Request, key: str) -> Sent:
        quiet_libraries()
        return await send(self._provider, self._model, self._base_url, key, request, self._schema, self._timeout)

    def _error(self, failure: Failure, attempts: tuple[Attempt, ...]) -> CallError:
        match failure.kind:
            case "too_long":
                return CallError("too_long", f"the request is too long for '{self.name}' ({failure.reason})", attempts)
            case "blocked":
                return CallError("blocked", f"'{self.name}' blocked the request ({failure.reason})", attempts)
            case "settings" | "schema":
                return CallError("settings", f"'{self.name}' can't be asked: {failure.reason}", attempts)
            case "again":
                count = f"{len(attempts)} attempt{'s' if len(attempts) > 1 else ''}"
                sentence = f"'{self.name}' gave no reply in {count}, at last: {failure.reason}"
                return CallError("unreachable", f"{sentence}; check the network, or try again later", attempts)

    def _redact(self, text: str) -> str:
        return redact(text, self._variables)


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Runs it in a loop of its own, in another thread if this one has a loop already, as in a notebook."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()
