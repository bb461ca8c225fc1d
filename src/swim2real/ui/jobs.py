"""What takes long: one job at a time, in a thread that goes on when the page is closed, and that any page finds."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from swimbase.errors import ArgumentError, Swim2RealError

_MOST_BESTS = 400  # of a search's improvements, as the page draws them


class Job:
    """A piece of work and how far it is.

    Attributes:
        kind: Its name in the page's calls.
        title: What it does, for a person.
        state: What is known of it; keys are those of the page.
        stopping: Whether a person has asked it to end.
    """

    def __init__(self, kind: str, title: str) -> None:
        self.kind, self.title, self.stopping = kind, title, False
        self.state: dict[str, Any] = {}
        self._bests: list[tuple[int, float]] = []
        self._began = time.monotonic()
        self.done = threading.Event()

    def note(self, **known: Any) -> None:
        """Takes what is new; `best` [mm] after `done` evaluations joins the convergence."""
        if "best" in known:
            if len(self._bests) >= _MOST_BESTS:
                del self._bests[1::2]
            self._bests.append((known["done"], known["best"]))
        self.state = {**self.state, **known}

    def heed(self) -> None:
        """Ends the work here if a person has asked for it, as Ctrl-C does."""
        if self.stopping:
            raise KeyboardInterrupt

    def as_dict(self) -> dict[str, Any]:
        """The job as the page shows it."""
        return {
            "kind": self.kind, "title": self.title, "running": not self.done.is_set(), "stopping": self.stopping,
            "seconds": round(time.monotonic() - self._began), "bests": self._bests[:], **self.state,
        }  # fmt: skip


class Jobs:
    """The job that is under way, or the last one."""

    def __init__(self) -> None:
        self.last: Job | None = None
        self.number = 0
        self._lock = threading.Lock()

    def start(self, kind: str, title: str, work: Callable[[Job], str]) -> Job:
        """Starts a job.

        Args:
            kind: Its name in the page's calls.
            title: What it does.
            work: The work, which says at its end what came of it.

        Raises:
            ArgumentError: Another one is under way.
        """
        with self._lock:
            if self.last is not None and not self.last.done.is_set():
                raise ArgumentError(f"'{self.last.title}' is under way; one thing at a time: wait for it or stop it")
            job = self.last = Job(kind, title)
            self.number += 1

        def run() -> None:
            try:
                job.note(said=work(job))
            except KeyboardInterrupt:
                job.note(said="stopped; begun again it goes on with what is there")
            except (Swim2RealError, OSError) as error:
                job.note(fault=str(error))
            except Exception as error:
                job.note(fault=f"unexpected {type(error).__name__}: {error}; the command shows more with --debug")
            finally:
                job.note(seconds=job.as_dict()["seconds"])
                job.done.set()

        threading.Thread(target=run, name=kind, daemon=True).start()
        return job

    def stop(self) -> dict[str, Any]:
        """Asks the job to end."""
        if self.last is not None:
            self.last.stopping = True
        return self.as_dict()

    def as_dict(self) -> dict[str, Any]:
        """The last job and its number, by which a page knows a new one."""
        return {"number": self.number, **(self.last.as_dict() if self.last else {"running": False})}
