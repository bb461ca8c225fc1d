"""Puts the page together: tables, charts and styles in one file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.calibration.convergence import best_losses
from swim2real.objective import ComparedTrial
from swim2real.report.calls import call_section
from swim2real.report.film import films
from swim2real.report.headline import split, tiles, warnings
from swim2real.report.marker_errors import marker_errors
from swim2real.report.pages import Charts, render_page, write_page
from swim2real.report.rounds import advisor_rounds
from swim2real.report.run import ReportedRun, incumbent, read_run
from swim2real.report.run_charts import by_marker, convergence, speeds
from swim2real.report.tables import parameter_rows, settings_rows, trial_table
from swim2real.report.trial_charts import (
    common_ranges,
    drawn_trials,
    envelope,
    errors_over_time,
    path_markers_of,
    paths,
    progress_over_time,
    sensor_readings,
    tail_tip,
)
from swim2real.report.units import mm
from swim2real.robots.robot import Robot

REPORT = "report.html"


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
    return write_page(Path(run) / REPORT, render(read_run(run, robot)))


def render(run: ReportedRun) -> str:
    """The page as text."""
    shown = content(run)
    charts: Charts = shown.pop("charts")
    return render_page(
        "run.html.j2", shown, charts, style="report.css calls.css film.css", script="report.js calls.js film.js"
    )


def content(run: ReportedRun) -> dict[str, Any]:
    """Everything that the template shows."""
    errors, saved = marker_errors(run), drawn_trials(run.saved)
    order = "marker, head to tail" if run.robot.trials.nearly_straight else "marker"
    charts: dict[str, Any] = {"convergence": partial(convergence, run)}
    if run.has_beat:
        charts["speeds"] = partial(speeds, run)
    charts |= {f"error-{one.key}": partial(by_marker, one, run.marker_names, order) for one in errors}
    return {
        "run": run,
        "everything_diverged": incumbent(run.entries) is None,
        "mean_best": mm(float(np.mean(best_losses(run.entries)))),
        "tiles": tiles(run),
        "split": split(run),
        "errors": errors,
        "parameters": parameter_rows(run),
        "rounds": advisor_rounds(run),
        "calls": call_section(run.calls),
        "saved": saved,
        "films": films(saved, run.robot),
        "warnings": warnings(run),
        "trials": trial_table(run),
        "settings": settings_rows(run),
        "charts": charts | trial_charts([one.compared for one in saved], run),
    }


def trial_charts(trials: Sequence[ComparedTrial], run: ReportedRun) -> dict[str, Any]:
    """What draws the charts of each trial, of what it has; their names begin with what they show."""
    names, units = run.marker_names, {sensor.name: sensor.unit for sensor in run.robot.trials.sensors}
    ranges = common_ranges(trials)
    charts: dict[str, Any] = {}
    for i, trial in enumerate(trials):
        if names:
            shown = common_ranges([trial], path_markers_of([trial], names))
            charts[f"paths-{i}"] = partial(paths, trial, names, run.robot, shown)
        if trial.frequency is not None:
            charts[f"envelope-{i}"] = partial(envelope, trial, ranges)
            charts[f"tail-{i}"] = partial(tail_tip, trial, names, ranges)
        if trial.divergence is not None:
            continue
        if names:
            charts[f"off-{i}"] = partial(errors_over_time, trial, names)
        if trial.progress is not None:
            charts[f"progress-{i}"] = partial(progress_over_time, trial.times, trial.progress)
        for j, sensor in enumerate(trial.sensors):
            charts[f"sensor-{i}-{j}"] = partial(sensor_readings, sensor, units.get(sensor.name, ""))
    return charts
