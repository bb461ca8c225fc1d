"""Puts the page together: tables, figures, styles and the plotting library in one file that needs no network."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.errors import MissingExtraError, RunError
from swim2real.report.call_table import call_section
from swim2real.report.marker_errors import MarkerErrors
from swim2real.report.palette import COLORS, DARK_OF_LIGHT, Figure
from swim2real.report.parameter_table import parameter_rows
from swim2real.report.reading import read_run
from swim2real.report.rounds import advisor_rounds
from swim2real.report.run import ReportedRun, best_losses, incumbent
from swim2real.report.run_figures import by_marker, convergence
from swim2real.report.settings_table import settings_rows
from swim2real.report.units import mm
from swim2real.robots.robot import Robot

REPORT = "report.html"
_STYLE, _SCRIPT = "report.css", "report.js"
_CALLS = ("calls.css", "calls.js")  # only on pages with calls


def write_report(run: str | Path, robot: Robot) -> Path:
    """Writes the page of a run into its folder. The same folder gives the same page, to the last byte.

    Args:
        run: Run folder, of a run that has ended or not.
        robot: That the run calibrated.

    Returns:
        Where the page is.

    Raises:
        MissingExtraError: plotly or jinja2 isn't installed.
        RunError: Nothing to report, a damaged file, or the page can't be written.
        ParameterError: The run is of another robot.
    """
    page = render(read_run(run, robot))
    path = Path(run) / REPORT
    part = path.with_name(REPORT + ".part")
    try:
        part.write_text(page, encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise RunError(f"can't write '{path}': {error.strerror or error}; make room or allow writing there") from error
    return path


def render(run: ReportedRun) -> str:
    """The page as text.

    Raises:
        MissingExtraError: plotly or jinja2 isn't installed.
    """
    try:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
        from markupsafe import Markup
        from plotly.offline import get_plotlyjs  # pyright: ignore[reportMissingTypeStubs]
    except ImportError as error:
        raise MissingExtraError(
            "the report needs plotly and jinja2; install them with: pip install 'swim2real[report]'"
        ) from error
    templates = Path(__file__).parent / "templates"
    environment = Environment(
        loader=FileSystemLoader(templates),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )

    def own(name: str) -> Markup:
        return Markup((templates / name).read_text(encoding="utf-8"))  # ours, not from a run

    return environment.get_template(run.sections.template).render(
        **content(run),
        colors=COLORS,
        style=own(_STYLE),
        script=own(_SCRIPT),
        plotly=Markup(get_plotlyjs()),
        calls_style=own(_CALLS[0]),
        calls_script=own(_CALLS[1]),
    )


def content(run: ReportedRun) -> dict[str, Any]:
    """Everything that the template shows."""
    own = run.sections.content(run)
    errors: tuple[MarkerErrors, ...] = own["errors"]
    figures: dict[str, Figure] = {"convergence": convergence(run, own["loss"]), **own.pop("figures")}
    figures |= {f"error-{one.key}": by_marker(one, run.marker_names, own["order"]) for one in errors}
    return {
        **own,
        "run": run,
        "everything_diverged": incumbent(run.entries) is None,
        "mean_best": mm(float(np.mean(best_losses(run.entries)))),
        "parameters": parameter_rows(run),
        "rounds": advisor_rounds(run),
        "calls": call_section(run.calls),
        "settings": settings_rows(run),
        "plots": {"figures": figures, "darkOfLight": DARK_OF_LIGHT},
    }
