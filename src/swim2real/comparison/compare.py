"""Runs a comparison: hands its jobs to processes or a cluster, follows them, and reads their results.

A job reads what is finished and goes on with what isn't, wherever it is done.
"""

from __future__ import annotations

import socket
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from os import cpu_count
from pathlib import Path
from typing import Literal

from filelock import FileLock, Timeout

from swim2real.calibration import Problem, Progress, RunFolder
from swim2real.calibration.run_folder import RECORD, SETTINGS
from swim2real.comparison.cluster import SESSION, SessionEnded, check_session, dask_cluster, explain_failure, session
from swim2real.comparison.plan import PROBLEM, RUNS, Job, Plan, read_plan
from swim2real.comparison.results import ComparisonResults, read_results, write_results
from swim2real.methods import METHODS
from swim2real.pipeline import calibrate
from swim2real.processes import ProcessPool
from swim2real.robots.read_back import check_targets
from swim2real.robots.robot import Robot
from swim2real.settings import VlmAccess, asks_a_vlm
from swim2real.simulation import Engine
from swim2real.trials import TrialSet
from swimbase.errors import RunError, Swim2RealError
from swimbase.store import LOCK, MOST_RECORD, locked, remove_leftovers, source_from, write_text, writing

_PROGRESS_INTERVAL = 1.0  # s
_LOCK_TIMEOUT = 60.0  # s that a run folder is waited for, which a worker taken for lost may still hold
# only by the process that has the comparison
_WRITTEN = (
    "plan.json", "results.json", "results.csv", SESSION, f"{RUNS}/*/*/*/{PROBLEM}", f"{RUNS}/*/*/*/*/{PROBLEM}",
)  # fmt: skip


@dataclass(frozen=True)
class Work:
    """Data that all jobs of a session share.

    Attributes:
        root: Folder of the comparison.
        token: Token of the session; jobs stop when it has ended.
        plan: Plan of the comparison.
        reference: The real trials.
        robot: The robot that is calibrated.
        source: Where the reference came from.
        access: How VLMs are reached.
    """

    root: Path
    token: str
    plan: Plan
    reference: TrialSet
    robot: Robot
    source: str = ""
    access: VlmAccess = field(default_factory=VlmAccess)


@dataclass(frozen=True)
class JobReport:
    """End of a job.

    Attributes:
        key: Key of the job.
        method: Label of its method.
        state: `read` if it was finished before, `stopped` if its session has ended.
        problem: Why it failed, in a sentence; None where it didn't.
        best: Lowest loss [m]; None without one.
        evaluations: Evaluations on record.
        seconds: Time that it took here [s].
    """

    key: str
    method: str
    state: Literal["read", "done", "stopped", "failed"]
    problem: str | None = None
    best: float | None = None
    evaluations: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class ComparisonProgress:
    """Progress of a comparison.

    Attributes:
        jobs_done: Number of jobs that have ended, with those that were finished before.
        jobs: Number of all jobs.
        evaluations: Number of evaluations on record.
        budget: Number of evaluations of all jobs.
        best: Lowest loss of each method's finished runs [m].
        seconds_left: Estimated time that is left [s], None while there is nothing to estimate from.
        finished: Report of the job that has just ended; None between two.
        due: Number of jobs that are to be done, said before the first of them begins; None afterwards.
    """

    jobs_done: int
    jobs: int
    evaluations: int
    budget: int
    best: Mapping[str, float]
    seconds_left: float | None
    finished: JobReport | None = None
    due: int | None = None


