"""A Dask cluster that does the runs of a comparison, and the session that ends them.

The processes of a cluster live on when whoever waits for them has gone. So a comparison in progress has a file in its
folder, its session, and a run stops as soon as that is gone, or another session's: nothing works on for nobody after
Ctrl-C, or in a folder that another session has taken over.
"""

from __future__ import annotations

import logging
import socket
import time
import uuid
from collections.abc import Generator, Mapping
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swim2real.calibration import versions
from swim2real.comparison.plan import KEPT
from swimbase.errors import ArgumentError, MissingExtraError, RunError, Swim2RealError
from swimbase.store import write_text, writing

SESSION = ".session"
_HIDDEN_TIME = 10.0  # s that a network file system may take to show a new file
_CONNECTION_TIME = 15  # s that a scheduler may take to answer
_log = logging.getLogger(__name__)


class SessionEnded(Exception):  # noqa: N818 - nothing went wrong
    """The session that a run belongs to has ended."""


@contextmanager
def session(root: Path) -> Generator[str]:
    """Begins a session in the folder of a comparison and gives its token; the session ends with the block.

    Raises:
        RunError: The disk failed.
    """
    token = uuid.uuid4().hex
    with writing(root, RunError, KEPT):
        write_text(root / SESSION, token)
    try:
        yield token
    finally:
        (root / SESSION).unlink(missing_ok=True)


def check_session(root: Path, token: str, timeout: float | None = None) -> None:
    """Checks that the session goes on, and that this machine sees its folder.

    Args:
        root: Folder of the comparison.
        token: Token of the session.
        timeout: Time to wait for the file [s]; by default as long as a network file system may hide it.

    Raises:
        SessionEnded: The session has ended, or another has begun.
        RunError: The folder isn't seen here.
    """
    deadline = time.monotonic() + (_HIDDEN_TIME if timeout is None else timeout)
    while True:
        try:
            if (root / SESSION).read_text(encoding="utf-8") == token:
                return
        except OSError:
            pass
        if time.monotonic() >= deadline:
            break
        time.sleep(0.1)
    if root.is_dir():
        raise SessionEnded
    raise RunError(
        f"worker {socket.gethostname()} doesn't see comparison '{root}'; put it on a file system that all workers "
        f"share, at the same path"
    )


@contextmanager
def dask_cluster(address: str, root: Path, token: str) -> Generator[Executor]:
    """A Dask cluster whose workers see the session. An error inside takes back what isn't begun.

    Args:
        address: Address of the scheduler, such as `tcp://10.0.0.1:8786`; `local:N` starts N processes on this machine.
        root: Folder of the comparison.
        token: Token of the session.

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
        options: dict[str, Any] = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
        local = LocalCluster(n_workers=_worker_count(address), **options)
    elif "://" not in address:
        raise ArgumentError(f"cluster is '{address}'; write tcp://HOST:PORT of a Dask scheduler, or local:N")
    try:
        try:
            client: Any = Client(local or address, timeout=_CONNECTION_TIME, set_as_default=False)
        except (OSError, ValueError) as error:
            raise RunError(f"no Dask scheduler answers at '{address}': {error}; check the address") from error
        try:
            check_versions(_worker_versions(client, root, token))
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


def _versions_seen(root: Path, token: str) -> dict[str, str]:
    """The versions of a worker's libraries; run there.

    Raises:
        RunError: The worker doesn't see the session.
    """
    check_session(root, token)
    return versions()


def check_versions(workers: Mapping[str, Mapping[str, str]]) -> None:
    """Checks the versions of each worker's libraries, and logs those that differ from the ones here.

    Raises:
        RunError: One has another swim2real.
    """
    here = versions()
    for name, there in workers.items():
        if there.get("swim2real") != here["swim2real"]:
            raise RunError(
                f"worker {name} has swim2real {there.get('swim2real')}, here it is {here['swim2real']}; "
                f"install the same version on every worker"
            )
        differing = [f"{library} {there.get(library)}" for library in here if there.get(library) != here[library]]
        if differing:
            _log.warning("worker %s has %s; last digits of results may differ", name, ", ".join(differing))


def explain_failure(error: BaseException) -> str:
    """Why a run was lost, in a sentence: errors of its process, of the pool and of Dask."""
    if type(error).__name__ == "KilledWorker":
        return "its Dask worker died several times, perhaps for want of memory; run again to go on"
    if isinstance(error, CancelledError) or type(error).__name__ in ("FutureCancelledError", "CancelledError"):
        return "the cluster gave it up; run again to go on"
    return str(error) if isinstance(error, Swim2RealError) else f"unexpected {type(error).__name__}: {error}"


def _worker_count(address: str) -> int:
    text = address.removeprefix("local:")
    if not text.isdecimal() or int(text) < 1:
        raise ArgumentError(f"cluster is '{address}'; write local:N with a whole number N from 1 on")
    return int(text)


def _worker_versions(client: Any, root: Path, token: str) -> Mapping[str, Mapping[str, str]]:
    try:
        return client.run(_versions_seen, root, token)
    except Swim2RealError:
        raise
    except Exception as error:  # Dask wraps what a worker raises or lacks in errors of many kinds
        raise RunError(
            f"the cluster's workers can't do the work ({type(error).__name__}: {error}); "
            f"install the same version of swim2real there"
        ) from error
