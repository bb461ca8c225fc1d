"""One run of a comparison, wherever it is done. Doing it again reads what is finished and goes on with what isn't."""

from __future__ import annotations

import socket
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from filelock import FileLock, Timeout

from swim2real.calibration import Progress, RunFolder
from swim2real.calibration.run_folder import SETTINGS
from swim2real.comparison.cluster import SessionEnded, check_session
from swim2real.comparison.plan import Job, Plan
from swim2real.errors import RunError, Swim2RealError
from swim2real.pipeline import calibrate
from swim2real.pipeline.methods import METHODS
from swim2real.robots.robot import Robot
from swim2real.settings import VlmAccess
from swim2real.simulation import Engine
from swim2real.store import LOCK, write_text
from swim2real.trials import TrialSet

PROBLEM = "problem.txt"
_LOCK_TIMEOUT = 60.0  # s that a run folder is waited for, which a worker taken for lost may still hold


@dataclass(frozen=True)
class Work:
    """What all jobs of a session share.

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
    """How a job ended.

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


def run_job(job: Job, work: Work) -> JobReport:
    """Does a job in this process. Nothing that goes wrong in it is raised; the report says it."""
    began = time.monotonic()
    try:
        check_session(work.root, work.token)
        finished = is_finished(job, work.plan)
        if not finished:
            _continue(job, work)
        (job.folder / PROBLEM).unlink(missing_ok=True)
        report = ended_job(job, "read" if finished else "done")
    except SessionEnded:
        report = JobReport(job.key, job.method, "stopped")
    except Swim2RealError as error:
        report = failed_job(job, str(error))
    except Exception as error:  # a fault of ours ends one job, not the comparison
        report = failed_job(job, f"unexpected {type(error).__name__}: {error}", traceback.format_exc())
    return replace(report, seconds=round(time.monotonic() - began, 3))


def ended_job(job: Job, state: Literal["read", "done"]) -> JobReport:
    """The report of a job whose run is finished."""
    record = RunFolder(job.folder).record()
    losses = [entry.loss for entry in record if not entry.failed]
    return JobReport(job.key, job.method, state, None, min(losses, default=None), len(record))


def failed_job(job: Job, problem: str, trace: str = "") -> JobReport:
    """The report of a job that failed; the problem is left in its run folder, too, as far as the disk allows."""
    with suppress(OSError):
        job.folder.mkdir(parents=True, exist_ok=True)
        write_text(job.folder / PROBLEM, f"{problem}\n{trace}")
    return JobReport(job.key, job.method, "failed", problem)


def is_finished(job: Job, plan: Plan) -> bool:
    """Whether a run is finished, with the settings of its job.

    Raises:
        RunError: It was made with others, or is damaged.
    """
    folder = RunFolder(job.folder)
    if not folder.exists:
        return False
    recorded, settings = folder.settings(), job.settings
    wanted = {
        **vars(settings), "scale": settings.resolved_scale, "robot": plan.robot, "engine": plan.engine,
        "robot_fingerprint": plan.robot_fingerprint, "reference_fingerprint": plan.reference,
    }  # fmt: skip
    if (differing := recorded.difference(replace(recorded, **wanted))) is not None:
        name, before, now = differing
        raise RunError(
            f"'{job.folder}' was run with another setting of {name}: {before!r}, and now it is {now!r}; remove it, or "
            f"use another folder for the comparison"
        )
    record, outcome = folder.record(), folder.outcome()
    # the outcome may be of a smaller budget
    return outcome is not None and outcome.evaluations == len(record) >= settings.budget


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
        planned = run.exists and METHODS[job.settings.method].planned_by_budget
        if not planned or (before := run.settings().budget) == job.settings.budget:
            return
        aside = job.folder / f"budget-{before}"
        aside.mkdir(exist_ok=True)
        files = [file for file in job.folder.iterdir() if file.is_file() and file.name != LOCK]
        for file in sorted(files, key=lambda file: file.name == SETTINGS):  # last, so that this can be done again
            file.replace(aside / file.name)
