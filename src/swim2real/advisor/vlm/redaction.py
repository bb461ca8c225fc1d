"""Keys: where they come from, and how they stay out of everything that is kept or shown."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable

from swim2real.errors import ArgumentError

KEY_VARIABLES = ("GOOGLE_API_KEY", "GEMINI_API_KEY", "OPENAI_API_KEY", "ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN")
SHORTEST_KEY = 8  # characters; what is shorter is a placeholder such as EMPTY, and may be a word of a reply
LOUD = ("httpx", "httpx2", "httpcore", "httpcore2", "openai", "anthropic", "google_genai", "google", "pydantic_ai")


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
        text: Of a provider, which may echo what it was sent.
        variables: Where keys are, beside the usual ones.
    """
    keys = {os.environ.get(name, "").strip(): name for name in (*KEY_VARIABLES, *variables)}
    for key in sorted(keys, key=len, reverse=True):  # one may begin with another
        if len(key) >= SHORTEST_KEY:
            text = text.replace(key, f"[{keys[key]}]")
    return text


def quiet_libraries() -> None:
    """Keeps headers and media out of logs, even where everything else is logged."""
    for name in LOUD:
        logging.getLogger(name).setLevel(logging.WARNING)
