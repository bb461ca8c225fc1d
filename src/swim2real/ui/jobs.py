"""What takes long: one job at a time, in a thread that goes on when the page is closed, and that any page finds."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from swimbase.errors import ArgumentError, Swim2RealError

_MOST_BESTS = 400  # of a search's improvements, as the page draws them


@dataclass
class JobNow:
    """A job as the page shows it.

    Attributes:
        kind: Its name in the page's calls.
        title: What it does, for a person.
        number: By which a page knows a new one.
        running: Whether it goes on.
        stopping: Whether a person has asked it to end.
        seconds: How long it has taken [s].
        done: Evaluations or frames that are done.
        total: Of so many, where that is known.
        bests: Improvements of a search: after how many evaluations, and the loss then [mm].
        values: The best values, or an advisor's proposal once it has ended.
        run: Name of the run that it makes.
        film: Path of the film that is tracked.
        places: Where the markers are in the newest frame, `packed` [px].
        warning: A sentence that a person should read meanwhile.
        said: What came of it.
        fault: Why nothing came of it.
    """

    kind: str = ""
    title: str = ""
    number: int = 0
    running: bool = False
    stopping: bool = False
    seconds: float = 0.0
    done: int = 0
    total: int | None = None
    bests: list[tuple[int, float]] = field(default_factory=list[tuple[int, float]])
    values: dict[str, float] | None = None
    run: str = ""
    film: str = ""
    places: str = ""
    warning: str = ""
    said: str = ""
    fault: str = ""


class Job:
    """A piece of work and how far it is.

    Attributes:
        now: What the page shows of it.
        done: Set at its end.
    """

    def __init__(self, now: JobNow) -> None:
        self.now, self.done = now, threading.Event()
        self._began, self._lock = time.monotonic(), threading.Lock()

    def note(self, **known: Any) -> None:
        """Takes what is new, by the names of `JobNow`."""
        with self._lock:  # the page's stop comes from another thread
            if self.now.running:
                self.now = replace(self.now, seconds=round(time.monotonic() - self._began), **known)

    def improved(self, best: float, values: Mapping[str, float]) -> None:
        """Takes the best values of a search and their loss [mm]."""
        kept = self.now.bests if len(self.now.bests) < _MOST_BESTS else self.now.bests[::2]
        self.note(bests=[*kept, (self.now.done, best)], values=dict(values))

    def heed(self) -> None:
        """Ends the work here if a person has asked for it, as Ctrl-C does."""
        if self.now.stopping:
            raise KeyboardInterrupt


class Jobs:
    """The job that is under way, or the last one."""

    def __init__(self) -> None:
        self.last: Job | None = None
        self._lock = threading.Lock()

    def start(self, kind: str, title: str, work: Callable[[Job], str], film: str = "") -> JobNow:
        """Starts a job.

        Args:
            kind: Its name in the page's calls.
            title: What it does.
            work: The work, which says at its end what came of it.
            film: Path of the film that it tracks.

        Raises:
            ArgumentError: Another one is under way.
        """
        with self._lock:
            if self.last is not None and self.last.now.running:
                raise ArgumentError(
                    f"'{self.last.now.title}' is under way; one thing at a time: wait for it or stop it"
                )
            job = self.last = Job(JobNow(kind, title, self.now().number + 1, running=True, film=film))

        def run() -> None:
            try:
                end = {"said": work(job)}
            except KeyboardInterrupt:
                end = {"said": "stopped; begun again it goes on with what is there"}
            except (Swim2RealError, OSError) as error:
                end = {"fault": str(error)}
            except Exception as error:
                end = {"fault": f"unexpected {type(error).__name__}: {error}; the command shows more with --debug"}
            job.note(running=False, **end)
            job.done.set()

        threading.Thread(target=run, name=kind, daemon=True).start()
        return self.now()

    def stop(self) -> JobNow:
        """Asks the job to end."""
        if self.last is not None:
            self.last.note(stopping=True)
        return self.now()

    def now(self) -> JobNow:
        """The last job."""
        if self.last is None:
            return JobNow()
        self.last.note()
        return self.last.now
