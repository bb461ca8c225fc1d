"""Several processes on this machine that do work side by side, behind the interface of `concurrent.futures`.

Why it isn't a `concurrent.futures.ProcessPoolExecutor`, nor loky's: both give all work up when one process dies, and
can't say whose work it was. Here a process that dies costs only the work that it was at, which is done again; an error
in the parent ends the work at once, so that half-written files are removed; and no process outlives the parent.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import FrameType, TracebackType
from typing import Any

from swimbase.errors import ArgumentError, Swim2RealError

TRIES = 3  # of work whose process dies
_CLEANING_TIME = 20.0  # s that an ended process has for removing what it has half done
_PR_SET_PDEATHSIG = 1  # of Linux's <sys/prctl.h>


class ProcessDiedError(Swim2RealError):
    """The process that did a piece of work was killed, each time that it was tried."""


class ProcessPool(Executor):
    """Processes on this machine, each with a thread that hands it one piece of work after the other.

    At the end of a `with` block all work is finished. An error inside it, Ctrl-C above all, ends the work that is under
    way by raising `SystemExit` in it, and begins nothing more. Processes are started when there is work for them; they
    are spawned, since a forked process would inherit the threads of decoders and solvers, and don't hear Ctrl-C, which
    a terminal sends to all.
    """

    def __init__(
        self, count: int | None = None, *, tries: int = TRIES, initializer: Callable[..., object] | None = None,
        initargs: tuple[Any, ...] = (),
    ) -> None:  # fmt: skip
        """Prepares the pool; no process is started yet.

        Args:
            count: Processes at a time; None for as many as there are cores.
            tries: How often a piece of work is begun whose process dies.
            initializer: Called first in each process.
            initargs: Arguments of the initializer.

        Raises:
            ArgumentError: The count is below 1.
        """
        if count is not None and count < 1:
            raise ArgumentError(f"workers is {count}; it must be at least 1")
        self._tries = tries
        self._initializer, self._initargs = initializer, initargs
        self._threads = ThreadPoolExecutor(count or os.cpu_count() or 1, "work")
        # Linux ends a process with the thread that started it: this one lives as long as the pool
        self._starter = ThreadPoolExecutor(1, "start", initializer=_block_interrupts)
        self._own = threading.local()
        self._processes: list[tuple[BaseProcess, Connection]] = []
        self._stopped = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Gives a function of a module and its arguments to the next process that is free.

        The future raises what the function raised, or `ProcessDiedError`.
        """
        return self._threads.submit(self._do, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes when the submitted work is done; without waiting, ends the work as well."""
        if wait:
            self._threads.shutdown(wait=True, cancel_futures=cancel_futures)
            for _, connection in self._processes:
                connection.close()  # which ends the process's loop
        else:
            self._starter.submit(self._stop).result()
            self._threads.shutdown(wait=False, cancel_futures=True)
        deadline = time.monotonic() + _CLEANING_TIME
        for process, connection in self._processes:
            process.join(max(0.0, deadline - time.monotonic()))
            if process.is_alive():
                process.kill()
                process.join()
            connection.close()
        self._threads.shutdown(wait=True)
        self._starter.shutdown(wait=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.shutdown(wait=kind is None)

    def _do(self, fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        message = pickle.dumps((fn, args, kwargs))
        for _ in range(self._tries):
            connection = getattr(self._own, "connection", None) or self._starter.submit(self._start).result()
            self._own.connection = connection
            try:
                connection.send_bytes(message)
                succeeded, result = connection.recv()
            except (EOFError, OSError):
                self._own.connection = None
                continue
            if succeeded:
                return result
            raise result
        times = f" {self._tries} times" if self._tries > 1 else ""
        raise ProcessDiedError(f"the process died{times}, perhaps for want of memory; run again with --workers 1")

    def _start(self) -> Connection:
        if self._stopped:
            raise CancelledError
        context = multiprocessing.get_context("spawn")
        connection, end = context.Pipe()
        process = context.Process(target=_serve, args=(end, self._initializer, self._initargs), daemon=True)
        process.start()
        end.close()
        self._processes.append((process, connection))
        return connection

    def _stop(self) -> None:
        self._stopped = True
        for process, _ in self._processes:
            process.terminate()


def _block_interrupts() -> None:
    """Blocks Ctrl-C in this thread, which the processes that it starts inherit until they ignore it themselves."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _serve(connection: Connection, initializer: Callable[..., object] | None, initargs: tuple[Any, ...]) -> None:
    """Loop of a process: it receives work, does it, and sends back whether it succeeded and the result or error."""
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _exit)
    if initializer is not None:
        initializer(*initargs)
    while True:
        try:
            message = connection.recv_bytes()
        except (EOFError, OSError):
            return
        reply: tuple[bool, Any]
        try:
            fn, args, kwargs = pickle.loads(message)
            reply = True, fn(*args, **kwargs)
        except Exception as error:
            reply = False, error
        connection.send_bytes(_pickled(reply))


def _pickled(reply: tuple[bool, Any]) -> bytes:
    try:
        return pickle.dumps(reply)
    except Exception as error:  # classes raise what they like
        return pickle.dumps((False, TypeError(f"{reply[1]!r} can't be sent to another process: {error}")))


def _end_with_parent() -> None:
    """Ends this process when the one that started it has ended, however that came."""
    parent = multiprocessing.parent_process()
    if parent is None or parent.pid is None:
        return
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent.pid:  # it ended before
            os._exit(1)
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()  # other systems have only this


def _follow(parent: Any) -> None:
    parent.join()
    os._exit(1)


def _exit(number: int, frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second signal must not interrupt the cleaning up
    raise SystemExit(1)
