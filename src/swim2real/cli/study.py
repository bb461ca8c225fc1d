"""`identify`, `ensemble` and `next`: studies of runs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import word
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import EnsembleSettings, IdentifiabilitySettings, all_cores
from swimbase.errors import ArgumentError

if TYPE_CHECKING:
    from swim2real.identification.finished_run import FinishedRun
    from swim2real.identification.identifiability import Study
    from swim2real.identification.next_trial import JudgedTrial

_DIRECTIONS = 4  # that are printed of the best determined ones, and of the others
_NAMED = 3  # parameters that are named in a cell
_OFTEN = 5.0  # s between lines of progress


def identify(
    run: Positional[Path], settings: IdentifiabilitySettings, *, reference: opt.Reference, robot: opt.RobotOfRun = None,
    again: bool = False, anyway: opt.Anyway = False, threads: opt.Threads = 0, json: opt.Json = False,
    quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Report which parameters, and combinations of them, the trials determine, with intervals.

    Draws parameter sets that fit as well as the noise allows, from all that the run came upon: Markov chains on an
    emulator of the residual, which evaluations correct. Reads a run folder and its reference; writes
    identifiability.json, and the values at the lowest loss as identified.json, into the run folder. Takes about 350
    evaluations for the fish's 16 parameters, some two minutes. Ctrl-C keeps finished work; the same command continues.

    Args:
        run: Run folder.
        settings: What decides the result.
        again: Start again even if there is a study.
    """
    from swim2real.calibration.convergence import ends_of
    from swim2real.cli.subject import heed, robot_for
    from swim2real.identification.finished_run import reopen
    from swim2real.identification.identifiability import IDENTIFIABILITY, IDENTIFIED
    from swim2real.trials import load_reference

    studied = robot_for(run, robot)
    heed(run, anyway, "study it")
    opened = reopen(run, load_reference(reference), studied, all_cores(threads))
    begins = again or not (run / IDENTIFIABILITY).is_file()  # else it was said before, or nothing is left to simulate
    if begins and not quiet and len(ends_of(opened.folder.record(), opened.folder.outcome())) < 2:
        tell("the run has followed fewer than two starts to the end, so no parameter will count as determined; Ctrl-C, "
             "and swim2real calibrate --resume without --budget follows more")  # fmt: skip
    study = study_shown(opened, settings, again, quiet)
    if study is None:
        return 1
    if json:
        say_json(study.content())
    else:
        _print(study)
        say(
            f"The values at the lowest loss: {run / IDENTIFIED}; export-model, evaluate and train take this file in "
            f"place of the run."
        )
    return 0


def study_shown(
    run: FinishedRun, settings: IdentifiabilitySettings, again: bool, quiet: bool
) -> Study | None:  # fmt: skip
    """Studies a run with its progress shown; None when it is interrupted, which is reported."""
    from swim2real.cli.tables import progress_console
    from swim2real.identification.identifiability import StudyProgress
    from swim2real.identification.identifiability import identify as identified
    from swim2real.interruption import Interruption

    console, begun = progress_console(), time.monotonic()
    shown, before = begun - _OFTEN, -1
    try:
        with Interruption() as interruption:

            def show(progress: StudyProgress) -> None:
                nonlocal shown, before
                if before < 0:  # what an earlier call has evaluated takes no time
                    before = progress.evaluations - 1
                now, made = time.monotonic(), progress.evaluations - before
                if not quiet and ((made > 1 and now - shown > _OFTEN) or progress.evaluations == progress.most):
                    shown = now
                    left = (now - begun) / made * (progress.most - progress.evaluations)
                    console.print(
                        f"{progress.evaluations:5d}/{progress.most}  intervals, lowest {1e3 * progress.lowest:.2f} mm, "
                        f"about {left:.0f} s left"
                    )

            return identified(run, settings, again, show, interruption.check)
    except KeyboardInterrupt:
        if not quiet:
            _print_so_far(run)
        tell(f"interrupted; what is done is kept in '{run.folder.path}', swim2real identify goes on with it")
        return None


