"""One run of a comparison, wherever it is done. Doing it again reads what is finished and goes on with what isn't."""

from __future__ import annotations

import os
import socket
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from swim2real.advisor import asks_a_vlm
from swim2real.calibration import Progress, RunFolder
from swim2real.calibration.run_folder import SETTINGS
from swim2real.comparison.files import write_text
from swim2real.comparison.plan import Job
from swim2real.comparison.session import Stopped, check_session
from swim2real.errors import RunError, Swim2RealError
from swim2real.pipeline import run
from swim2real.robots.robot import Robot
from swim2real.settings import VlmAccess
from swim2real.simulation import Engine
from swim2real.store import LOCK
from swim2real.trials import TrialSet

PROBLEM = "problem.txt"
_PLANNED_BY_BUDGET = ("staged",)
_FREE_FOR = 60.0  # s that a run folder is waited for, which a worker taken for lost may still hold


@dataclass(frozen=True)
class Work:
    """What all jobs of a session share.

    Attributes:
        root: Folder of the comparison.
        token: Of the session. Jobs stop when the session's file is gone or another session's.
        reference: The real trials.
        robot: What is calibrated.
        basis: What every run must rest on, as `Plan.basis` says it.
        source: Where the reference came from.
        access: How VLMs are reached.
    """

    root: Path
    token: str
    reference: TrialSet
    robot: Robot
    basis: Mapping[str, Any]
    source: str = ""
    access: VlmAccess = field(default_factory=VlmAccess)


def new_summary(job: Job) -> dict[str, Any]:
    """What is told of a job: `key`, `method`, `state`, `problem`, `best`, `evaluations`, `seconds` and `where`.

    The state is `read` (it was finished before), `done`, `stopped` or `failed`; the problem a sentence or None; the
    best loss in meters; the seconds those that it took here.
    """
    return {
        "key": job.key, "method": job.method, "state": "done", "problem": None, "best": None, "evaluations": 0,
        "seconds": 0.0, "where": f"{socket.gethostname()}:{os.getpid()}",
    }  # fmt: skip


def read_job(job: Job, work: Work) -> dict[str, Any] | None:
    """The summary of a job that is finished, None for one that is to be done."""
    try:
        if is_finished(job, work.basis):
            return {**new_summary(job), "state": "read", **_found(job)}
    except Swim2RealError:
        pass  # which is said when the job is done
    return None


def run_job(job: Job, work: Work) -> dict[str, Any]:
    """Does a job in the process that calls, and returns its summary. Nothing that goes wrong in it is raised."""
    began = time.monotonic()
    summary = new_summary(job)
    try:
        check_session(work.root, work.token)
        if is_finished(job, work.basis):
            summary["state"] = "read"
        else:
            _go_on(job, work)
        summary.update(_found(job))
        (job.folder / PROBLEM).unlink(missing_ok=True)
    except Stopped:
        summary["state"] = "stopped"
    except Swim2RealError as error:
        summary.update(state="failed", problem=str(error))
        note_problem(job.folder, str(error))
    except Exception as error:  # a fault of ours ends one job, not the comparison
        summary.update(state="failed", problem=f"unexpected {type(error).__name__}: {error}")
        note_problem(job.folder, summary["problem"], traceback.format_exc())
    return {**summary, "seconds": round(time.monotonic() - began, 3)}


def _found(job: Job) -> dict[str, Any]:
    record = RunFolder(job.folder).record()
    losses = [entry["loss"] for entry in record if not entry["failed"]]
    return {"evaluations": len(record), "best": min(losses, default=None)}


def is_finished(job: Job, basis: Mapping[str, Any]) -> bool:
    """Whether a run is finished, with the settings that are asked for.

    Raises:
        RunError: It was made with others, or is damaged.
    """
    folder = RunFolder(job.folder)
    if not folder.exists:
        return False
    recorded = folder.settings()
    settings = job.settings
    briefing = asdict(settings.briefing) if asks_a_vlm(settings.advisor) else None
    wanted = {
        **asdict(settings), "scale": settings.resolved_scale, "hold_out": sorted(settings.hold_out),
        "briefing": briefing, **basis,
    }  # fmt: skip
    for key, value in wanted.items():
        if key not in ("budget", "threads") and recorded.get(key) != value:
            raise RunError(
                f"'{job.folder}' was run with another setting of {key}: {recorded.get(key)!r}, and now it is "
                f"{value!r}; remove it, or use another folder for the comparison"
            )
    record, outcome = folder.record(), folder.outcome()
    if outcome is None or len(record) < settings.budget:
        return False
    # the outcome may be of a smaller budget
    best = min((e for e in record if not e["failed"]), key=lambda e: e["loss"], default=record[0])
    return bool(np.isclose(outcome["fit"]["loss"], best["loss"], rtol=1e-6, atol=0.0))


def note_problem(folder: Path, problem: str, trace: str = "") -> None:
    """Leaves word of a problem in a run folder, as far as the disk allows."""
    try:
        write_text(folder / PROBLEM, f"{problem}\n{trace}")
    except RunError:
        return


def read_problem(folder: Path) -> str | None:
    """The sentence that a failed job left in its folder."""
    try:
        return (folder / PROBLEM).read_text(encoding="utf-8").splitlines()[0]
    except (OSError, IndexError):
        return None


def _go_on(job: Job, work: Work) -> None:
    engine = Engine.of(work.robot).as_dict()
    wanted = work.basis["engine"]
    if engine != wanted:
        raise RunError(
            f"worker {socket.gethostname()} simulates with {engine['name']}, whose physics differs from that of "
            f"{wanted['name']}, which the comparison was begun with; install the same on every worker"
        )
    _prepare(job)

    def watch(progress: Progress) -> None:
        if not progress.replayed:
            check_session(work.root, work.token, patience=1.0)

    run(
        work.reference, work.robot, job.settings, job.folder, source=work.source,
        resume=RunFolder(job.folder).exists, access=work.access, on_progress=watch,
    )  # fmt: skip


def _prepare(job: Job) -> None:
    """Waits for a worker that was taken for lost and isn't, and sets a run aside that can't go on with more budget."""
    if not job.folder.is_dir():
        return
    try:
        with FileLock(job.folder / LOCK, timeout=_FREE_FOR):
            if RunFolder(job.folder).exists and job.settings.method in _PLANNED_BY_BUDGET:
                _set_aside(job)
    except (Timeout, OSError):
        return  # the run says it in its words


def _set_aside(job: Job) -> None:
    before = RunFolder(job.folder).settings().get("budget")
    if before == job.settings.budget:
        return
    there = job.folder / f"budget-{before}"
    there.mkdir(exist_ok=True)
    files = [file for file in job.folder.iterdir() if file.is_file() and file.name != LOCK]
    for file in sorted(files, key=lambda file: file.name == SETTINGS):  # last, so that this can be done again
        file.replace(there / file.name)
