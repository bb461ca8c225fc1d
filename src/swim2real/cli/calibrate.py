"""`calibrate` and `demo`: a run from its settings to its report."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import CalibrationSettings, IdentifiabilitySettings, VlmAccess, expand_seeds
from swimbase.errors import RunError

if TYPE_CHECKING:
    from swim2real.calibration import Outcome
    from swim2real.cli.progress import RunCallbacks
    from swim2real.robots.robot import Sensor

MOST_LINES = 10  # on lost tracks, before they are reported in a line per trial


def calibrate(
    reference: Positional[opt.Reference], settings: CalibrationSettings, access: VlmAccess, *, out: Path,
    robot: opt.CalibratedRobot = "fish", sensitivity: bool = False, resume: opt.Resume = False,
    seeds: tuple[int | str, ...] = (), json: opt.Json = False, quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Find simulator parameters that make simulated trials match real ones.

    Reads a reference (a folder with reference.json, or with published CSVs) and writes a run folder: settings.json,
    record.jsonl (one line per evaluation), best.json (the parameters), outcome.json, an array file of the best trials
    and report.html. An evaluation takes under a second on two cores. Ctrl-C leaves a usable run; --resume continues it.

    Args:
        settings: What decides the result.
        access: Access to VLMs, for --advisor PROVIDER:MODEL and files.
        out: Run folder to write.
        sensitivity: Also measure each parameter's effect on the loss at the end: two evaluations per parameter, outside
            the budget.
        seeds: Numbers and ranges, as for compare: one run per seed, in folders beside --out; the best one is copied to
            --out.
    """
    numbers = expand_seeds(seeds) if seeds else [settings.seed]
    from swim2real import pipeline
    from swim2real.robots import load_robot
    from swim2real.trials import load_reference

    settings = pipeline.as_replayed(settings)
    body, trials = load_robot(robot), load_reference(reference)

    def run(chosen: CalibrationSettings, folder: Path, resume: bool) -> Outcome | None:
        def work(callbacks: RunCallbacks) -> Outcome:
            return pipeline.calibrate(
                trials, body, chosen, folder, source=str(reference), resume=resume,
                sensitivity=sensitivity, access=access, on_progress=callbacks.progress, on_advisor=callbacks.advisor,
                on_warning=_warn if chosen.seed == numbers[0] else None,
            )  # fmt: skip

        return _watched(work, None if chosen.finish else chosen.budget, folder, quiet)

    outcome = _best_of(numbers, settings, out, resume, run) if seeds else run(settings, out, resume)
    return 1 if outcome is None else _told(outcome, out, quiet, json)


def _warn(line: str) -> None:
    tell(f"warning: {line}")


def _best_of(
    seeds: Sequence[int], settings: CalibrationSettings, out: Path, resume: bool,
    run: Callable[[CalibrationSettings, Path, bool], Outcome | None],
) -> Outcome | None:  # fmt: skip
    """Makes a run per seed beside a folder, and puts a copy of the best into it; None when it is interrupted.

    The copy lies as deep as the runs, so that paths that are relative to them hold.
    """
    from swim2real.calibration import RunFolder
    from swimbase.store import LOCK, whole_folder

    if RunFolder(out).exists and not resume:
        raise RunError(f"'{out}' holds a run already; go on with --resume or choose another folder")
    ends: list[tuple[float, Path, Outcome]] = []
    for seed in seeds:
        folder = out.with_name(f"{out.name}-seed-{seed}")
        outcome = run(replace(settings, seed=seed), folder, resume and RunFolder(folder).exists)
        if outcome is None:
            return None
        loss = inf if outcome.fit.loss is None else outcome.fit.loss  # without one where the simulation diverged
        ends.append((loss, folder, outcome))
        tell(f"seed {seed}: {1e3 * loss:.2f} mm in '{folder}'")
    _, best, outcome = min(ends, key=lambda end: end[0])
    with whole_folder(out) as part:
        shutil.copytree(best, part, dirs_exist_ok=True, ignore=shutil.ignore_patterns(LOCK))
    tell(f"the best is a copy of '{best}'")
    return outcome


