"""Progress of a calibration: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from swim2real.calibration import Progress


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


@contextmanager
def shown(budget: int, quiet: bool) -> Generator[Callable[[Progress], None]]:
    """Gives the callback that shows progress, on standard error."""
    console = Console(stderr=True, highlight=False)
    if quiet:
        yield lambda progress: None
        return
    if not console.is_terminal:
        yield lambda p: console.print(_line(p), soft_wrap=True)
        return
    columns = (TextColumn("calibrating"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Bar(*columns, console=console) as bar:
        task = bar.add_task("", total=budget, text="first evaluation")

        def update(p: Progress) -> None:
            text = f"best {1e3 * p.best:.1f} mm, {_clock(p.seconds_left)} left"
            bar.update(task, completed=p.done, total=max(p.budget, p.done), text=text)
            if p.improved and not p.replayed:
                bar.console.print(_line(p))

        yield update


@contextmanager
def interruptible(on_progress: Callable[[Progress], None]) -> Generator[Callable[[Progress], None]]:
    """Lets Ctrl-C end a run between two evaluations, when all is on the disk; a second Ctrl-C ends it at once.

    An interrupt in the middle of a call of the engine would come out as some error of its bindings.
    """
    if threading.current_thread() is not threading.main_thread():
        yield on_progress
        return
    asked = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    def update(progress: Progress) -> None:
        on_progress(progress)
        if asked:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, note)
    try:
        yield update
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
