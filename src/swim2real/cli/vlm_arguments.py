"""What can be said of a VLM on the command line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Vlm:
    """For --advisor PROVIDER:MODEL and files."""

    show: Literal["both", "numbers", "pictures"] = "both"
    """What it is shown; one alone is an ablation."""
    media: Literal["auto", "video", "images"] = "auto"
    """Films or sheets of pictures; auto: films to those who take them."""
    detail: Literal["low", "medium", "high"] = "medium"
    """How much it is shown: trials, pictures, history."""
    base_url: str | None = None
    """A server that speaks the provider's protocol, such as vLLM, llama.cpp or Ollama (http://127.0.0.1:8000/v1)."""
    key_variable: str | None = None
    """Environment variable with the key for --base-url; by default it is sent none."""
    max_calls: int | None = None
    """Stop after so many calls; the run can go on with more."""
    max_cost: float | None = None
    """Stop before the calls cost more [USD], where the price is known."""
    reply_tokens: int = 16384
    """Most tokens of a reply, thinking included."""
    timeout: float = 180.0
    """For one attempt of a call [s]."""
    tries: int = 6
    """Attempts of one call."""
    once: bool = False
    """With files: write the question and leave; --resume goes on when the reply is there."""
