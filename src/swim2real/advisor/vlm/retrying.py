"""How long to wait before the next attempt."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from swim2real.errors import ArgumentError


@dataclass(frozen=True)
class Patience:
    """Bounded attempts with exponential waits and full jitter.

    Attributes:
        tries: Attempts in all.
        base: Longest wait before the second attempt; it doubles from there [s].
        cap: Longest wait of our own [s].
        longest: Longest wait of all, even if the server asks for more [s].
        sleep: Waits.
        random: A number from 0 to 1. The jitter is no part of a run's result, so it has no seed.
    """

    tries: int = 6
    base: float = 2.0
    cap: float = 60.0
    longest: float = 120.0
    sleep: Callable[[float], None] = time.sleep
    random: Callable[[], float] = field(default_factory=lambda: random.Random().random)

    def __post_init__(self) -> None:
        if self.tries < 1:
            raise ArgumentError(f"tries is {self.tries}; it must be at least 1")

    def wait(self, failed: int, asked: float | None) -> float:
        """Before the next attempt [s].

        Args:
            failed: Attempts so far.
            asked: What the server asked for [s], which is kept to up to `longest`.
        """
        own = self.random() * min(self.cap, self.base * 2 ** (failed - 1))
        return min(self.longest, max(own, asked or 0.0))
