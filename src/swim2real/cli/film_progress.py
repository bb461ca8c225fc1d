"""Progress and outcome of tracking: a bar a video on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from swim2real.cli import tables
from swim2real.errors import Swim2RealError
from swim2real.pipeline import Filmed, FrameProgress

_LINE_EVERY = 5.0  # s between plain lines of a video


@contextmanager
def films_shown(
    quiet: bool,
) -> Generator[tuple[Callable[[FrameProgress], None], Callable[[str, Filmed | Swim2RealError], None]]]:
    """Callbacks that show progress on standard error."""
    console = Console(stderr=True, highlight=False)
    if quiet:
        yield (lambda progress: None), (lambda name, result: None)
        return
    if not console.is_terminal:
        told: dict[str, float] = {}

        def line(p: FrameProgress) -> None:
            if time.monotonic() - told.get(p.name, 0.0) > _LINE_EVERY:
                told[p.name] = time.monotonic()
                text = f"{p.name}: frame {p.done} of {p.total or '?'}, {p.lost} markers lost"
                console.print(text, soft_wrap=True, markup=False)

        yield line, lambda name, result: console.print(f"{name}: {_outcome(result)}", soft_wrap=True, markup=False)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        tasks: dict[str, TaskID] = {}

        def update(p: FrameProgress) -> None:
            if p.name not in tasks:
                tasks[p.name] = bar.add_task(p.name, total=p.total, text="")
            bar.update(tasks[p.name], completed=p.done, text=f"{p.lost} lost" if p.lost else "")

        def done(name: str, result: Filmed | Swim2RealError) -> None:
            bar.console.print(f"{name}: {_outcome(result)}", soft_wrap=True, markup=False)
            if name in tasks:
                bar.remove_task(tasks.pop(name))

        yield update, done


def _outcome(result: Filmed | Swim2RealError) -> str:
    if isinstance(result, Swim2RealError):
        return "failed"
    if result.again:
        return "done before"
    return f"{result.report['frames']} frames in {result.report['seconds']:.1f} s"


def print_films(done: Sequence[Filmed], marker_names: Sequence[str]) -> None:
    """Prints what was found in videos."""
    rows = [
        (
            one.name, str(one.report["frames"]), f"{1e3 * one.report['meters_per_pixel']:.4f}",
            *("–" if share == 0 else f"{100 * share:.1f}" for share in one.report["lost_share"]),
            "yes" if one.report["usable"] else "no",
        )
        for one in done
    ]  # fmt: skip
    tables.table(
        "Frames for which each marker is lost [%]",
        ("trial", "frames", "mm/px", *marker_names, "usable as it is"), rows,
    )  # fmt: skip
    findings = [(one.name, line) for one in done for line in one.report["findings"]]
    if findings:
        tables.table("What to know", ("trial", "finding"), findings)
