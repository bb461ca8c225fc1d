"""Progress of a calibration: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from swim2real.advisor import AdvisorEvent
from swim2real.calibration import Progress


@dataclass(frozen=True)
class Watch:
    """What is called as a run goes on.

    Attributes:
        progress: After every evaluation.
        advisor: As a VLM is asked and answers.
    """

    progress: Callable[[Progress], None]
    advisor: Callable[[AdvisorEvent], None]


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


@contextmanager
def shown(budget: int, quiet: bool) -> Generator[Watch]:
    """Gives the callbacks that show progress, on standard error. Warnings are shown even when quiet."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    if quiet or not console.is_terminal:

        def tell(event: AdvisorEvent) -> None:
            if event.kind != "received" and (event.kind == "warning" or not quiet):
                console.print(_told(event))

        yield Watch(lambda p: None if quiet else console.print(_line(p)), tell)
        return
    columns = (TextColumn("calibrating"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Bar(*columns, console=console) as bar:
        task = bar.add_task("", total=budget, text="first evaluation")

        def update(p: Progress) -> None:
            text = f"best {1e3 * p.best:.1f} mm, {_clock(p.seconds_left)} left"
            bar.update(task, completed=p.done, total=max(p.budget, p.done), text=text)
            if p.improved and not p.replayed:
                bar.console.print(_line(p))

        def asked(event: AdvisorEvent) -> None:
            if event.kind == "asks":
                bar.update(task, text=f"round {event.round}: {event.text}{_spent(event)}")
            elif event.kind != "received":
                bar.console.print(_told(event))

        yield Watch(update, asked)


@contextmanager
def interruptible(watch: Watch) -> Generator[Watch]:
    """Lets Ctrl-C end a run between two evaluations, when all is on the disk; a second Ctrl-C ends it at once.

    An interrupt in the middle of a call of the engine would come out as some error of its bindings. While a VLM or a
    person is waited for, the first Ctrl-C ends the run at once.
    """
    if threading.current_thread() is not threading.main_thread():
        yield watch
        return
    asked = waiting = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked or waiting:
            raise KeyboardInterrupt
        asked = True

    def update(progress: Progress) -> None:
        watch.progress(progress)
        if asked:
            raise KeyboardInterrupt

    def advisor(event: AdvisorEvent) -> None:
        nonlocal waiting
        waiting = False
        watch.advisor(event)
        if asked:
            raise KeyboardInterrupt
        waiting = event.kind in ("asks", "waits")

    before = signal.signal(signal.SIGINT, note)
    try:
        yield Watch(update, advisor)
    finally:
        signal.signal(signal.SIGINT, before)


def _line(p: Progress) -> str:
    how = str(p.note.get("source", ""))
    if "round" in p.note:
        how = f"round {p.note['round']}, step {p.note['step_size']:g}"
    kind = "read" if p.replayed else "best" if p.improved else "    "
    loss = f"{'>' * p.lower_bound}{1e3 * p.loss:.1f}"
    return (
        f"{p.done:4d}/{p.budget} {kind} {loss:>7} mm  (best {1e3 * p.best:.1f} mm, {how}, "
        f"{_clock(p.seconds_left)} left)"
    )


def _told(event: AdvisorEvent) -> str:
    return f"     round {event.round}: {event.kind}: {event.text}{_spent(event)}"


def _spent(event: AdvisorEvent) -> str:
    """What the calls took so far."""
    all_ = event.totals
    if not all_.calls:
        return ""
    tokens = f", {(all_.input_tokens + all_.output_tokens) / 1e3:.1f}k tokens" if all_.input_tokens else ""
    cost = f", {all_.cost:.3f} USD" if all_.cost is not None else ""
    return f"  (so far {all_.calls} calls{tokens}{cost})"
