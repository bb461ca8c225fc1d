"""`report` and `fetch`."""

from __future__ import annotations

import sys
from pathlib import Path

from swim2real.calibration import RunFolder
from swim2real.cli import tables
from swim2real.cli.arguments import Fetch, Report
from swim2real.cli.subject import recorded_robot
from swim2real.errors import MissingExtraError
from swim2real.robots.robot import Robot


def report(a: Report) -> int:
    """Writes the page of a run or a comparison."""
    from swim2real import report as room
    from swim2real.comparison.plan import PLAN

    if (a.run / PLAN).is_file():
        from swim2real.cli.comparison_files import write_files

        tables.console.print(str(write_files(a.run)[-1]), soft_wrap=True)
        return 0
    tables.console.print(str(room.write_report(a.run, _robot(a.run))), soft_wrap=True)
    return 0


def write_report(folder: Path) -> Path | None:
    """The report after a run; without its libraries a sentence says so and the run is still good."""
    from swim2real import report as room

    try:
        return room.write_report(folder, _robot(folder))
    except MissingExtraError as error:
        print(f"swim2real: {error}", file=sys.stderr)
        return None


def _robot(run: Path) -> Robot:
    """That a run is for."""
    return recorded_robot(run, RunFolder(run).settings())


def fetch(a: Fetch) -> int:
    """Gets the published tracks."""
    from swim2real.trials.fetch import fetch as get

    trials = get(a.to, a.source, lambda name, what: tables.console.print(f"{name}: {what}"))
    tables.console.print(f"{a.to}: {len(trials)} trials", soft_wrap=True)
    return 0
