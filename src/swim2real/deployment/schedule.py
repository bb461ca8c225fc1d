"""An absolute schedule: command k is due k/50 s after the start, whatever happened to the ones before."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from swim2real.deployment.commands import RATE

ON_TIME = 0.002  # s
_SPIN = 0.0005  # s before a deadline from which on the clock is watched; a sleep may end this late


@dataclass(frozen=True)
class Punctuality:
    """How punctual commands were. Times in seconds; `skipped` were so late that the next one was sent instead.

    All are 0 where nothing was sent.
    """

    sent: int
    skipped: int
    on_time_share: float
    median: float
    percentile_99: float
    worst: float

    @staticmethod
    def of(lateness: Sequence[float], skipped: int = 0) -> Punctuality:
        """From the lateness of each command that was sent [s]. Skipped ones count as not on time."""
        ordered = sorted(lateness)
        due = len(ordered) + skipped

        def quantile(share: float) -> float:
            return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else 0.0

        return Punctuality(
            sent=len(ordered),
            skipped=skipped,
            on_time_share=sum(one <= ON_TIME for one in ordered) / due if due else 0.0,
            median=quantile(0.5),
            percentile_99=quantile(0.99),
            worst=ordered[-1] if ordered else 0.0,
        )


class Schedule:
    """Waits for one deadline after the other. `start` is the time of command 0 [s of the clock].

    A deadline that passed more than half a period ago is skipped, and commands are never sent closer together than
    half a period: late ones don't bunch up.
    """

    def __init__(
        self,
        rate: float = RATE,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._half = 0.5 / rate
        self._rate = rate
        self._clock = clock
        self._sleep = sleep
        self._last = -math.inf
        self.start = clock()
        self.skipped = 0

    def due(self, k: int) -> float:
        """When command k is due [s of the clock]."""
        return self.start + k / self._rate

    def left(self, k: int) -> float:
        """Seconds until command k is due; below 0 when it is late."""
        return self.due(k) - self._clock()

    def sent(self, k: int, at: float) -> float:
        """Notes when command k was sent [s of the clock]; gives how late that was [s]."""
        self._last = at
        return at - self.due(k)

    def ticks(self, count: int, stop: Callable[[], bool] = lambda: False) -> Iterator[int]:
        """The numbers of the commands, each when it is due; fewer when `stop` says so."""
        k = 0
        while k < count:
            while k + 1 < count and self.left(k) < -self._half:  # the last one is sent, however late
                k += 1
                self.skipped += 1
            self.wait_until(max(self.due(k), self._last + self._half))
            if stop():
                return
            yield k
            k += 1

    def wait_until(self, then: float) -> None:
        """Sleeps until shortly before, then watches the clock."""
        while (left := then - self._clock()) > _SPIN:
            self._sleep(left - _SPIN)
        while self._clock() < then:
            pass
