"""The providers of VLMs: names, addresses, prices, one request by pydantic-ai, and keys, kept out of all texts."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from swim2real.advisor.vlm.exchange import Request
from swimbase.errors import ArgumentError, MissingExtraError

if TYPE_CHECKING:
    import httpx2
    from pydantic_ai.messages import ModelResponse
    from pydantic_ai.models import Model

PLACEHOLDER = "no-key"  # what a server without keys is sent, since the libraries insist on one
_SHORTEST_KEY = 8  # characters; what is shorter is a placeholder such as EMPTY, and may be a word of a reply
_MOST_ANSWER = 4_000_000  # bytes of a server's answer, unpacked; a reply has some thousand
_LOUD = ("httpx", "httpx2", "httpcore", "httpcore2", "openai", "anthropic", "google_genai", "google", "pydantic_ai")


@dataclass(frozen=True)
class Provider:
    """A provider of models.

    Attributes:
        name: Name as it stands before the colon.
        address: Base URL of its service.
        key_variables: Environment variables that may hold its key; the first that is set counts.
        takes_video: Whether its models can be shown films; all take pictures.
        open: Opens a model: its own name, the base URL of another server or None, the key, and the connections to use.
    """

    name: str
    address: str
    key_variables: tuple[str, ...]
    takes_video: bool
    open: Callable[[str, str | None, str, httpx2.AsyncClient], Model[Any]]


def _google(model: str, base_url: str | None, key: str, http: httpx2.AsyncClient) -> Model[Any]:
    from pydantic_ai.models.google import GoogleModel
    from pydantic_ai.providers.google import GoogleProvider

    address = base_url or PROVIDERS["google"].address
    return GoogleModel(model, provider=GoogleProvider(api_key=key, base_url=address, http_client=http))


def _openai(model: str, base_url: str | None, key: str, http: httpx2.AsyncClient) -> Model[Any]:
    from pydantic_ai.models.openai import OpenAIChatModel
    from pydantic_ai.profiles.openai import OpenAIModelProfile
    from pydantic_ai.providers.openai import OpenAIProvider
    from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider

    # without its schema a request has no response_format at all: some servers refuse every kind of it
    profile = OpenAIModelProfile(supports_json_object_output=False)
    if base_url is None:
        own = OpenAIProvider(base_url=PROVIDERS["openai"].address, api_key=key, http_client=http)
        return OpenAIChatModel(model, provider=own, profile=profile)
    profile["openai_chat_supports_max_completion_tokens"] = False  # `max_tokens` is what all servers know
    profile["openai_chat_supports_multiple_system_messages"] = False  # many chat templates take one
    server = OpenAICompatibleProvider("server", base_url=base_url, api_key=key, http_client=http)
    return OpenAIChatModel(model, provider=server, profile=profile)


def _anthropic(model: str, base_url: str | None, key: str, http: httpx2.AsyncClient) -> Model[Any]:
    from pydantic_ai.models.anthropic import AnthropicModel
    from pydantic_ai.providers.anthropic import AnthropicProvider

    address = base_url or PROVIDERS["anthropic"].address
    return AnthropicModel(model, provider=AnthropicProvider(api_key=key, base_url=address, http_client=http))


# The addresses are given to the libraries, which else would take them from variables such as OPENAI_BASE_URL.
PROVIDERS: dict[str, Provider] = {
    provider.name: provider
    for provider in (
        Provider(
            "google", "https://generativelanguage.googleapis.com", ("GOOGLE_API_KEY", "GEMINI_API_KEY"), True, _google
        ),
        Provider("openai", "https://api.openai.com/v1", ("OPENAI_API_KEY",), False, _openai),
        Provider("anthropic", "https://api.anthropic.com", ("ANTHROPIC_API_KEY",), False, _anthropic),
    )
}  # fmt: skip
# what a library may send unasked counts as a key as well
_KEY_VARIABLES = (*(name for one in PROVIDERS.values() for name in one.key_variables), "ANTHROPIC_AUTH_TOKEN")


def check_installed() -> None:
    """Raises MissingExtraError if a library of the extra `vlm` is missing, without importing any."""
    for library in ("pydantic_ai", "openai", "anthropic", "genai_prices", "tenacity"):
        if find_spec(library) is None:
            raise _missing(library)
    if find_spec("google") is None or find_spec("google.genai") is None:
        raise _missing("google-genai")


def _missing(library: str) -> MissingExtraError:
    return MissingExtraError(f"asking a VLM needs {library}, install it with: pip install 'swim2real[vlm]'")


def same_model(asked: str, answered: str) -> bool:
    """True if the model that answered is the one that was asked.

    A date or a number at the end (`-2025-12-11`, `-20250929`, `-001`) may be on one of them, and an alias such as
    `gemini-flash-latest` stands for any number of that kind.
    """
    asked, answered = (re.sub(r"^models/", "", name.strip().lower()) for name in (asked, answered))
    if asked == answered or _bare(asked) == answered or asked == _bare(answered):
        return True
    if not asked.endswith("-latest"):
        return False
    words, others = _bare(asked).split("-"), _bare(answered).split("-")
    rest = [word for word in others if word not in words]
    return all(word in others for word in words) and all(re.fullmatch(r"v?[\d.]+|preview|exp", word) for word in rest)


def _bare(model: str) -> str:
    return re.sub(r"-(\d{4}-\d{2}-\d{2}|\d{8}|\d{3,4}|latest)$", "", model)


def price(
    provider: str, model: str, input_tokens: int, output_tokens: int, cache_read: int = 0, cache_write: int = 0
) -> float | None:
    """Cost of a reply by the price list that genai-prices carries [USD]; None for a model that isn't on the list.

    Args:
        provider: `google`, `openai` or `anthropic`.
        model: Model that answered.
        input_tokens: All tokens of the request, those from and to the provider's cache included.
        output_tokens: Tokens of the reply, those of its thinking included.
        cache_read: Input tokens that were found in the cache, which are cheaper.
        cache_write: Input tokens that were stored in the cache.
    """
    from genai_prices import Usage, calc_price

    usage = Usage(
        input_tokens=input_tokens,
        output_tokens=output_tokens,
        cache_read_tokens=cache_read,
        cache_write_tokens=cache_write,
    )
    try:
        return float(calc_price(usage, model, provider_id=provider).total_price)
    except LookupError:
        return None


async def send(
    provider: Provider, model: str, base_url: str | None, key: str, request: Request, with_schema: bool, timeout: float
) -> tuple[ModelResponse, str | None, bool]:
    """Sends one request once, and closes everything behind it.

    Args:
        provider: Provider whose protocol is spoken.
        model: The model's own name.
        base_url: Base URL of a server that isn't the provider's, or None.
        key: Key, which is sent in a header.
        request: What is asked.
        with_schema: Whether the provider is to keep the reply to the schema; if not, the instructions ask for it.
        timeout: Time from the start to the last byte [s].

    Returns:
        The response, the model that it says to be from, if it says so, and whether the provider was to keep to the
        schema.
    """
    import httpx2
    from pydantic_ai.direct import model_request
    from pydantic_ai.messages import BinaryContent, CachePoint, ModelRequest, UserPromptPart
    from pydantic_ai.models import ModelRequestParameters
    from pydantic_ai.output import OutputObjectDefinition

    content: list[str | BinaryContent | CachePoint] = []
    for number, part in enumerate(request.parts, start=1):
        if isinstance(part, str):
            content.append(part)
        else:
            details = None if part.fps is None else {"fps": part.fps}
            content += [part.label, BinaryContent(part.data, media_type=part.media_type, vendor_metadata=details)]
        if number == request.lasting:
            content.append(CachePoint())
    named: list[str] = []

    async def keep_name(response: httpx2.Response) -> None:
        # pydantic-ai gives the name that was asked where a reply has none
        content = bytearray()
        async for part in response.aiter_bytes():
            content += part
            if len(content) > _MOST_ANSWER:
                raise ValueError(f"the answer has more than {_MOST_ANSWER / 1e6:g} MB; at most that is read")
        response._content = bytes(content)  # pyright: ignore[reportPrivateUsage]  # as `aread` does
        named.extend(re.findall(r'"(?:modelVersion|model)"\s*:\s*"([^"]+)"', response.text)[:1])

    async def drop_foreign_keys(asked: httpx2.Request) -> None:
        # such as those in ANTHROPIC_CUSTOM_HEADERS, which the library sends to whoever is at the other end
        for header, value in list(asked.headers.items()):
            if key not in value and redact(value) != value:
                del asked.headers[header]

    # no redirects: a key must not follow them
    limits = httpx2.Timeout(timeout, connect=min(timeout, 30.0))
    hooks: dict[str, list[Callable[..., Any]]] = {
        "request": [drop_foreign_keys] if base_url else [],
        "response": [keep_name],
    }
    # what a run's requests have in common is kept by the services: Anthropic's where it is marked, the others unasked
    model_settings: Any = {
        "max_tokens": request.max_tokens,
        "max_retries": 0,
        "timeout": timeout,
        "request_timeout": timeout,
        "anthropic_cache_instructions": True,
    }
    async with httpx2.AsyncClient(timeout=limits, follow_redirects=False, event_hooks=hooks) as http:
        pydantic_model = provider.open(model, base_url, key, http)
        _quiet_libraries()  # now that they are imported: some set their own levels then
        native = with_schema and pydantic_model.profile.get("supports_json_schema_output", False)
        response = await model_request(
            pydantic_model,
            [ModelRequest(parts=[UserPromptPart(content=content)], instructions=request.instructions)],
            model_settings=model_settings,
            model_request_parameters=ModelRequestParameters(
                output_mode="native" if native else "prompted",
                output_object=OutputObjectDefinition(json_schema=dict(request.schema), name="proposal"),
            ),
        )
    return response, named[0] if named else None, native


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
    """The text with every key that the environment holds replaced by the name of its variable.

    Args:
        text: Text of a provider, which may echo what it was sent; not yet cut off.
        variables: Environment variables that hold keys, beside the usual ones.
    """
    keys = {os.environ.get(name, "").strip(): name for name in (*_KEY_VARIABLES, *variables)}
    for key in sorted(keys, key=len, reverse=True):  # one may begin with another
        if len(key) >= _SHORTEST_KEY:
            text = text.replace(key, f"[{keys[key]}]")
    return text


def _quiet_libraries() -> None:
    """Keeps headers and media out of logs, even where everything else is logged."""
    for name in _LOUD:
        logging.getLogger(name).setLevel(logging.WARNING)