def _print_so_far(run: FinishedRun) -> None:
    """Prints an interrupted study's values of each parameter, by the slopes of what it evaluated."""
    from swim2real.cli import tables
    from swim2real.identification.identifiability import known_so_far
    from swimbase.errors import Swim2RealError

    with suppress(Swim2RealError, OSError):  # nothing is evaluated yet
        lowest, ranges = known_so_far(run)
        if not ranges:
            say(f"So far, lowest {1e3 * lowest:.2f} mm; too few evaluations to say how well parameters are known.")
            return
        rows = [(name, f"{low:.3g} to {high:.3g}") for name, (low, high) in ranges.items()]
        say(
            f"So far, lowest {1e3 * lowest:.2f} mm. The error rises by less than a tenth between, all others following:"
        )
        tables.table("", ("parameter", "fits about as well"), rows)


def ensemble(
    runs: Positional[tuple[Path, ...]], settings: EnsembleSettings, *, reference: opt.Reference, out: Path,
    robot: opt.RobotOfRun = None, json: opt.Json = False,
) -> int:  # fmt: skip
    """Collect parameter sets that fit nearly as well as the best, as ranges for domain randomization.

    Reads run folders (records, and studies by identify, which finds more of them) and their reference; writes one JSON
    file with the sets and each parameter's range.

    Args:
        runs: Run folders of one robot, protocol and reference.
        settings: What decides the result.
        out: File to write.
    """
    from swim2real.cli import tables
    from swim2real.cli.subject import robot_for
    from swim2real.identification.ensemble import make_ensemble, write_ensemble
    from swim2real.identification.finished_run import reopen
    from swim2real.trials import load_reference

    if not out.resolve().parent.is_dir():
        raise ArgumentError(f"--out is '{out}'; its folder is not there, make it first")
    trials = load_reference(reference)
    opened = [reopen(path, trials, robot_for(path, robot)) for path in runs]
    content = make_ensemble(opened, settings)
    write_ensemble(out, content)
    members = content["members"]
    if len(members) < settings.count:
        tell(
            f"warning: only {len(members)} sets are within {settings.within:g} times the lowest loss; "
            f"raise --within, run swim2real identify on the runs, or give more of them"
        )
    if json:
        say_json(content)
        return 0
    worst = max(member["loss"] for member in members)
    tables.table(
        f"{len(members)} parameter sets, {1e3 * content['best_loss']:.2f} to {1e3 * worst:.2f} mm",
        ("parameter", "5 %", "median", "95 %", "min", "max", "unit"),
        [
            (name, *(f"{values[key]:.3g}" for key in ("p5", "median", "p95", "min", "max")), values["unit"])
            for name, values in content["ranges"].items()
        ],
    )
    say(f"Written: {out}")
    return 0


