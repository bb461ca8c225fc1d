"""The page of a run: tables, charts and styles in one file that needs no network."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from swim2real.calibration import SavedTrial
from swim2real.calibration.convergence import best_losses, incumbent
from swim2real.report.determined import Determined, determined
from swim2real.report.errors import ErrorRow, MarkerErrors, error_rows, marker_errors, warnings
from swim2real.report.film import Film, films
from swim2real.report.pages import Charts, PageContext, write_page
from swim2real.report.rounds import AdvisorRound, CallSection, advisor_rounds, call_section
from swim2real.report.run import ReportedRun, read_run
from swim2real.report.run_charts import by_marker, convergence, drawn_trials, speeds, trial_charts
from swim2real.report.tables import ParameterRow, TrialTable, interval_name, parameter_rows, settings_rows, trial_table
from swim2real.robots.robot import Robot

REPORT = "report.html"


@dataclass(frozen=True)
class RunPage(PageContext):
    """Everything that the page of a run shows; `films` and `saved` are of the trials that are drawn."""

    run: ReportedRun
    warnings: tuple[str, ...]
    standing: tuple[str, ...]
    everything_diverged: bool
    mean_best: float
    rows: tuple[ErrorRow, ...]
    errors: tuple[MarkerErrors, ...]
    parameters: tuple[ParameterRow, ...]
    intervals: str
    determined: Determined | None
    rounds: tuple[AdvisorRound, ...]
    calls: CallSection | None
    saved: tuple[SavedTrial, ...]
    films: tuple[Film, ...]
    trials: TrialTable
    settings: dict[str, str]


def write_report(run: str | Path, robot: Robot) -> Path:
    """Writes the page of a run into its folder. The same folder gives the same page, to the last byte.

    Args:
        run: The run folder, of a run that has ended or not.
        robot: The robot that the run calibrated.

    Returns:
        Where the page is.

    Raises:
        RunError: Nothing to report, a damaged file, or the page can't be written.
        ParameterError: The run is of another robot.
    """
    context = page_context(read_run(run, robot))
    return write_page(Path(run) / REPORT, context, "run.html.j2", "report.js calls.js film.js", "calls.css film.css")


def page_context(run: ReportedRun) -> RunPage:
    """Everything that the template shows."""
    errors, saved = marker_errors(run), drawn_trials(run.saved)
    order = "marker, head to tail" if run.robot.trials.steady else "marker"
    charts: Charts = {"convergence": partial(convergence, run)}
    if run.has_beat:
        charts["speeds"] = partial(speeds, run)
    charts |= {f"error-{one.key}": partial(by_marker, one, run.marker_names, order) for one in errors}
    found, pairs = determined(run) or (None, {})
    return RunPage(
        title=run.name,
        charts=charts | pairs | trial_charts([one.compared for one in saved], run),
        run=run,
        warnings=warnings(run),
        standing=run.standing,
        everything_diverged=incumbent(run.entries) is None,
        mean_best=float(np.mean(best_losses(run.entries))),
        rows=error_rows(run),
        errors=errors,
        parameters=parameter_rows(run),
        intervals=interval_name(run),
        determined=found,
        rounds=advisor_rounds(run),
        calls=call_section(run.calls),
        saved=saved,
        films=films(saved, run.robot),
        trials=trial_table(run),
        settings=settings_rows(run),
    )
