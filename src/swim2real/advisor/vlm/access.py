"""How a VLM is reached, and what it may take."""

from __future__ import annotations

from dataclasses import dataclass

from swim2real.errors import ArgumentError

REPLY_TOKENS = 16_384  # thinking included


@dataclass(frozen=True)
class Access:
    """How a VLM is reached, and what it may take. May differ when a run goes on.

    Attributes:
        base_url: Of a server that speaks the provider's protocol; None for the provider's own.
        key_variable: Environment variable with the key for `base_url`; None sends none.
        timeout: Of one attempt [s].
        tries: Attempts of a call.
        max_calls: Calls of the run, repairs and failed ones included; None for any number.
        max_cost: Of the run [USD]; None for any.
        reply_tokens: Most tokens of a reply, those of its thinking included.
        once: With `files`: leave rather than wait for a reply.
    """

    base_url: str | None = None
    key_variable: str | None = None
    timeout: float = 180.0
    tries: int = 6
    max_calls: int | None = None
    max_cost: float | None = None
    reply_tokens: int = REPLY_TOKENS
    once: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.timeout < float("inf"):
            raise ArgumentError(f"timeout is {self.timeout:g} s; it must be finite and above 0")
        if self.tries < 1:
            raise ArgumentError(f"tries is {self.tries}; it must be at least 1")
        if self.reply_tokens < 256:
            raise ArgumentError(f"reply_tokens is {self.reply_tokens}; it must be at least 256")
