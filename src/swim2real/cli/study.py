"""`identify` and `ensemble`: studies of runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swim2real.cli.options import Positional
from swim2real.cli.terminal import say, say_json, tell
from swim2real.errors import ArgumentError
from swim2real.settings import EnsembleSettings, IdentifiabilitySettings, all_cores

_SLOPPY, _STIFF = 5, 2  # directions that are printed
_NAMED = 3  # parameters that are named in a cell


def identify(
    run: Positional[Path], settings: IdentifiabilitySettings, *, reference: Path, robot: str | None = None,
    again: bool = False, threads: int = 0, json: bool = False, quiet: bool = False,
) -> int:  # fmt: skip
    """Report which parameters the trials determine at a run's best fit, and which compensate for one another.

    Improves the fit by a few steps, measures its neighborhood, then fixes each parameter at values across its range and
    refits the others. Reads a run folder and its reference; writes identifiability.json, and the values at the lowest
    loss as identified.json, into the run folder. Takes up to about 1400 evaluations for the fish's 16 parameters,
    mostly half of that: some minutes. Ctrl-C keeps finished work; the same command continues.

    Args:
        run: Run folder.
        settings: What decides the result.
        reference: Folder with the real trials that the run was made with.
        robot: Robot file, if it has moved since the run was written.
        again: Start again even if there is a study.
        threads: Swims simulated in parallel; 0 for all cores. Results don't depend on it.
        json: Print JSON in SI units.
        quiet: Print no progress.
    """
    from swim2real.cli.subject import robot_for
    from swim2real.cli.tables import progress_console
    from swim2real.identification.finished_run import reopen
    from swim2real.identification.identifiability import IDENTIFIED, StudyProgress
    from swim2real.identification.identifiability import identify as study
    from swim2real.interruption import Interruption
    from swim2real.trials import load_reference

    opened = reopen(run, load_reference(reference), robot_for(run, robot), all_cores(threads))
    console = progress_console()
    try:
        with Interruption() as interruption:

            def show(progress: StudyProgress) -> None:
                if not quiet:
                    line = f"{progress.evaluations:5d} of at most {progress.most}  {progress.stage}"
                    console.print(line if progress.finished is None else f"{line}: {progress.finished['verdict']}")
                interruption.check()

            content = study(opened, settings, again, show)
    except KeyboardInterrupt:
        tell(f"interrupted; what is done is kept in '{run}', the same command goes on")
        return 1
    if json:
        say_json(content)
    else:
        _print(content)
        if content["local"].get("starts_left_out"):
            say(
                "The standard errors leave out that the start is taken from the frames, because playbacks diverge with "
                "noise like the residual; they are too small, so go by the intervals."
            )
        say(
            f"The values at the lowest loss: {run / IDENTIFIED}; export-model, evaluate and train take this file in "
            f"place of the run."
        )
    return 0


def ensemble(
    runs: Positional[tuple[Path, ...]], settings: EnsembleSettings, *, reference: Path, out: Path,
    robot: str | None = None, threads: int = 0, json: bool = False, quiet: bool = False,
) -> int:  # fmt: skip
    """Collect parameter sets that fit nearly as well as the best, as ranges for domain randomization.

    Reads run folders (records, and studies by identify) and their reference; evaluates more sets around them; writes
    one JSON file with the sets and each parameter's range. Takes --evaluations, and two more per parameter.

    Args:
        runs: Run folders of one robot, protocol and reference.
        settings: What decides the result.
        reference: Folder with the real trials that the runs were made with.
        out: File to write.
        robot: Robot file, if it has moved since the runs were written.
        threads: Swims simulated in parallel; 0 for all cores. Results don't depend on it.
        json: Print the file's content.
        quiet: Print no progress.
    """
    from swim2real.cli import tables
    from swim2real.cli.subject import robot_for
    from swim2real.identification.ensemble import make_ensemble, write_ensemble
    from swim2real.identification.finished_run import reopen
    from swim2real.interruption import Interruption
    from swim2real.trials import load_reference

    if not out.resolve().parent.is_dir():
        raise ArgumentError(f"--out is '{out}'; its folder is not there, make it first")
    trials = load_reference(reference)
    opened = [reopen(path, trials, robot_for(path, robot), all_cores(threads)) for path in runs]
    console = tables.progress_console()
    try:
        with Interruption() as interruption:

            def show(evaluations: int, most: int, near_best: int) -> None:
                if not quiet:
                    console.print(f"{evaluations:5d}/{most}  {near_best} near-best sets")
                interruption.check()

            content = make_ensemble(opened, settings, show)
    except KeyboardInterrupt:
        tell("interrupted; nothing was written")
        return 1
    write_ensemble(out, content)
    members = content["members"]
    if len(members) < settings.count:
        tell(
            f"warning: only {len(members)} sets are within {settings.within:g} times the lowest loss; "
            f"raise --evaluations or --within, or give more runs"
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


def _print(content: Mapping[str, Any]) -> None:
    """The verdicts of a study of identifiability."""
    from swim2real.cli import tables

    start, fit, lowest = (1e3 * content[key]["loss"] for key in ("start", "fit", "lowest"))
    say(
        f"Loss: {start:.2f} mm at the run's best, {fit:.2f} mm after some more steps, {lowest:.2f} mm at the lowest "
        f"that was seen; a rise of {1e3 * content['local']['rise']:.2f} mm counts."
    )
    rows: list[tuple[str, ...]] = []
    errors = content["local"]["standard_errors"]
    for name, profile in content["profiles"].items():
        error = errors[name]["cube"]
        low, high = profile["values"]
        rows.append(
            (
                name, profile["verdict"], f"{low:.3g} to {high:.3g}",
                f"{100 * (profile['interval'][1] - profile['interval'][0]):.0f} %",
                "none" if error is None else "> 100 %" if error > 1 else f"{100 * error:.1f} %",
                f"{1e3 * profile['largest_rise']:.1f}", _named(profile["made_up_by"]),
            )
        )  # fmt: skip
    columns = ("parameter", "verdict", "interval", "of range", "std. error", "rise mm", "made up for by")
    tables.table("Profiles: the others re-fitted", columns, rows)
    if content["local"]["jumps"]:
        say(
            f"The motion changes into another kind within a step of {', '.join(content['local']['jumps'])}; slopes "
            f"there are of the other side alone."
        )
    directions = content["local"]["directions"]
    shown = directions[:_SLOPPY] + directions[_SLOPPY:][-_STIFF:]
    tables.table(
        f"Directions, the sloppiest first (independent numbers: {content['local']['effective_count']:.0f})",
        ("mm over the range", "parameters"),
        [(f"{1e3 * direction['slope']:.2f}", _named(direction["parameters"])) for direction in shown],
    )


def _named(moves: Mapping[str, float]) -> str:
    first = list(moves.items())[:_NAMED]
    more = f" and {len(moves) - _NAMED} more" if len(moves) > _NAMED else ""
    return ", ".join(f"{name} {move:+.2f}" for name, move in first) + more or "–"
