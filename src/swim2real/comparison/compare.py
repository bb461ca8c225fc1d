"""Runs a comparison: hands its jobs to whoever does the work, follows them, and reads what came of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from swim2real.advisor import asks_a_vlm
from swim2real.calibration.run_folder import RECORD
from swim2real.comparison import executors
from swim2real.comparison.jobs import Work, new_summary, note_problem, read_job, run_job
from swim2real.comparison.plan import RUNS, Job, Plan, read_plan
from swim2real.comparison.reading import read_results, write_results
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.session import alone, judge, probe, session
from swim2real.processes import ProcessPool
from swim2real.robots.robot import Robot
from swim2real.settings import VlmAccess
from swim2real.trials import TrialSet

_LOOK = 1.0  # s between two looks at how far the runs are
# of one evaluation relative to a random search's, with what the method itself takes; only the order hangs on it
_COST: Mapping[str, float] = {"bayesopt": 3.0, "staged": 2.0}


@dataclass(frozen=True)
class ComparisonProgress:
    """How far a comparison is.

    Attributes:
        jobs_done: Those that were finished before, too.
        jobs: Of all.
        evaluations: That are on record.
        budget: Evaluations of all jobs.
        best: Lowest loss of each method's finished runs [m].
        seconds_left: Estimate [s], None while there is nothing to estimate from.
        finished: The summary of the job that has just ended, as `run_job` describes it; None between two.
    """

    jobs_done: int
    jobs: int
    evaluations: int
    budget: int
    best: Mapping[str, float]
    seconds_left: float | None
    finished: Mapping[str, Any] | None = None


def compare(
    plan: Plan, reference: TrialSet, robot: Robot, out: str | Path, *, workers: int | None = None,
    cluster: str | None = None, access: VlmAccess | None = None,
    on_progress: Callable[[ComparisonProgress], None] = lambda progress: None,
) -> ComparisonResults:  # fmt: skip
    """Runs what isn't finished of a comparison. Called again, it goes on; with a larger plan, it adds to what is there.

    Args:
        plan: What to run.
        reference: The real trials.
        robot: What is calibrated.
        out: Folder of the comparison.
        workers: Processes on this machine; None for as many as there are cores.
        cluster: Dask scheduler to use instead: its address, or `local:N`.
        access: How VLMs are reached.
        on_progress: Called when a job ends, and about once a second.

    Returns:
        All finished runs, with those of earlier calls; `missing` says which jobs failed. They are written to
        results.json and results.csv as well. On KeyboardInterrupt every run is left such that it goes on.

    Raises:
        Swim2RealError: The folder holds another comparison, or the work can't be begun.
    """
    root = Path(out).resolve()
    with alone(root):
        before = read_plan(root) if (root / RUNS).is_dir() else None  # a plan without a run binds nobody
        plan = plan if before is None else plan.extending(before)
        plan.write(root)
        with session(root) as token:
            work = Work(root, token, reference, robot, plan.basis, plan.source, access or VlmAccess())
            _run(plan.jobs(root), work, lambda: _team(root, token, workers, cluster), on_progress)
        results = read_results(root, plan)
        write_results(results, root)
        return results


def _team(root: Path, token: str, workers: int | None, cluster: str | None) -> AbstractContextManager[Executor]:
    if cluster is None:
        return ProcessPool(workers)
    return executors.dask(cluster, partial(probe, root, token), partial(judge, root=root))


def _run(
    jobs: Sequence[Job], work: Work, make_team: Callable[[], AbstractContextManager[Executor]],
    on_progress: Callable[[ComparisonProgress], None],
) -> None:  # fmt: skip
    counts = _Counts(jobs)
    best: dict[str, float] = {}
    ended = 0

    def tell(summary: Mapping[str, Any] | None = None) -> None:
        nonlocal ended
        if summary is not None:
            ended += 1
            if summary["best"] is not None:
                method = summary["method"]
                best[method] = min(best.get(method, summary["best"]), summary["best"])
        on_progress(counts.progress(ended, best, summary))

    due: list[Job] = []
    for job in jobs:
        if (summary := read_job(job, work)) is None:
            due.append(job)
        else:
            tell(summary)
    if not due:
        return
    with make_team() as team:
        futures = {team.submit(run_job, job, work): job for job in sorted(due, key=_cost, reverse=True)}
        left = set(futures)
        while left:
            done, left = wait(left, timeout=_LOOK, return_when=FIRST_COMPLETED)
            counts.look(futures[future] for future in left | done)
            for future in done:
                tell(_summary(future, futures[future]))
            if not done:
                tell()


def _summary(future: Future[dict[str, Any]], job: Job) -> dict[str, Any]:
    error = CancelledError() if future.cancelled() else future.exception()
    if error is None:
        return future.result()
    problem = executors.explained(error)
    note_problem(job.folder, problem)
    return {**new_summary(job), "state": "failed", "problem": problem}


def _cost(job: Job) -> float:
    """Roughly how long a job takes: the longest are begun first, so that no worker is left with one at the end."""
    settings = job.settings
    method = 4.0 if asks_a_vlm(settings.advisor) else _COST.get(settings.method, 1.0)
    return method * (0.8 if settings.hold_out else 1.0)


class _Counts:
    """Counts evaluations by the lines of the records, which grow on whatever machine."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._budget = sum(job.settings.budget for job in jobs)
        self._count = len(jobs)
        self._lines = {job.key: 0 for job in jobs}
        self._read = {job.key: 0 for job in jobs}  # bytes
        self.look(jobs)
        self._before, self._began = sum(self._lines.values()), time.monotonic()

    def look(self, jobs: Iterable[Job]) -> None:
        for job in jobs:
            try:
                with (job.folder / RECORD).open("rb") as file:
                    file.seek(self._read[job.key])
                    more = file.read()
            except OSError:
                continue
            self._read[job.key] += len(more)
            self._lines[job.key] += more.count(b"\n")

    def progress(
        self, done: int, best: Mapping[str, float], finished: Mapping[str, Any] | None
    ) -> ComparisonProgress:  # fmt: skip
        lines = sum(self._lines.values())
        fresh, seconds = lines - self._before, time.monotonic() - self._began
        left = seconds / fresh * (self._budget - lines) if fresh > 0 else None
        return ComparisonProgress(done, self._count, lines, self._budget, dict(best), left, finished)
