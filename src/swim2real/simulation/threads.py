"""Simulations on several threads; the engine runs without Python's lock, and every one by itself."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from swim2real.errors import EngineError

T = TypeVar("T")


def thread_count(threads: int | None) -> int:
    """How many to use; the number of cores for None.

    Raises:
        EngineError: Fewer than one.
    """
    if threads is not None and threads < 1:
        raise EngineError(f"threads is {threads}; it must be at least 1")
    return threads or os.cpu_count() or 1


def all_of(work: Sequence[Callable[[], T]], costs: Sequence[float], threads: int) -> list[T]:
    """Results in the order of the work, the costliest begun first, so that no thread is left with it at the end."""
    order = sorted(range(len(work)), key=lambda i: -costs[i])
    with ThreadPoolExecutor(threads) as pool:
        done = dict(zip(order, pool.map(lambda i: work[i](), order), strict=True))
    return [done[i] for i in range(len(work))]


def each_of(work: Sequence[Callable[[], T]], threads: int) -> Generator[T]:
    """Results one after the other, each as soon as it and those before it are there.

    Closing the generator gives up the rest.
    """
    pool = ThreadPoolExecutor(threads)
    try:
        yield from pool.map(lambda one: one(), work)
    finally:
        pool.shutdown(cancel_futures=True)