def compare(
    plan: Plan, reference: TrialSet, robot: Robot, out: str | Path, *, workers: int | None = None,
    cluster: str | None = None, access: VlmAccess | None = None,
    on_progress: Callable[[ComparisonProgress], None] = lambda progress: None,
) -> ComparisonResults:  # fmt: skip
    """Runs what isn't finished of a comparison. Called again, it goes on; with a larger plan, it adds to what is there.

    Args:
        plan: The runs.
        reference: The real trials.
        robot: The robot that is calibrated.
        out: Folder of the comparison.
        workers: Processes on this machine; None for as many as there are cores.
        cluster: Dask scheduler that is used instead: its address, or `local:N`.
        access: How VLMs are reached.
        on_progress: Called before the first job begins, when a job ends, and about once a second.

    Returns:
        All finished runs, with those of earlier calls; `missing` says which jobs failed. They are written to
        results.json and results.csv as well, on KeyboardInterrupt too, which leaves every run such that it goes on.

    Raises:
        Swim2RealError: The folder holds another comparison, or the work can't be begun.
    """
    robot.check_trials(reference)
    check_targets(robot)
    root = Path(out).resolve()
    with _exclusive(root):
        before = read_plan(root) if (root / RUNS).is_dir() else None  # a plan without a run binds nobody
        plan = plan if before is None else plan.extending(before)
        source = plan.source and (str(Path(plan.source).resolve()) if Path(plan.source).exists() else plan.source)
        plan = replace(plan, source=source_from(root, plan.source))
        plan.write(root)
        with session(root) as token:

            def begin() -> AbstractContextManager[Executor]:
                return ProcessPool(workers) if cluster is None else dask_cluster(cluster, root, token)

            work = Work(root, token, plan, reference, robot, source, access or VlmAccess())
            try:
                _run(work, begin, on_progress, (workers or cpu_count() or 1) if cluster is None else None)
            except KeyboardInterrupt:
                write_results(read_results(root, plan), root)
                raise
        results = read_results(root, plan)
        write_results(results, root)
        return results


@contextmanager
def _exclusive(root: Path) -> Generator[None]:
    """Makes the folder of a comparison where there is none and keeps other comparisons out of it."""
    with ExitStack() as stack:
        busy = f"another process is working on comparison '{root}'; wait or use another folder"
        with writing(root, RunError, "choose another folder", busy=busy):
            stack.enter_context(locked(root))
            remove_leftovers(root, _WRITTEN)
        yield


def _run(
    work: Work, begin: Callable[[], AbstractContextManager[Executor]],
    on_progress: Callable[[ComparisonProgress], None], workers: int | None,
) -> None:  # fmt: skip
    """Does the jobs that aren't finished, that many at a time; None for as many as a cluster has."""
    jobs = work.plan.jobs(work.root)
    follower = _Follower(jobs, on_progress)
    due: list[Job] = []
    for job in jobs:
        finished = False
        with suppress(Swim2RealError):  # which is said when the job is done
            finished = job.is_finished(work.plan)
        if finished:
            follower.report(_ended(job, "read"))
        else:
            due.append(job)
    if not due:
        return
    with begin() as executor:
        follower.announce(len(due), None if workers is None else _expected(work, due, min(workers, len(due))))
        futures = {executor.submit(run_job, job, work): job for job in sorted(due, key=_cost, reverse=True)}
        left = set(futures)
        while left:
            done, left = wait(left, timeout=_PROGRESS_INTERVAL, return_when=FIRST_COMPLETED)
            follower.count(futures[future] for future in left | done)
            for future in done:
                follower.report(_report_of(future, futures[future]))
            if not done:
                follower.report()


def _report_of(future: Future[JobReport], job: Job) -> JobReport:
    error = CancelledError() if future.cancelled() else future.exception()
    return future.result() if error is None else _failed(job, explain_failure(error))


def _cost(job: Job) -> float:
    """Roughly how long a job takes: the longest are begun first, so that no worker is left with one at the end."""
    settings = job.settings
    method = 4.0 if asks_a_vlm(settings.advisor) else METHODS[settings.chosen_method].cost
    return method * (0.8 if settings.hold_out else 1.0)


def _expected(work: Work, due: Sequence[Job], workers: int) -> float | None:
    """About how long jobs take [s], by one evaluation; None where that fails, which the jobs report."""
    try:
        problem = Problem.with_settings(work.robot, work.reference, replace(due[0].settings, threads=1))
    except Swim2RealError:
        return None
    began = time.monotonic()
    problem.evaluate(work.robot.space.published)
    each = time.monotonic() - began
    return each * sum(_cost(job) * (job.settings.budget or 0) for job in due) / workers


