"""Worker processes that clean up behind them when their work is interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")


class Workers:
    """Processes that take one piece of work after the other; `workers` makes them."""

    def __init__(self, pool: ProcessPoolExecutor) -> None:
        self._pool = pool

    def submit(self, work: Callable[..., T], *arguments: Any) -> Future[T]:
        """Gives a function of a module and its arguments to the next process that is free."""
        with _interrupts_held():
            return self._pool.submit(_whole, work, arguments)


@contextmanager
def workers(
    count: int, begin: Callable[..., object] | None = None, arguments: tuple[Any, ...] = ()
) -> Generator[Workers]:
    """Starts processes when there is work for them.

    When anything is raised inside, Ctrl-C above all, what they are at is ended as by an error of its own, so that half
    of a file doesn't stay, and the rest isn't begun.

    Args:
        count: Processes at a time.
        begin: Called first in each process.
        arguments: Of `begin`.
    """
    others = set(multiprocessing.active_children())
    # a forked process would inherit threads of decoders
    pool = ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_begin, initargs=(begin, arguments)
    )
    try:
        yield Workers(pool)
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_held() -> Generator[None]:
    """Processes that are started meanwhile never see Ctrl-C, which a terminal sends to all; the parent ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(begin: Callable[..., object] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop)
    if begin is not None:
        begin(*arguments)


def _stop(number: int, frame: object) -> None:
    # the pool ends the others once more when one is gone, which must not interrupt their cleaning up
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(1)


def _whole(work: Callable[..., T], arguments: tuple[Any, ...]) -> T:
    try:
        return work(*arguments)
    except SystemExit:
        os._exit(1)  # else the pool would take it for a result, and give this process its next piece of work
