"""Progress of a comparison: a bar on a terminal, a line a run elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from swim2real.comparison import ComparisonProgress, JobReport


@contextmanager
def comparison_shown(quiet: bool) -> Generator[Callable[[ComparisonProgress], None]]:
    """Gives the callback that shows progress, on standard error."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    if quiet:
        yield lambda progress: None
        return
    if not console.is_terminal:

        def line(p: ComparisonProgress) -> None:
            if p.finished is not None:
                text = f"{_line(p, p.finished)}{_left(p)}"
                console.print(text, markup=False)

        yield line
        return
    columns = (TextColumn("evaluations"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("", total=None, text="")

        def update(p: ComparisonProgress) -> None:
            best = ", ".join(
                f"{method} {1e3 * loss:.1f}" for method, loss in sorted(p.best.items(), key=lambda b: b[1])
            )
            text = f"runs {p.jobs_done}/{p.jobs}{_left(p)}" + (f", best (mm): {best}" if best else "")
            bar.update(task, completed=p.evaluations, total=p.budget, text=text)
            if p.finished is not None and p.finished.state != "read":
                bar.console.print(_line(p, p.finished), markup=False)

        yield update


def _left(p: ComparisonProgress) -> str:
    return "" if p.seconds_left is None else f", {_clock(p.seconds_left)} left"


def _line(p: ComparisonProgress, job: JobReport) -> str:
    width = len(str(p.jobs))
    head = f"{p.jobs_done:{width}d}/{p.jobs} {job.key}: "
    if job.state in ("failed", "stopped"):
        return head + job.state
    best = "no swim" if job.best is None else f"best {1e3 * job.best:.1f} mm"
    return head + best + (", done before" if job.state == "read" else f", {job.seconds:.1f} s")


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
