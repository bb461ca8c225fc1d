"""`calibrate`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from swim2real.calibration import Outcome, RunFolder
from swim2real.calibration.from_rest import backward_from_rest
from swim2real.calibration.run_folder import still_falling
from swim2real.cli import tables
from swim2real.cli.arguments import Calibrate
from swim2real.cli.files import write_report
from swim2real.cli.progress import Watch, interruptible, shown
from swim2real.errors import ArgumentError
from swim2real.pipeline import run
from swim2real.robots import robot_named
from swim2real.settings import BriefingSettings, CalibrationSettings, VlmAccess
from swim2real.simulation.misfits import misplaced
from swim2real.trials import load_reference


def calibrate(a: Calibrate) -> int:
    """Runs or resumes a calibration."""
    settings = CalibrationSettings(
        method=a.method, advisor=a.advisor, protocol=a.protocol, start=a.start, budget=a.budget, seed=a.seed,
        scale=a.scale, max_steps=a.max_steps, early_stop=a.early_stop,
        horizon=horizon(a.horizon), hold_out=a.hold_out, threads=threads(a.threads),
        briefing=BriefingSettings(a.vlm.show, a.vlm.media, a.vlm.detail),
    )  # fmt: skip
    access = VlmAccess(
        a.vlm.base_url, a.vlm.key_variable, a.vlm.max_calls, a.vlm.max_cost, a.vlm.reply_tokens, a.vlm.timeout,
        a.vlm.tries, a.vlm.once,
    )  # fmt: skip
    robot = robot_named(a.robot)
    reference = load_reference(a.reference)
    far = misplaced(robot, reference)
    if far is not None:
        print(f"swim2real: warning: {far}", file=sys.stderr)

    def work(watch: Watch) -> Outcome:
        return run(
            reference, robot, settings, a.out, source=str(a.reference), resume=a.resume, sensitivity=a.sensitivity,
            access=access, on_progress=watch.progress, on_advisor=watch.advisor,
        )  # fmt: skip

    return finish(work, a.budget, a.out, a.quiet, a.json)


def threads(count: int) -> int | None:
    """None for all cores."""
    if count < 0:
        raise ArgumentError(f"--threads is {count}; it must be 0 (all cores) or above")
    return count or None


def horizon(seconds: float) -> float | None:
    """None for all of each trial."""
    if not 0 <= seconds < float("inf"):
        raise ArgumentError(f"--horizon is {seconds:g}; it must be 0 (all) or above, and finite")
    return seconds or None


def finish(work: Callable[[Watch], Outcome], budget: int, folder: Path, quiet: bool, as_json: bool) -> int:
    """Does the work of a run with its progress shown, prints the outcome, warns of it, and writes the report."""
    try:
        with shown(budget, quiet) as show, interruptible(show) as watch:
            outcome = work(watch).to_json()
    except KeyboardInterrupt:
        if not RunFolder(folder).exists:
            raise
        print(f"swim2real: interrupted; '{folder}' is usable as it is, --resume goes on with it", file=sys.stderr)
        return 1
    if as_json:
        print(json.dumps(outcome, indent=2))
    elif not quiet:
        _print(outcome)
    run = RunFolder(folder)
    for warning in (backward_from_rest(outcome.get("from_rest", {})), still_falling(run.record(), run.settings())):
        if warning:
            print(f"swim2real: warning: {warning}", file=sys.stderr)
    page = write_report(folder)
    if not as_json and not quiet:
        tables.console.print(f"Parameters: {folder / 'best.json'}   Report: {page or 'not written'}", soft_wrap=True)
    return 0


def _print(outcome: Mapping[str, Any]) -> None:
    lost = [(name, line) for name, t in outcome["trials"].items() for line in t["findings"] if not t["usable"]]
    if lost:
        tables.table("Lost tracks (left out by weights)", ("trial", "finding"), lost)
    tables.figures(outcome["fit"], "Fitted trials")
    if outcome["held_out"]:
        tables.figures(outcome["held_out"], "Held-out trials")
    if outcome["sensitivity"]:
        tables.sensitivities(outcome["sensitivity"])
