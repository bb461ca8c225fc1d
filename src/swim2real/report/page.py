"""Puts the page together: tables, charts and styles in one file that needs no network."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.calibration.run_folder import best_losses
from swim2real.report.call_table import call_section
from swim2real.report.marker_errors import MarkerErrors
from swim2real.report.pages import Charts, render_page, write_page
from swim2real.report.parameter_table import parameter_rows
from swim2real.report.reading import read_run
from swim2real.report.rounds import advisor_rounds
from swim2real.report.run import ReportedRun, incumbent
from swim2real.report.run_charts import by_marker, convergence
from swim2real.report.settings_table import settings_rows
from swim2real.report.units import mm
from swim2real.robots.robot import Robot

REPORT = "report.html"


def write_report(run: str | Path, robot: Robot) -> Path:
    """Writes the page of a run into its folder. The same folder gives the same page, to the last byte.

    Args:
        run: Run folder, of a run that has ended or not.
        robot: That the run calibrated.

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
    return render_page(run.sections.template, shown, charts, style="report.css calls.css", script="report.js calls.js")


def content(run: ReportedRun) -> dict[str, Any]:
    """Everything that the template shows."""
    own = run.sections.content(run)
    errors: tuple[MarkerErrors, ...] = own["errors"]
    charts: dict[str, Any] = {"convergence": partial(convergence, run, own["loss"]), **own.pop("charts")}
    charts |= {f"error-{one.key}": partial(by_marker, one, run.marker_names, own["order"]) for one in errors}
    return {
        **own,
        "run": run,
        "everything_diverged": incumbent(run.entries) is None,
        "mean_best": mm(float(np.mean(best_losses(run.entries)))),
        "parameters": parameter_rows(run),
        "rounds": advisor_rounds(run),
        "calls": call_section(run.calls),
        "settings": settings_rows(run),
        "charts": charts,
    }
