"""Progress of runs, comparisons, films and trainings on standard error: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from rich.progress import BarColumn, MofNCompleteColumn, Task, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.text import Text

from swim2real.cli.tables import progress_console
from swim2real.interruption import Interruption
from swimbase.errors import Swim2RealError
from swimbase.escaping import visible

if TYPE_CHECKING:
    from markertrack.following import FrameProgress
    from swim2real.advisor import AdvisorEvent
    from swim2real.calibration import Progress
    from swim2real.comparison import ComparisonProgress, JobReport
    from swim2real.pipeline import TrackedVideo
    from swim2real.rl.training import TrainingProgress

_BAR = 16  # characters of the bar of a run, whose line has 80 at most
_RUN_LINES = 5.0  # s between plain lines of a run
_FILM_LINES = 5.0  # s between plain lines of a video
_TRAINING_LINES = 10.0  # s between plain lines of a training


class _Words(TextColumn):
    """A column of a bar whose text is only text, as on a `PlainConsole`."""

    def render(self, task: Task) -> Text:
        return Text(visible(self.text_format.format(task=task)), style=self.style, justify=self.justify)


@dataclass(frozen=True)
class RunCallbacks:
    """Callbacks of a run's progress.

    Attributes:
        progress: After every evaluation.
        advisor: As a VLM is asked and answers.
    """

    progress: Callable[[Progress], None]
    advisor: Callable[[AdvisorEvent], None]


@contextmanager
def run_shown(budget: int | None, quiet: bool) -> Generator[RunCallbacks]:
    """Gives the callbacks that show the progress of a run. Warnings are shown even when quiet.

    Ctrl-C ends the run between two evaluations, when all is on the disk; a second Ctrl-C ends it at once. While a VLM
    or a person is waited for, so does the first one.
    """
    with _run_lines(budget, quiet) as show, Interruption() as interruption:

        def progress(state: Progress) -> None:
            show.progress(state)
            interruption.check()

        def advisor(event: AdvisorEvent) -> None:
            interruption.impatient = False
            show.advisor(event)
            interruption.check()
            interruption.impatient = event.kind in ("asks", "waits")

        yield RunCallbacks(progress, advisor)


@contextmanager
def _run_lines(budget: int | None, quiet: bool) -> Generator[RunCallbacks]:
    console = progress_console()
    if quiet or not console.is_terminal:

        def print_event(event: AdvisorEvent) -> None:
            if event.kind != "received" and (event.kind == "warning" or not quiet):
                console.print(_event_line(event))

        printed = -math.inf

        def print_line(p: Progress) -> None:
            nonlocal printed
            now, last = time.monotonic(), p.budget is not None and p.done >= p.budget
            if not quiet and (p.done == 1 or last or now - printed > _RUN_LINES):
                printed = now
                console.print(_run_line(p))

        yield RunCallbacks(print_line, print_event)
        return
    columns = (BarColumn(_BAR), MofNCompleteColumn(), _Words("{task.fields[text]}"))
    with Bar(*columns, console=console) as bar:
        task = bar.add_task("", total=budget, text="first evaluation")

        def update(p: Progress) -> None:
            total = None if p.budget is None else max(p.budget, p.done)
            bar.update(task, completed=p.done, total=total, text=_state(p))

        def update_event(event: AdvisorEvent) -> None:
            if event.kind == "asks":
                bar.update(task, text=f"round {event.round}: {event.text}{_spent(event)}")
            elif event.kind != "received":
                bar.console.print(_event_line(event))

        yield RunCallbacks(update, update_event)


def _run_line(p: Progress) -> str:
    return f"{p.done:4d}{f'/{p.budget}' if p.budget else ''}  {_state(p)}"


def _state(p: Progress) -> str:
    """State of a search in a few words: the error of the best, how many starts agree, the time left."""
    from swim2real.optimizers.enough import agreeing

    parts = ["diverged so far" if p.error is None else f"best {1e3 * p.error:.1f} mm"]
    if p.replayed:
        parts.append("read from the record")
    elif len(p.ends) > 1:
        parts.append(f"{agreeing(p.ends)} of {len(p.ends)} starts agree")
    elif "round" in p.note:
        parts.append(f"round {p.note['round']}")
    if p.seconds_left is not None and not p.replayed:
        parts.append(f"{_clock(p.seconds_left)} left" if p.budget else f"at most {_clock(p.seconds_left)} left")
    return ", ".join(parts)


def _event_line(event: AdvisorEvent) -> str:
    return f"     round {event.round}: {event.kind}: {event.text}{_spent(event)}"


def _spent(event: AdvisorEvent) -> str:
    """Tokens, time and cost of the calls so far."""
    totals = event.totals
    if not totals.calls:
        return ""
    tokens = f", {(totals.input_tokens + totals.output_tokens) / 1e3:.1f}k tokens" if totals.input_tokens else ""
    cost = f", {totals.cost:.3f} USD" if totals.cost is not None else ""
    return f"  (so far {totals.calls} calls{tokens}{cost})"


@contextmanager
def comparison_shown(quiet: bool) -> Generator[Callable[[ComparisonProgress], None]]:
    """Gives the callback that shows the progress of a comparison."""
    console = progress_console()
    if quiet:
        yield lambda progress: None
        return
    if not console.is_terminal:

        def line(p: ComparisonProgress) -> None:
            if p.due is not None:
                console.print(_announced(p))
            if p.finished is not None:
                console.print(f"{_job_line(p, p.finished)}{_left(p)}")

        yield line
        return
    columns = (_Words("evaluations"), BarColumn(), MofNCompleteColumn(), _Words("{task.fields[text]}"))
    with Bar(*columns, console=console) as bar:
        task = bar.add_task("", total=None, text="")

        def update(p: ComparisonProgress) -> None:
            if p.due is not None:
                bar.console.print(_announced(p))
            ranking = sorted(p.best.items(), key=lambda best: best[1])
            best = ", ".join(f"{method} {1e3 * loss:.1f}" for method, loss in ranking)
            text = f"runs {p.jobs_done}/{p.jobs}{_left(p)}" + (f", best (mm): {best}" if best else "")
            bar.update(task, completed=p.evaluations, total=p.budget, text=text)
            if p.finished is not None and p.finished.state != "read":
                bar.console.print(_job_line(p, p.finished))

        yield update


def _announced(p: ComparisonProgress) -> str:
    of_all = "" if p.due == p.jobs else f" of {p.jobs}"
    about = "" if p.seconds_left is None else f"; by one evaluation about {max(p.seconds_left / 60, 0.1):.1f} min"
    return f"{p.due}{of_all} runs, {p.budget - p.evaluations} evaluations{about}"


def _left(p: ComparisonProgress) -> str:
    return "" if p.seconds_left is None else f", {_clock(p.seconds_left)} left"


def _job_line(p: ComparisonProgress, job: JobReport) -> str:
    width = len(str(p.jobs))
    head = f"{p.jobs_done:{width}d}/{p.jobs} {job.key}: "
    if job.state in ("failed", "stopped"):
        return head + job.state
    best = "no swim" if job.best is None else f"best {1e3 * job.best:.1f} mm"
    return head + best + (", done before" if job.state == "read" else f", {job.seconds:.1f} s")


def loading(text: str, quiet: bool) -> AbstractContextManager[object]:
    """Shows on a terminal what is waited for before there is progress; it is gone afterwards."""
    console = progress_console()
    return console.status(visible(text)) if console.is_terminal and not quiet else nullcontext()


FilmCallbacks: TypeAlias = (
    "tuple[Callable[[FrameProgress], None], Callable[[str, TrackedVideo | Swim2RealError], None]]"
)


@contextmanager
def films_shown(quiet: bool) -> Generator[FilmCallbacks]:
    """Gives the callbacks that show the progress of tracking: after some frames, and after a video."""
    console = progress_console()
    if quiet:
        yield (lambda progress: None), (lambda name, result: None)
        return
    if not console.is_terminal:
        printed: dict[str, float] = {}

        def line(p: FrameProgress) -> None:
            if p.note:
                console.print(f"{p.name}: {p.note}")
            if time.monotonic() - printed.get(p.name, 0.0) > _FILM_LINES:
                printed[p.name] = time.monotonic()
                text = f"{p.name}: frame {p.done} of {p.total or '?'}, {p.lost} markers lost"
                console.print(text)

        yield line, lambda name, result: console.print(f"{name}: {_film_outcome(result)}")
        return
    columns = (_Words("{task.description}"), BarColumn(), _Words("{task.fields[text]}"), TimeRemainingColumn())
    with Bar(*columns, console=console) as bar:
        tasks: dict[str, TaskID] = {}

        def update(p: FrameProgress) -> None:
            if p.name not in tasks:
                tasks[p.name] = bar.add_task(p.name, total=p.total, text="")
            if p.note:
                bar.console.print(f"{p.name}: {p.note}")
            bar.update(tasks[p.name], completed=p.done, text=f"{p.lost} lost" if p.lost else "")

        def done(name: str, result: TrackedVideo | Swim2RealError) -> None:
            bar.console.print(f"{name}: {_film_outcome(result)}")
            if name in tasks:
                bar.remove_task(tasks.pop(name))

        yield update, done


def _film_outcome(result: TrackedVideo | Swim2RealError) -> str:
    if isinstance(result, Swim2RealError):
        return "failed"
    if result.done_before:
        return "done before"
    return f"{result.report.frames} frames in {result.report.seconds:.1f} s"


@contextmanager
def training_shown(total: int, quiet: bool) -> Generator[Callable[[TrainingProgress], None]]:
    """Gives the callback that shows the progress of a training.

    Args:
        total: Environment steps.
        quiet: Show nothing.
    """
    console = progress_console()
    if quiet:
        yield lambda progress: None
    elif not console.is_terminal:
        printed = -math.inf

        def plain(p: TrainingProgress) -> None:
            nonlocal printed
            if p.evaluation or p.step >= p.total or time.monotonic() - printed > _TRAINING_LINES:
                printed = time.monotonic()
                console.print(training_line(p))

        yield plain
    else:
        with Bar(_Words("training"), BarColumn(), _Words("{task.fields[text]}"), console=console) as bar:
            task = bar.add_task("", total=total, text="first steps")

            def update(p: TrainingProgress) -> None:
                bar.update(task, completed=p.step, total=p.total, text=training_line(p))
                if p.evaluation:
                    bar.console.print(training_line(p))

            yield update


def training_line(p: TrainingProgress) -> str:
    """Progress of a training, in one line."""
    parts = [f"{p.step:>9,}/{p.total:,}", f"{p.rate:.0f} steps/s"]
    if p.episode_return is not None and p.distance is not None and p.success is not None:
        parts.append(f"return {p.episode_return:.1f}")
        parts.append(f"distance {p.distance:.3f} m")
        if p.stage is not None:
            parts.append(f"stage {p.stage}, success {100 * p.success:.0f} %")
    parts.append(f"learning {100 * p.learner_share:.0f} %")
    if p.evaluation:
        text = f"evaluated: return {p.evaluation['episode_return']:.1f}, distance {p.evaluation['distance']:.3f} m"
        parts.append(text + (f", success {100 * p.evaluation['success']:.0f} %" if p.stage is not None else ""))
    return ", ".join([*parts, f"{_clock(p.seconds_left)} left"])


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
