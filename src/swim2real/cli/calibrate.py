"""`calibrate` and `demo`: a run from its settings to its report."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, cast

from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import word
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import CalibrationSettings, IdentifiabilitySettings, VlmAccess, expand_seeds
from swimbase.errors import RunError

if TYPE_CHECKING:
    from swim2real.calibration import Outcome
    from swim2real.cli.progress import RunCallbacks
    from swim2real.report.run import ReportedRun
    from swim2real.robots.robot import Sensor

_DECISIVE = (  # settings that a run goes on with
    "protocol", "start", "horizon", "pieces", "advisor", "seed", "first", "starts", "scale", "max_steps", "probes",
    "hold_out",
)  # fmt: skip


def calibrate(
    reference: Positional[opt.Reference], settings: CalibrationSettings, access: VlmAccess, *, out: Path,
    robot: opt.CalibratedRobot = "fish", sensitivity: bool = False, resume: opt.Resume = False,
    seeds: tuple[int | str, ...] = (), json: opt.Json = False, quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
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
    if outcome is None:
        return 1
    if json:
        say_json(outcome.to_json())
        _written(out)
        return 0
    again = _again(settings, reference, robot, out)
    return _end(out, lambda run: _next(run, out, reference, robot, again), verbose, sensitivity)


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
    resume: opt.Resume = False, quiet: opt.Quiet = False, verbose: opt.Verbose = False,
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
    if outcome is not None:
        opened = reopen(out / "run", load_reference(out / "reference"), FISH)
        study = study_shown(opened, IdentifiabilitySettings(rounds=4), outdated(opened), quiet)
        if study is None:
            return 1
    if not quiet:
        tell(f"the demo took {time.monotonic() - began:.0f} s; overlays of its tracks: {out / 'reference' / 'tracks'}")
    run = out / "run"
    return 1 if outcome is None else _end(run, lambda _: f"swim2real view {word(run)}", verbose, False, hidden_values())


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
        said = f": {outcome.verdict.sentence}" if outcome is not None and outcome.verdict is not None else ""
        tell(f"'{folder}' is kept as it is, --resume goes on with it{said}")
        return None


def _written(folder: Path) -> tuple[ReportedRun, Path]:
    """Writes the page of a run, and tells its warnings."""
    from swim2real.api import run_robot
    from swim2real.calibration import RunFolder
    from swim2real.report import read_run, warnings, write_report

    run = read_run(folder, run_robot(RunFolder(folder)))
    for warning in warnings(run):
        tell(f"warning: {warning}")
    return run, write_report(folder, run.robot)


def _end(
    folder: Path, following: Callable[[ReportedRun], str], verbose: bool, sensitivity: bool,
    hidden: Mapping[str, float] | None = None,
) -> int:  # fmt: skip
    """Writes the page of a run and prints its end, where that is wanted with all figures before."""
    from swim2real.cli import tables

    run, page = _written(folder)
    if verbose:
        _print_figures(run.of_best, run.robot.trials.sensors)
        say(" ".join(f"{line[0].upper()}{line[1:]}." for line in run.standing))
    if (verbose or sensitivity) and run.of_best.sensitivity:
        tables.sensitivities(run.of_best.sensitivity)
    ending(run, page, following(run), hidden)
    return 0


def ending(run: ReportedRun, page: Path, following: str, hidden: Mapping[str, float] | None = None) -> None:
    """Prints the end of a run: verdict, parameters, error, files, next command.

    Args:
        run: The run.
        page: Its page, beside the values.
        following: The next command.
        hidden: Values that were to be found, where they are known.
    """
    from swim2real.cli import tables
    from swim2real.report.tables import interval_name, parameter_rows

    tables.verdict(run.verdict)
    tables.parameters(parameter_rows(run), interval_name(run), hidden)
    best = run.of_best
    fits = {"": best.fit, " on held-out trials": best.held_out, " at the first point": run.entries[0].evidence}
    errors = [f"{tables.millimeters(fit.error)} mm{where}" for where, fit in fits.items() if fit is not None]
    say(f"{run.loss.capitalize()} {', '.join(errors)}.")
    say(f"Page: {page}   Values: {page.with_name('best.json')}")
    say(f"Next: {following}")


def _next(run: ReportedRun, out: Path, reference: Path, robot: str, again: str) -> str:
    """The command that helps most after a run."""
    if run.verdict.kind == "not finished" or (run.verdict.kind == "not usable" and run.verdict.seconds is not None):
        return again
    if run.verdict.kind == "not usable":
        return f"swim2real check {word(robot)} --reference {word(reference)}"
    if run.studied is None:
        return f"swim2real identify {word(out)} --reference {word(reference)}   # 95 % intervals"
    return f"swim2real view {word(out)}"


def _again(settings: CalibrationSettings, reference: Path, robot: str, out: Path) -> str:
    """The command that goes on with a run until it is done, with the options that it was begun with."""
    words = f"swim2real calibrate {word(reference)}{opt.for_robot(robot)}"
    usual = CalibrationSettings()
    for name in _DECISIVE:
        value = getattr(settings, name)
        if value != getattr(usual, name):
            values = cast("tuple[object, ...]", value) if isinstance(value, tuple) else (value,)
            words += f" --{name.replace('_', '-')} {' '.join(word(str(0 if one is None else one)) for one in values)}"
    return f"{words} --out {word(out)} --resume"


def _print_figures(outcome: Outcome, sensors: Sequence[Sensor]) -> None:
    """Prints all that is known of each trial."""
    from swim2real.cli import tables

    tables.figures(outcome.fit, "Fitted trials", sensors)
    if outcome.held_out is not None:
        tables.figures(outcome.held_out, "Held-out trials", sensors)
