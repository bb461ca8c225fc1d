"""Keeping the schedule on a busy machine."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator
from contextlib import contextmanager

_PRIORITY = 10  # of 99 for real-time tasks


@contextmanager
def undisturbed() -> Generator[bool]:
    """Real-time priority where the system lets us, and no garbage collection; gives whether we have the priority.

    On Linux it takes root or CAP_SYS_NICE. Threads that are started within have it too.
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