def demo(
    *, out: Path = Path("demo-out"), budget: int | None = None, seed: int = 2, full: bool = False,
    resume: opt.Resume = False, quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Run the whole pipeline on an embedded example: no data, no network, no key.

    Tracks the markers of a 'real' fish with hidden parameters in the films that come with it, calibrates, evaluates on
    a held-out trial, draws intervals in four rounds, and writes the report.

    Args:
        out: Folder to write.
        budget: Most simulation evaluations; by default the search goes on until it is done.
        seed: Decides the first point and every random choice.
        full: Take all eight films instead of four.
    """
    from swim2real.api import open_run
    from swim2real.cli import tables
    from swim2real.cli.progress import films_shown
    from swim2real.cli.study import study_shown
    from swim2real.demo import (
        DemoCallbacks,
        demo_settings,
        fit,
        hidden_values,
        track,
    )
    from swim2real.identification.finished_run import reopen
    from swim2real.identification.identifiability import outdated
    from swim2real.robots.fish import FISH
    from swim2real.trials import load_reference

    began = time.monotonic()
    settings = demo_settings(budget, seed)
    with films_shown(quiet) as (on_frame, on_film):
        callbacks = DemoCallbacks((lambda text: None) if quiet else say, on_frame, on_film)
        track(out, full=full, resume=resume, callbacks=callbacks)

    def work(callbacks: RunCallbacks) -> Outcome:
        return fit(out, settings, callbacks.progress)

    outcome = _watched(work, budget, out / "run", quiet)
    study = None
    if outcome is not None:
        opened = reopen(out / "run", load_reference(out / "reference"), FISH)
        study = study_shown(opened, IdentifiabilitySettings(rounds=4), outdated(opened), quiet)
    code = 1 if outcome is None else _told(outcome, out / "run", quiet, False)
    if not quiet and code == 0:
        intervals = {name: one.interval_95 for name, one in study.intervals.items()} if study else {}
        tables.truth(open_run(out / "run").values, hidden_values(), intervals)
    if not quiet:
        say(f"The demo took {time.monotonic() - began:.0f} s. Overlays: {out / 'reference' / 'tracks'}")
    return code


def _watched(work: Callable[[RunCallbacks], Outcome], budget: int | None, folder: Path, quiet: bool) -> Outcome | None:
    """Does the work of a run with its progress shown; None when it is interrupted, which is reported."""
    from swim2real.calibration import RunFolder
    from swim2real.cli.progress import run_shown

    try:
        with run_shown(budget, quiet) as callbacks:
            return work(callbacks)
    except KeyboardInterrupt:
        if not RunFolder(folder).exists:
            raise
        outcome = RunFolder(folder).outcome()
        said = f" {outcome.verdict.sentence}." if outcome is not None and outcome.verdict is not None else ""
        tell(f"interrupted; '{folder}' is kept as it is, --resume goes on with it.{said}")
        return None


def _told(outcome: Outcome, folder: Path, quiet: bool, as_json: bool) -> int:
    """Prints the outcome of a run and its warnings, and writes the report."""
    from swim2real.api import run_robot
    from swim2real.calibration import RunFolder
    from swim2real.cli import tables
    from swim2real.report import read_run, warnings, write_report
    from swim2real.report.tables import parameter_rows

    reported = read_run(folder, run_robot(RunFolder(folder)))
    if as_json:
        say_json(outcome.to_json())
    elif not quiet:
        tables.verdict(reported.verdict)
        tables.parameters(parameter_rows(reported), outcome.ranges)
        _print(outcome, reported.robot.trials.sensors)
    if not as_json and not quiet:
        for line in reported.standing:
            say(f"{line[0].upper()}{line[1:]}.")
    for warning in warnings(reported):
        tell(f"warning: {warning}")
    page = write_report(folder, reported.robot)
    if not as_json and not quiet:
        say(f"Parameters: {folder / 'best.json'}   Report: {page}")
    return 0


def _print(outcome: Outcome, sensors: Sequence[Sensor]) -> None:
    from swim2real.cli import tables

    lost = {name: trial for name, trial in outcome.trials.items() if not trial.usable}
    lines = [(name, line) for name, trial in lost.items() for line in trial.findings]
    if len(lines) > MOST_LINES:
        title = "Lost tracks (left out by weights): frames for which each marker is lost [%]"
        rows = [((name,), trial.lost_share, ()) for name, trial in lost.items()]
        tables.by_marker(title, outcome.marker_names, ("trial",), (), rows, tables.percent)
    elif lines:
        tables.table("Lost tracks (left out by weights)", ("trial", "finding"), lines)
    tables.figures(outcome.fit, "Fitted trials", sensors)
    if outcome.held_out is not None:
        tables.figures(outcome.held_out, "Held-out trials", sensors)
    if outcome.sensitivity:
        tables.sensitivities(outcome.sensitivity)
