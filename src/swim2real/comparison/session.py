"""The session of a comparison: one process that waits for the jobs, whoever does them, on whatever machine.

It is a file in the comparison's folder. A job that doesn't find it any more stops, so nothing works on for nobody after
Ctrl-C, or in a folder that another session has taken over.
"""

from __future__ import annotations

import logging
import socket
import time
import uuid
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from swim2real.calibration import versions
from swim2real.comparison.files import write_text
from swim2real.errors import RunError

SESSION, LOCK = ".session", ".lock"
_SEEN_AFTER = 10.0  # s that a network file system may take to show a new file
_log = logging.getLogger(__name__)


class Stopped(Exception):  # noqa: N818 - nothing went wrong
    """The session that asked for a job has ended."""


@contextmanager
def alone(root: Path) -> Generator[None]:
    """Keeps other comparisons out of the folder.

    Raises:
        RunError: Another process has it, or it can't be made.
    """
    lock = FileLock(root / LOCK, timeout=0)
    try:
        root.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise RunError(f"another process is working on comparison '{root}'; wait or use another folder") from None
    except OSError as error:
        raise RunError(f"can't write '{root}': {error.strerror or error}; choose another folder") from error
    try:
        yield
    finally:
        lock.release()


@contextmanager
def session(root: Path) -> Generator[str]:
    """Begins a session and gives its token."""
    token = uuid.uuid4().hex
    write_text(root / SESSION, token)
    try:
        yield token
    finally:
        (root / SESSION).unlink(missing_ok=True)


def check_session(root: Path, token: str, patience: float | None = None) -> None:
    """Whether the session goes on, and whether this machine sees its folder.

    Args:
        root: Folder of the comparison.
        token: Of the session.
        patience: Time to wait for the file [s]; by default as long as a network file system may hide it.

    Raises:
        Stopped: The session has ended, or another has begun.
        RunError: The folder isn't seen here.
    """
    path = root / SESSION
    until = time.monotonic() + (_SEEN_AFTER if patience is None else patience)
    while True:
        try:
            if path.read_text(encoding="utf-8") == token:
                return
        except OSError:
            pass
        if time.monotonic() >= until:
            break
        time.sleep(0.1)
    if root.is_dir():
        raise Stopped
    raise RunError(_unseen(socket.gethostname(), root))


@dataclass(frozen=True)
class Worker:
    """What a worker of a cluster says of itself.

    Attributes:
        host: Its machine.
        sees: Whether it sees the session.
        wrote: Name of the file that it wrote into the comparison's folder; None where it couldn't.
        versions: Of its libraries.
    """

    host: str
    sees: bool
    wrote: str | None
    versions: Mapping[str, str]


def probe(root: Path, token: str) -> Worker:
    """Looks around on a worker, and writes a file for `judge` to find."""
    sees, wrote = True, f".probe-{uuid.uuid4().hex}"
    try:
        check_session(root, token)
        (root / wrote).write_text(token, encoding="utf-8")
    except (Stopped, RunError):
        sees = False
    except OSError:
        wrote = None
    return Worker(socket.gethostname(), sees, wrote if sees else None, versions())


def judge(workers: Mapping[str, Worker], root: Path) -> None:
    """Whether a cluster's workers can do the work.

    Raises:
        RunError: One of them doesn't see the folder or can't write there, or has another swim2real.
    """
    here = versions()
    for worker in workers.values():
        if not worker.sees:
            raise RunError(_unseen(worker.host, root))
        if worker.wrote is None or not _appears(root / worker.wrote):
            raise RunError(f"worker {worker.host} can't write into '{root}' such that it is seen here; allow it there")
        if worker.versions.get("swim2real") != here["swim2real"]:
            raise RunError(
                f"worker {worker.host} has swim2real {worker.versions.get('swim2real')}, here it is "
                f"{here['swim2real']}; install the same version on every worker"
            )
        other = [f"{name} {worker.versions.get(name)}" for name in here if worker.versions.get(name) != here[name]]
        if other:
            _log.warning("worker %s has %s; last digits of results may differ", worker.host, ", ".join(other))


def _appears(path: Path) -> bool:
    until = time.monotonic() + _SEEN_AFTER
    while not path.is_file():
        if time.monotonic() >= until:
            return False
        time.sleep(0.1)
    path.unlink(missing_ok=True)
    return True


def _unseen(host: str, root: Path) -> str:
    return (
        f"worker {host} doesn't see comparison '{root}'; put it on a file system that all workers share, "
        f"at the same path"
    )
