"""Reads the run folders of a comparison, and writes what is in them as one JSON file and one table."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from swim2real.advisor import asks_a_vlm
from swim2real.advisor.vlm.transcript import Transcript, totals
from swim2real.calibration import RunFolder
from swim2real.comparison.files import write_json, write_text
from swim2real.comparison.jobs import is_finished, read_problem
from swim2real.comparison.plan import RUNS, Job, Plan, read_plan
from swim2real.comparison.results import RESULTS, ComparisonResults, RunResult, step_rounds
from swim2real.errors import RunError, Swim2RealError

TABLE = "results.csv"
_NO_MEANS = ("loss", "skipped", "protocol", "horizon", "trials")


def read_results(root: str | Path, plan: Plan | None = None) -> ComparisonResults:
    """Reads every finished run of a comparison. A run that can't be read is missing, with the reason.

    Args:
        root: Folder of the comparison.
        plan: Of the comparison; None reads it.

    Raises:
        RunError: There is no comparison.
    """
    plan = plan or read_plan(root)
    if plan is None:
        raise RunError(f"'{root}' is no comparison: it has no plan.json; `swim2real compare` makes one")
    runs: list[RunResult] = []
    missing: dict[str, str] = {}
    for job in plan.jobs(root):
        try:
            if is_finished(job, plan.basis):
                runs.append(_result(job))
            else:
                missing[job.key] = read_problem(job.folder) or _how_far(job)
        except Swim2RealError as error:
            missing[job.key] = str(error)
    return ComparisonResults(
        tuple(runs), plan.methods, plan.protocols, plan.trials, plan.markers, plan.budget, plan.reference, missing,
        plan.engine, plan.sensors,
    )  # fmt: skip


def write_results(results: ComparisonResults, root: str | Path) -> None:
    """Writes results.json and results.csv. The table holds nothing that another run of the same would change."""
    write_json(Path(root) / RESULTS, results.as_dict())
    rows = [_row(run) for run in results.runs]
    columns = list(dict.fromkeys(column for row in rows for column in row))
    text = io.StringIO()
    table = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_text(Path(root) / TABLE, text.getvalue())


def _result(job: Job) -> RunResult:
    folder = RunFolder(job.folder)
    record, outcome = folder.record(), folder.outcome()
    if outcome is None:
        raise RunError(f"run '{job.folder}' has no outcome; run the comparison again")
    try:
        best = min((e for e in record if not e["failed"]), key=lambda e: e["loss"], default=record[0])
        calls, spent = _calls(job, record)
        return RunResult(
            method=job.method,
            seed=job.settings.seed,
            protocol=job.settings.protocol,
            scale=job.settings.resolved_scale,
            held_out=job.held_out,
            losses=tuple(e["loss"] for e in record),
            failed=tuple(e["failed"] for e in record),
            rounds=step_rounds(record, job.settings.max_steps),
            calls=calls,
            spent=spent,
            fit=outcome["fit"],
            held_out_fit=outcome["held_out"],
            values=best["values"],
            seconds=round(sum(e["seconds"] for e in record), 3),
            folder=f"{RUNS}/{job.key}",
        )
    except (KeyError, TypeError) as error:
        raise RunError(f"run '{job.folder}' is damaged: {error!r}; remove it and run the comparison again") from error


def _calls(job: Job, record: list[dict[str, Any]]) -> tuple[int, Mapping[str, Any] | None]:
    if not asks_a_vlm(job.settings.advisor):
        return sum("proposal" in entry["note"] for entry in record), None
    taken = asdict(totals(Transcript(job.folder).calls))
    return taken.pop("calls"), {"failed_calls": taken.pop("failed"), **taken}


def _how_far(job: Job) -> str:
    done = len(RunFolder(job.folder).record())
    return f"{done} of {job.settings.budget} evaluations are done" if done else "not begun"


def _row(run: RunResult) -> dict[str, Any]:
    row: dict[str, Any] = {
        "protocol": run.protocol, "method": run.method, "seed": run.seed, "held_out": run.held_out or "",
        "scale": run.scale, "evaluations": len(run.losses), "failed": sum(run.failed), "first_loss": run.losses[0],
        "best_loss": run.best_loss, "best_evaluation": run.best_evaluation, "auc": float(run.best.mean()),
        "calls": run.calls, "rounds": len(run.rounds), "accepted": sum(r.accepted for r in run.rounds),
    }  # fmt: skip
    row.update(_means(run.fit))
    if run.held_out_fit is not None:
        unseen = {"loss": run.held_out_fit["loss"], **_means(run.held_out_fit)}
        row.update({f"held_out_{name}": value for name, value in unseen.items()})
    row.update(run.values)
    return row


def _means(fit: Mapping[str, Any]) -> dict[str, Any]:
    """The figures of a fit that are means over trials; those that have several numbers as `FIGURE.NAME`."""
    found: dict[str, Any] = {}
    for name, value in fit.items():
        if name not in _NO_MEANS:
            found |= {f"{name}.{key}": one for key, one in value.items()} if isinstance(value, dict) else {name: value}
    return found
