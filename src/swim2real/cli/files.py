"""`report` and `fetch`."""

from __future__ import annotations

import sys
from pathlib import Path

from swim2real.cli import tables
from swim2real.cli.arguments import Fetch, Report
from swim2real.errors import MissingExtraError
from swim2real.robots.fish import FISH


def report(a: Report) -> int:
    """Writes a run's report page."""
    from swim2real import report as room

    tables.console.print(str(room.write_report(a.run, FISH.space)), soft_wrap=True)
    return 0


def write_report(folder: Path) -> Path | None:
    """The report after a run; without its libraries a sentence says so and the run is still good."""
    from swim2real import report as room

    try:
        return room.write_report(folder, FISH.space)
    except MissingExtraError as error:
        print(f"swim2real: {error}", file=sys.stderr)
        return None


def fetch(a: Fetch) -> int:
    """Gets the published tracks."""
    from swim2real.trials.fetch import fetch as get

    trials = get(a.to, a.source, lambda name, what: tables.console.print(f"{name}: {what}"))
    tables.console.print(f"{a.to}: {len(trials)} trials", soft_wrap=True)
    return 0
