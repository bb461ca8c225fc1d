"""Who does the work: processes on this machine, or a Dask cluster. Both are a `concurrent.futures.Executor`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from swim2real.errors import ArgumentError, MissingExtraError, RunError

T = TypeVar("T")

TRIES = 3  # of work whose process dies
_CONNECT = 15  # s


class Processes(Executor):
    """Processes on this machine, each with a thread that minds it: work whose process dies is given to a new one."""

    def __init__(self, count: int) -> None:
        """Starts a process when there is work for it.

        Args:
            count: Processes at a time.

        Raises:
            ArgumentError: The count is below 1.
        """
        if count < 1:
            raise ArgumentError(f"workers is {count}; it must be at least 1")
        self._minders = ThreadPoolExecutor(count, "minder", initializer=_hold_interrupts)
        self._mine = threading.local()
        self._all: list[tuple[BaseProcess, Connection]] = []
        self._starting = threading.Lock()
        self._stopped = False

    @property
    def pids(self) -> list[int]:
        """Of the processes that live."""
        return [process.pid for process, _ in self._all if process.pid is not None and process.is_alive()]

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        return self._minders.submit(self._mind, fn, args, kwargs)

    def stop(self) -> None:
        """Ends the processes, whatever they are at, and begins nothing more."""
        with self._starting:
            self._stopped = True
            for process, _ in self._all:
                process.terminate()
        self._minders.shutdown(wait=True, cancel_futures=True)
        for process, connection in self._all:
            process.join()
            connection.close()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes after what was submitted is done; without waiting, like `stop`."""
        if not wait:
            return self.stop()
        self._minders.shutdown(wait=True, cancel_futures=cancel_futures)
        for process, connection in self._all:
            connection.close()  # which they take for the end
            process.join()
        return None

    def _mind(self, fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        for _ in range(TRIES):
            connection = self._process()
            try:
                connection.send((fn, args, kwargs))
                good, answer = connection.recv()
            except (EOFError, OSError):
                self._mine.connection = None
                continue
            if good:
                return answer
            raise answer
        raise RunError(
            f"its process died {TRIES} times, perhaps for want of memory; run again with fewer --workers to go on"
        )

    def _process(self) -> Connection:
        connection: Connection | None = getattr(self._mine, "connection", None)
        if connection is not None:
            return connection
        context = multiprocessing.get_context("spawn")  # a forked process would inherit threads
        with self._starting:
            if self._stopped:
                raise CancelledError
            connection, theirs = context.Pipe()
            process = context.Process(target=_serve, args=(theirs,), daemon=True)
            process.start()
            theirs.close()
            self._all.append((process, connection))
        self._mine.connection = connection
        return connection


def _hold_interrupts() -> None:
    """What a thread starts inherits this: Ctrl-C, which a terminal sends to all, is for the parent, which ends them."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _serve(connection: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()
    while True:
        try:
            fn, args, kwargs = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer: tuple[bool, Any] = (True, fn(*args, **kwargs))
        except Exception as error:
            answer = (False, error)
        connection.send(answer)


def _follow_parent() -> None:
    """Ends this process when the one that started it has ended, however that came."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def processes(count: int | None = None) -> Generator[Processes]:
    """Processes on this machine, as many as there are cores unless told. An error inside ends them at once."""
    pool = Processes(count or os.cpu_count() or 1)
    try:
        yield pool
    except BaseException:
        pool.stop()
        raise
    pool.shutdown()


@contextmanager
def dask(address: str, probe: Callable[[], T], judge: Callable[[Mapping[str, T]], None]) -> Generator[Executor]:
    """A Dask cluster. An error inside takes back what isn't begun.

    Args:
        address: Of the scheduler, such as `tcp://10.0.0.1:8786`; `local:N` starts N processes on this machine.
        probe: Called on every worker that is there at the start.
        judge: Given what they returned, by address; raises where they won't do.

    Raises:
        ArgumentError: The address makes no sense.
        RunError: The cluster can't be reached, or its workers can't do the work.
        MissingExtraError: Dask isn't installed.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise MissingExtraError(
            "a Dask cluster needs dask and distributed; install them with: pip install 'swim2real[cluster]'"
        ) from error
    local: Any = None
    if address.startswith("local:"):
        no_page: Any = None
        local = LocalCluster(
            n_workers=_count(address), threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=no_page
        )
    elif "://" not in address:
        raise ArgumentError(f"cluster is '{address}'; write tcp://HOST:PORT of a Dask scheduler, or local:N")
    try:
        client = _connected(Client, local or address, address)
        try:
            judge(_asked(client, probe))
            executor: Executor = client.get_executor(pure=False)
            try:
                yield executor
            except BaseException:
                executor.shutdown(wait=False)
                raise
        finally:
            client.close()
    finally:
        if local is not None:
            local.close()


def explained(error: BaseException) -> str:
    """Why work was lost, in a sentence."""
    if type(error).__name__ == "KilledWorker":
        return "its Dask worker died several times, perhaps for want of memory; run again to go on"
    if isinstance(error, CancelledError) or type(error).__name__ in ("FutureCancelledError", "CancelledError"):
        return "the cluster gave it up; run again to go on"
    return str(error) if isinstance(error, RunError) else f"unexpected {type(error).__name__}: {error}"


def _count(address: str) -> int:
    text = address.removeprefix("local:")
    if not text.isdecimal() or int(text) < 1:
        raise ArgumentError(f"cluster is '{address}'; write local:N with a whole number N from 1 on")
    return int(text)


def _connected(client: Any, to: Any, address: str) -> Any:
    try:
        return client(to, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RunError(f"no Dask scheduler answers at '{address}': {error}; check the address") from error


def _asked(client: Any, probe: Callable[[], T]) -> Mapping[str, T]:
    try:
        return client.run(probe)
    except Exception as error:  # Dask wraps what a worker raises or lacks in errors of many kinds
        raise RunError(
            f"the cluster's workers can't do the work ({type(error).__name__}: {error}); "
            f"install the same version of swim2real there"
        ) from error
