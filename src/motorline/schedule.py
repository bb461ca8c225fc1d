"""An absolute schedule: command k is due k/50 s after the start, whatever happened to the ones before.

Also real-time priority, which keeps the schedule on a busy machine.
"""

from __future__ import annotations

import gc
import math
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from motorline.commands import RATE

ON_TIME = 0.002  # s
_SPIN = 0.0005  # s before a deadline from which on the clock is watched; a sleep may end this late
_HALF = 0.5 / RATE  # s
_PRIORITY = 10  # of 99 for real-time tasks


@dataclass(frozen=True)
class Punctuality:
    """Punctuality of commands; all figures are 0 where nothing was sent.

    Attributes:
        sent: Commands that were sent.
        skipped: Commands that were so late that the next one was sent instead.
        on_time_share: Share of all commands that were sent within `ON_TIME` of their time.
        median: Median lateness [s].
        percentile_99: 99th percentile of the lateness [s].
        worst: Greatest lateness [s].
    """

    sent: int
    skipped: int
    on_time_share: float
    median: float
    percentile_99: float
    worst: float

    @staticmethod
    def of(lateness: Sequence[float], skipped: int = 0) -> Punctuality:
        """Figures of the lateness of each command that was sent [s]. Skipped commands count as not on time."""
        ordered = sorted(lateness)
        due = len(ordered) + skipped

        def quantile(share: float) -> float:
            return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else 0.0

        on_time_share = sum(late <= ON_TIME for late in ordered) / due if due else 0.0
        return Punctuality(len(ordered), skipped, on_time_share, quantile(0.5), quantile(0.99), quantile(1.0))


class Schedule:
    """Waits for one deadline after the other.

    A deadline that passed more than half a period ago is skipped, and commands are never sent closer together than
    half a period: late ones don't bunch up.

    Attributes:
        start: Time of command 0 [s of the clock].
        skipped: Number of commands skipped so far.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._clock, self._sleep = clock, sleep
        self._last = -math.inf
        self.start = clock()
        self.skipped = 0

    def due(self, k: int) -> float:
        """When command k is due [s of the clock]."""
        return self.start + k / RATE

    def left(self, k: int) -> float:
        """Seconds until command k is due; below 0 when it is late."""
        return self.due(k) - self._clock()

    def sent(self, k: int, at: float) -> float:
        """Notes when command k was sent [s of the clock] and returns how late that was [s]."""
        self._last = at
        return at - self.due(k)

    def ticks(self, count: int, stop: Callable[[], bool] = lambda: False) -> Iterator[int]:
        """Yields the number of each command when it is due, until `count` are reached or `stop` returns true."""
        k = 0
        while k < count:
            while k + 1 < count and self.left(k) < -_HALF:  # the last one is sent, however late
                k += 1
                self.skipped += 1
            self.wait_until(max(self.due(k), self._last + _HALF))
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


@contextmanager
def real_time_priority() -> Generator[bool]:
    """Takes real-time priority where the system allows it, and switches garbage collection off.

    Linux allows it to root and with CAP_SYS_NICE. Threads that are started within the context have it too.

    Yields:
        Whether the priority was given.
    """
    before: tuple[int, os.sched_param] | None = None
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except (OSError, AttributeError):  # not allowed, or not Linux
        before = None
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield before is not None
    finally:
        if collecting:
            gc.enable()
        if before:
            os.sched_setscheduler(0, *before)