class _Follower:
    """Reports how far the jobs are, by the lines of their records, which grow on whatever machine."""

    def __init__(self, jobs: Sequence[Job], on_progress: Callable[[ComparisonProgress], None]) -> None:
        self._on_progress = on_progress
        self._ended, self._jobs, self._budget = 0, len(jobs), sum(job.settings.budget or 0 for job in jobs)
        self._best: dict[str, float] = {}
        self._read = {job.key: 0 for job in jobs}  # bytes
        self._lines = 0
        self.count(jobs)
        self._before, self._began = self._lines, time.monotonic()

    def announce(self, due: int, seconds: float | None) -> None:
        """Reports how much there is to do, and about how long it takes [s]."""
        self._on_progress(
            ComparisonProgress(self._ended, self._jobs, self._lines, self._budget, dict(self._best), seconds, due=due)
        )
        self._began = time.monotonic()

    def count(self, jobs: Iterable[Job]) -> None:
        """Counts the lines that some records have more."""
        for job in jobs:
            with suppress(OSError), (job.folder / RECORD).open("rb") as file:
                file.seek(self._read[job.key])
                more = file.read(MOST_RECORD)
                self._read[job.key] += len(more)
                self._lines += more.count(b"\n")

    def report(self, finished: JobReport | None = None) -> None:
        """Reports progress, and a job that has ended."""
        if finished is not None:
            self._ended += 1
            if finished.best is not None:
                self._best[finished.method] = min(self._best.get(finished.method, finished.best), finished.best)
        new, seconds = self._lines - self._before, time.monotonic() - self._began
        left = seconds / new * (self._budget - self._lines) if new > 0 else None
        self._on_progress(
            ComparisonProgress(self._ended, self._jobs, self._lines, self._budget, dict(self._best), left, finished)
        )


def run_job(job: Job, work: Work) -> JobReport:
    """Does a job in this process. Nothing that goes wrong in it is raised; the report says it."""
    began = time.monotonic()
    try:
        check_session(work.root, work.token)
        finished = job.is_finished(work.plan)
        if not finished:
            _continue(job, work)
        (job.folder / PROBLEM).unlink(missing_ok=True)
        report = _ended(job, "read" if finished else "done")
    except SessionEnded:
        report = JobReport(job.key, job.method, "stopped")
    except Swim2RealError as error:
        report = _failed(job, str(error))
    except Exception as error:  # a fault of ours ends one job, not the comparison
        report = _failed(job, f"unexpected {type(error).__name__}: {error}", traceback.format_exc())
    return replace(report, seconds=round(time.monotonic() - began, 3))


def _ended(job: Job, state: Literal["read", "done"]) -> JobReport:
    """The report of a job whose run is finished."""
    record = RunFolder(job.folder).record()
    losses = [entry.loss for entry in record if not entry.failed]
    return JobReport(job.key, job.method, state, None, min(losses, default=None), len(record))


def _failed(job: Job, problem: str, trace: str = "") -> JobReport:
    """The report of a job that failed; the problem is left in its run folder, too, as far as the disk allows."""
    with suppress(OSError):
        job.folder.mkdir(parents=True, exist_ok=True)
        write_text(job.folder / PROBLEM, f"{problem}\n{trace}")
    return JobReport(job.key, job.method, "failed", problem)


def _continue(job: Job, work: Work) -> None:
    """Runs a job from where its record ends."""
    engine, wanted = Engine.of(work.robot), work.plan.engine
    if engine != wanted:
        raise RunError(
            f"worker {socket.gethostname()} simulates with {engine.name}, whose physics differs from that of "
            f"{wanted.name}, which the comparison was begun with; install the same on every worker"
        )
    with suppress(Timeout, OSError):  # a worker that was taken for lost may still hold it; the run says it in its words
        _set_aside(job)

    def check(progress: Progress) -> None:
        if not progress.replayed:
            check_session(work.root, work.token, timeout=1.0)

    calibrate(
        work.reference, work.robot, job.settings, job.folder, source=work.source,
        resume=RunFolder(job.folder).exists, access=work.access, on_progress=check, on_warning=None,
    )  # fmt: skip


def _set_aside(job: Job) -> None:
    """Sets a run aside that can't go on with another budget; waits for the folder of any other."""
    run = RunFolder(job.folder)
    if not job.folder.is_dir():
        return
    with FileLock(job.folder / LOCK, timeout=_LOCK_TIMEOUT):
        planned = run.exists and METHODS[job.settings.chosen_method].planned_by_budget
        if not planned or (before := run.settings().budget) == job.settings.budget:
            return
        aside = job.folder / f"budget-{before}"
        aside.mkdir(exist_ok=True)
        files = [file for file in job.folder.iterdir() if file.is_file() and file.name != LOCK]
        for file in sorted(files, key=lambda file: file.name == SETTINGS):  # last, so that this can be done again
            file.replace(aside / file.name)
