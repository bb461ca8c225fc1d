"""The finished runs of a comparison as plain data: read from their folders, written as one JSON file and one table."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, TypeAdapter

from swim2real.advisor.vlm.transcript import Totals, Transcript, totals
from swim2real.calibration import RunFolder
from swim2real.calibration.convergence import incumbent
from swim2real.calibration.file_models import RecordedEvaluation
from swim2real.comparison.plan import KEPT, PROBLEM, RUNS, Job, Plan, read_plan
from swim2real.objective.figures import FitFigures, figure_values
from swim2real.settings import asks_a_vlm
from swimbase import checking
from swimbase.arrays import Array
from swimbase.errors import RunError, Swim2RealError
from swimbase.names import quoted
from swimbase.store import read_text, write_json, write_text, writing

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 1
RESULTS, TABLE = "results.json", "results.csv"

Loss = Annotated[float, Field(ge=0, lt=1e6)]

_REMEDY = "run the comparison again to write it anew"


@dataclass(frozen=True)
class StepRound:
    """One advisor call of a line search, with its steps.

    Attributes:
        begin: Index of the first step's evaluation.
        sizes: Sizes of the steps, from the full one on.
        accepted: Whether the last of them improved on the incumbent.
        finished: False for a last round that the budget cut short: neither accepted nor rejected.
    """

    begin: int
    sizes: tuple[float, ...]
    accepted: bool
    finished: bool


@dataclass(frozen=True)
class RunResult:
    """One finished run: a method with a seed under a protocol.

    Attributes:
        method: Label of the method, with its advisor and a scale that isn't the protocol's own.
        seed: Seed of the run.
        protocol: `aligned`, `paper` or `playback`.
        scale: Scale of the parameters: `log` or `linear`.
        held_out: Name of the trial that was left out of the fit, None when it was made of all.
        losses: Loss of every evaluation, in order [m].
        failed: Whether each evaluation failed.
        rounds: Rounds of a line search, in order; none for other methods.
        calls: Calls of an advisor, with the failed ones and the repairs of a VLM.
        spent: What a VLM's calls took; None for other advisors.
        fit: Figures of the best parameters on the trials that were fitted.
        held_out_fit: Figures of the best parameters on the trial that was left out.
        values: The best parameters.
        seconds: Time that the evaluations took [s].
        folder: Run folder, relative to the comparison's, with `/`.
    """

    method: str
    seed: int
    protocol: str
    scale: str
    held_out: str | None
    losses: tuple[Loss, ...]
    failed: tuple[bool, ...]
    rounds: tuple[StepRound, ...]
    calls: int
    spent: Totals | None
    fit: FitFigures
    held_out_fit: FitFigures | None
    values: Mapping[str, float]
    seconds: float
    folder: str

    @cached_property
    def best(self) -> Array:
        """Lowest loss so far after each evaluation, as the run's incumbent [m]. Shape (B,)."""
        losses = np.where(self.failed, np.inf, self.losses)
        losses[0] = self.losses[0]
        return np.minimum.accumulate(losses)

    @property
    def best_loss(self) -> float:
        """Lowest loss of all evaluations [m]."""
        return float(self.best[-1])

    @property
    def best_evaluation(self) -> int:
        """Number of the evaluation that had the lowest loss, from 1 on."""
        return int(np.argmin(self.best)) + 1