def next_trial(
    run: Positional[Path], *, reference: opt.Reference, robot: opt.RobotOfRun = None, out: Path | None = None,
    anyway: opt.Anyway = False, threads: opt.Threads = 0, seed: int = 0, json: opt.Json = False,
    quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Propose the trial to film next: the one that would narrow the sets that fit the most.

    Reads a run folder that `identify` has studied, and its reference. Simulates each possible trial, another beat or
    another motion of the actuators, with 40 or more of the sets: the difference between them is what the trial would
    reveal. Writes into --out next.json with all trials, next.csv with the proposed one's commands for `deploy`, and
    next.png. Takes a minute or two. Ctrl-C prints what is known so far and writes nothing.

    Args:
        run: Run folder with a study by `identify`.
        out: Folder to write; by default `next` in the run folder.
        seed: Decides which of the sets are compared.
    """
    from motorline.commands import FISH, read_table
    from swim2real.cli.subject import heed, robot_for
    from swim2real.cli.tables import progress_console
    from swim2real.identification.finished_run import reopen
    from swim2real.identification.next_trial import COMMANDS, fitting_sets, judged_trials, write_next
    from swim2real.identification.possible_trials import possible_trials
    from swim2real.interruption import Interruption
    from swim2real.report.determined import write_chart
    from swim2real.trials import load_reference

    if seed < 0:
        raise ArgumentError(f"--seed is {seed}; it must be 0 or above")
    studied = robot_for(run, robot)
    heed(run, anyway, "use it")
    opened = reopen(run, load_reference(reference), studied, all_cores(threads))
    sets, folder, console = fitting_sets(opened), out or run / "next", progress_console()
    possible = possible_trials(opened.problem, opened.space.to_values(sets.lowest))
    judged: list[JudgedTrial] = []
    begun = time.monotonic()
    try:
        with Interruption() as interruption:
            for one in judged_trials(opened, sets, possible, seed, interruption.check):
                judged.append(one)
                left = (time.monotonic() - begun) / len(judged) * (len(possible) - len(judged))
                if not quiet:
                    said = one.reason or f"{100 * one.volume:.0f} % of the volume"
                    console.print(f"{len(judged):3d}/{len(possible)}  {one.possible.label}: {said}, {left:.0f} s left")
    except KeyboardInterrupt:
        _print_trials(judged)
        tell(f"interrupted after {len(judged)} of {len(possible)} trials; nothing is written")
        return 1
    content = write_next(folder, opened, judged)
    write_chart(folder, content["candidates"])
    if json:
        say_json(content)
        return 0
    _print_trials(judged)
    motors = "" if FISH in read_table(folder / COMMANDS).columns else " --motors MOTORS.toml"
    say(f"Its commands, without the robot first: swim2real deploy {word(folder / COMMANDS)}{motors} --dry-run")
    return 0


def _print_trials(judged: Sequence[JudgedTrial]) -> None:
    """Possible trials, the one that tells the most first."""
    from swim2real.cli import tables

    def shrunk(widths: Mapping[str, float]) -> str:
        most = sorted(widths, key=lambda name: widths[name])[:_NAMED]
        return ", ".join(f"{name} {100 * widths[name]:.0f} %" for name in most)

    told = sorted((one for one in judged if not one.reason), key=lambda one: one.volume)
    rows = [(one.possible.label, f"{100 * one.volume:.0f} %", shrunk(one.widths)) for one in told]
    if rows:
        tables.table("What would be left", ("trial", "of the volume", "of the widths that shrink most"), rows)
    left_out = [one for one in judged if one.reason]
    if left_out:
        names = ", ".join(one.possible.label for one in left_out)
        say(f"Left out: {names}; of the first, {left_out[0].reason}.")


def _print(study: Study) -> None:
    """The verdicts of a study of identifiability."""
    from swim2real.cli import tables
    from swim2real.identification.identifiability import IDENTIFIED

    start, lowest = 1e3 * study.start.loss, 1e3 * study.lowest.loss
    say(f"Lowest loss: {lowest:.2f} mm.")
    if lowest < start:
        say(
            f"That is a better fit than the run's, {start:.2f} mm, by {100 * (1 - lowest / start):.0f} %: the "
            f"intervals are about it, and its values are in {IDENTIFIED}."
        )
    if study.doubt:
        say(f"{study.doubt}.")
    rows = [
        (name, one.known, "{:.3g} to {:.3g}".format(*one.interval_95), f"{100 * one.width:.0f} %")
        for name, one in study.intervals.items()
    ]  # fmt: skip
    tables.table("Sets that fit", ("parameter", "known", "95 % interval", "of range"), rows)
    found = study.directions
    shown = found[:_DIRECTIONS] + found[_DIRECTIONS:][-_DIRECTIONS:]
    tables.table(
        f"Combinations, the best determined first ({study.determined:.1f} of {len(rows)} are determined)",
        ("spread, of the range", "parameters"),
        [(f"{100 * direction.spread:.1f} %", _named(direction.parameters)) for direction in shown],
    )


def _named(moves: Mapping[str, float]) -> str:
    first = list(moves.items())[:_NAMED]
    more = f" and {len(moves) - _NAMED} more" if len(moves) > _NAMED else ""
    return ", ".join(f"{name} {move:+.2f}" for name, move in first) + more or "–"
