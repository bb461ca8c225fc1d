"""`identify`."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console

from swim2real.calibration.identifiability import IDENTIFIED, StudyProgress
from swim2real.calibration.identifiability import identify as study
from swim2real.calibration.reopened import reopen
from swim2real.cli import tables
from swim2real.cli.calibrate import threads
from swim2real.cli.interruption import noted_interrupts
from swim2real.cli.study_arguments import Identify
from swim2real.cli.subject import robot_for
from swim2real.settings import IdentifiabilitySettings
from swim2real.trials import load_reference

_SLOPPY, _STIFF = 5, 2  # directions that are printed
_TOLD = 3  # parameters that are named in a cell


def identify(a: Identify) -> int:
    """Studies a run's best fit."""
    settings = IdentifiabilitySettings(a.rise, a.steps, a.polish)
    run = reopen(a.run, load_reference(a.reference), robot_for(a.run), threads(a.threads))
    console = Console(stderr=True, highlight=False, soft_wrap=True)

    def tell(progress: StudyProgress) -> None:
        if not a.quiet:
            console.print(_line(progress))

    try:
        with noted_interrupts() as asked:

            def told(progress: StudyProgress) -> None:
                tell(progress)
                if asked():
                    raise KeyboardInterrupt

            found = study(run, settings, a.again, told)
    except KeyboardInterrupt:
        print(f"swim2real: interrupted; what is done is kept in '{a.run}', the same command goes on", file=sys.stderr)
        return 1
    if a.json:
        print(json.dumps(found, indent=2))
    else:
        _print(found)
        tables.console.print(
            f"The values at the lowest loss: {a.run / IDENTIFIED}; export-model, evaluate and train take this file in "
            f"place of the run.",
            soft_wrap=True,
        )
    return 0


def _line(progress: StudyProgress) -> str:
    counted = f"{progress.evaluations:5d} of at most {progress.most}  {progress.stage}"
    if progress.finished is None:
        return counted
    return f"{counted}: {progress.finished['verdict']}"


def _print(found: Mapping[str, Any]) -> None:
    start, fit, lowest = (1e3 * found[key]["loss"] for key in ("start", "fit", "lowest"))
    tables.console.print(
        f"Loss: {start:.2f} mm at the run's best, {fit:.2f} mm after some more steps, {lowest:.2f} mm at the lowest "
        f"that was seen; a rise of {1e3 * found['local']['rise']:.2f} mm counts.",
        soft_wrap=True,
    )
    rows: list[tuple[str, ...]] = []
    errors = found["local"]["standard_errors"]
    for name, one in found["profiles"].items():
        error = errors[name]["cube"]
        low, high = one["values"]
        rows.append(
            (
                name, one["verdict"], f"{low:.3g} to {high:.3g}",
                f"{100 * (one['interval'][1] - one['interval'][0]):.0f} %",
                "none" if error is None else "> 100 %" if error > 1 else f"{100 * error:.1f} %",
                f"{1e3 * one['largest_rise']:.1f}", _named(one["made_up_by"]),
            )
        )  # fmt: skip
    columns = ("parameter", "verdict", "interval", "of range", "std. error", "rise mm", "made up for by")
    tables.table("Profiles: the others re-fitted", columns, rows)
    if found["local"]["jumps"]:
        tables.console.print(
            f"The motion changes into another kind within a step of {', '.join(found['local']['jumps'])}; slopes "
            f"there are of the other side alone.",
            soft_wrap=True,
        )
    directions = found["local"]["directions"]
    shown = directions[:_SLOPPY] + directions[_SLOPPY:][-_STIFF:]
    tables.table(
        f"Directions, the sloppiest first (independent numbers: {found['local']['effective_count']:.0f})",
        ("mm over the range", "parameters"),
        [(f"{1e3 * one['slope']:.2f}", _named(one["parameters"])) for one in shown],
    )


def _named(moves: Mapping[str, float]) -> str:
    first = list(moves.items())[:_TOLD]
    more = f" and {len(moves) - _TOLD} more" if len(moves) > _TOLD else ""
    return ", ".join(f"{name} {move:+.2f}" for name, move in first) + more or "–"