@dataclass(frozen=True)
class ComparisonResults:
    """All finished runs of a comparison.

    Attributes:
        runs: The runs, ordered by protocol, method, seed and the trial that was left out, as planned.
        methods: Labels of the methods, as planned, also of those without a finished run.
        protocols: Protocols, as planned.
        trials: Names of the real trials.
        markers: Names of the markers.
        budget: Evaluations of a run.
        reference: Fingerprint of the real trials.
        missing: Why each planned run that isn't here isn't, by key.
        engine: Physics engine that simulated.
        sensors: Units of the sensors that are compared, by name.
        format: Version of the file's format.
    """

    runs: tuple[RunResult, ...]
    methods: tuple[str, ...]
    protocols: tuple[str, ...]
    trials: tuple[str, ...]
    markers: tuple[str, ...]
    budget: int
    reference: str
    missing: Mapping[str, str] = field(default_factory=dict[str, str])
    engine: Mapping[str, object] = field(default_factory=dict[str, object])
    sensors: Mapping[str, str] = field(default_factory=dict[str, str])
    format: Literal[1] = FORMAT

    def of(self, method: str, protocol: str) -> tuple[RunResult, ...]:
        """The runs of a method under a protocol that were fitted to all trials, one for each seed."""
        return tuple(run for run in self.runs if (run.method, run.protocol, run.held_out) == (method, protocol, None))

    def left_out(self, method: str, protocol: str) -> tuple[RunResult, ...]:
        """The runs of a method under a protocol that left a trial out."""
        return tuple(
            run for run in self.runs if (run.method, run.protocol) == (method, protocol) and run.held_out is not None
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A row for each run: what was run, its best loss [m], evaluations, seconds, and the best parameters."""
        import pandas as pd

        rows = [
            {
                "method": run.method, "protocol": run.protocol, "seed": run.seed, "held_out": run.held_out,
                "loss": float(run.best[-1]), "evaluations": len(run.losses), "seconds": run.seconds, **run.values,
            }
            for run in self.runs
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON. Each run has its curve of the best loss in it, too."""
        content = TypeAdapter(ComparisonResults).dump_python(self, mode="json", exclude_unset=True)
        for run, known in zip(content["runs"], self.runs, strict=True):
            run["best"] = known.best.tolist()
        return content


def load_results(folder: str | Path) -> ComparisonResults:
    """Reads results.json of a comparison.

    Raises:
        RunError: It isn't there, or damaged, or of another format.
    """
    path = Path(folder) / RESULTS
    if not path.is_file():
        raise RunError(f"'{folder}' has no {RESULTS}; `swim2real compare` writes it")
    results = checking.read(ComparisonResults, path, "results", RunError, _REMEDY)
    count = len(results.markers)
    for run in results.runs:
        where = f"results '{path}': run '{run.folder}'"
        if {len(run.losses), len(run.failed)} != {results.budget}:
            raise RunError(
                f"{where} has {len(run.losses)} losses and {len(run.failed)} marks of failure; the budget is "
                f"{results.budget}; {_REMEDY}"
            )
        trials = [*run.fit.trials.items(), *(run.held_out_fit.trials.items() if run.held_out_fit else ())]
        for name, trial in trials:
            for errors in (trial.marker_errors, trial.aligned_marker_errors, trial.shape_marker_errors):
                if errors and len(errors) != count:
                    raise RunError(
                        f"{where}: trial {quoted(name)} has {len(errors)} numbers for {count} markers; {_REMEDY}"
                    )
    return results


def read_results(root: str | Path, plan: Plan | None = None) -> ComparisonResults:
    """Reads every finished run of a comparison. A run that can't be read is missing, with the reason.

    Args:
        root: Folder of the comparison.
        plan: Plan of the comparison; None reads it from the folder.

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
            if job.is_finished(plan):
                runs.append(_read_run(job))
            else:
                missing[job.key] = _why_missing(job)
        except Swim2RealError as error:
            missing[job.key] = str(error)
    return ComparisonResults(
        tuple(runs), plan.methods, plan.settings.protocols, plan.trials, plan.markers, plan.settings.budget,
        plan.reference, missing, plan.engine.as_dict(), plan.sensors,
    )  # fmt: skip


def write_results(results: ComparisonResults, root: str | Path) -> None:
    """Writes results.json and results.csv. The table holds nothing that another run of the same would change."""
    rows = [_row(run) for run in results.runs]
    columns = list(dict.fromkeys(column for row in rows for column in row))
    text = io.StringIO()
    table = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    with writing(root, RunError, KEPT):
        write_json(Path(root) / RESULTS, results.as_dict(), indent=1)
        write_text(Path(root) / TABLE, text.getvalue())


def _step_rounds(record: Sequence[RecordedEvaluation], max_steps: int) -> tuple[StepRound, ...]:
    """The rounds of a line search, from its record."""
    rounds: list[StepRound] = []
    best, number, begin = np.inf, None, 0
    sizes: list[float] = []
    for index, entry in enumerate(record):
        note = entry.note
        improved = not entry.failed and entry.loss < best
        if improved or index == 0:
            best = entry.loss
        if note.step_size is None:
            continue
        if note.round != number:
            if rounds:  # only the last one may have been cut short
                rounds[-1] = replace(rounds[-1], finished=True)
            number, begin, sizes = note.round, index, []
            rounds.append(StepRound(begin, (), False, False))
        sizes.append(note.step_size)
        rounds[-1] = StepRound(begin, tuple(sizes), improved, improved or len(sizes) == max_steps)
    return tuple(rounds)


def _read_run(job: Job) -> RunResult:
    folder = RunFolder(job.folder)
    record, outcome = folder.record(), folder.outcome()
    if outcome is None:
        raise RunError(f"run '{job.folder}' has no outcome; run the comparison again")
    best = incumbent(record) or record[0]
    spent = totals(Transcript(job.folder).calls) if asks_a_vlm(job.settings.advisor) else None
    return RunResult(
        method=job.method,
        seed=job.settings.seed,
        protocol=job.settings.protocol,
        scale=job.settings.resolved_scale,
        held_out=job.held_out,
        losses=tuple(entry.loss for entry in record),
        failed=tuple(entry.failed for entry in record),
        rounds=_step_rounds(record, job.settings.steps_of_a_rejection),
        calls=sum(entry.note.proposal is not None for entry in record) if spent is None else spent.calls,
        spent=spent,
        fit=outcome.fit,
        held_out_fit=outcome.held_out,
        values=best.values,
        seconds=round(sum(entry.seconds or 0.0 for entry in record), 3),
        folder=f"{RUNS}/{job.key}",
    )


def _why_missing(job: Job) -> str:
    """The sentence that a failed job left in its folder, or how far it is."""
    try:
        return read_text(job.folder / PROBLEM).splitlines()[0]
    except (OSError, ValueError, IndexError):
        done = len(RunFolder(job.folder).record())
    return f"{done} of {job.settings.budget} evaluations are done" if done else "not begun"


def _row(run: RunResult) -> dict[str, object]:
    row: dict[str, object] = {
        "protocol": run.protocol, "method": run.method, "seed": run.seed, "held_out": run.held_out or "",
        "scale": run.scale, "evaluations": len(run.losses), "failed": sum(run.failed), "first_loss": run.losses[0],
        "best_loss": run.best_loss, "best_evaluation": run.best_evaluation, "auc": float(run.best.mean()),
        "calls": run.calls, "rounds": len(run.rounds), "accepted": sum(r.accepted for r in run.rounds),
    }  # fmt: skip
    row.update(figure_values(run.fit))
    if run.held_out_fit is not None:
        held_out = {"loss": run.held_out_fit.loss, **figure_values(run.held_out_fit)}
        row.update({f"held_out_{name}": value for name, value in held_out.items()})
    row.update(run.values)
    return row
