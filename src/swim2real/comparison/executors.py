"""A Dask cluster as a `concurrent.futures.Executor`."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from typing import Any, TypeVar

from swim2real.errors import ArgumentError, MissingExtraError, RunError, Swim2RealError

T = TypeVar("T")

_CONNECT = 15  # s


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
    return str(error) if isinstance(error, Swim2RealError) else f"unexpected {type(error).__name__}: {error}"


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
