"""Files of a comparison for people: tables, figures and the page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from swim2real.calibration import RunFolder, examine_swims
from swim2real.cli.terminal import tell
from swim2real.comparison import ComparisonResults, load_results
from swim2real.comparison.tables import all_tables
from swim2real.objective import steady_target
from swim2real.objective.elongated_body import predict_speeds
from swim2real.report.comparison_page import write_comparison_report
from swim2real.report.paper_figures import write_figures
from swim2real.robots.robot import Robot
from swim2real.trials import TrialSet
from swimbase.errors import RunError, TrialError
from swimbase.store import read_json, write_text, writing

TABLES, THEORY = "tables.md", "theory.json"


def write_theory(folder: Path, reference: TrialSet, robot: Robot) -> None:
    """Writes the speeds of swims that elongated body theory predicts into the comparison's folder, where it can."""
    if not robot.trials.steady or len(robot.swims.tail_markers) < 2:
        return
    targets = [
        steady_target(swim.trial, swim.quality.weights, swim.beat.frequency) for swim in examine_swims(reference, robot)
    ]
    end = (robot.swims.tail_markers[-2], robot.swims.tail_markers[-1])
    try:
        speeds = {name: round(speed, 6) for name, speed in predict_speeds(targets, end).items()}
    except TrialError as error:
        tell(f"no speeds of elongated body theory: {error}")
        return
    RunFolder(folder).write_json(THEORY, speeds)


def write_files(folder: Path, results: ComparisonResults | None = None) -> list[Path]:
    """Writes tables, figures and page of a comparison, the page last.

    Raises:
        RunError: There are no results, or a file can't be written.
    """
    results = results or load_results(folder)
    theory = _theory(folder)
    tables = folder / TABLES
    with writing(tables, RunError):
        write_text(tables, all_tables(results))
    return [tables, *write_figures(results, folder, theory), write_comparison_report(folder, theory)]


def _theory(folder: Path) -> Mapping[str, float] | None:
    try:
        return read_json(folder / THEORY)
    except (OSError, ValueError):
        return None
