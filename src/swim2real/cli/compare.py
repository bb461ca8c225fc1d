"""`compare`: methods against methods."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import ComparisonSettings, VlmAccess
from swimbase.errors import ArgumentError

if TYPE_CHECKING:
    from swim2real.comparison import ComparisonResults


def compare(
    reference: Positional[opt.Reference], settings: ComparisonSettings, access: VlmAccess, *, out: Path,
    robot: opt.CalibratedRobot = "fish", json: opt.Json = False, quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Compare methods: each with every seed, under every protocol, with the same budget.

    Reads a reference; writes a folder with plan.json, a run folder per run, results.json (all that tables and figures
    need) and results.csv (one line per run). Says first how many runs there are and about how long they take. Ctrl-C
    leaves everything usable, the results and pages of finished runs included; the same command continues. With more
    methods, seeds or protocols, or a higher budget, it adds to the existing results. Exits with 1 if a run failed; the
    others are finished all the same.

    Args:
        settings: What is compared.
        access: Access to VLMs, for --methods line-search@PROVIDER:MODEL and the like.
        out: Folder to write.
    """
    if access.once:
        raise ArgumentError("--once is for advisor files, which a comparison can't wait for")
    from swim2real import api
    from swim2real.cli.comparison_files import write_files, write_theory
    from swim2real.cli.progress import comparison_shown
    from swim2real.comparison import load_results
    from swim2real.comparison.results import RESULTS
    from swim2real.robots import load_robot
    from swim2real.trials import load_reference

    body, trials = load_robot(robot), load_reference(reference)
    try:
        with comparison_shown(quiet or json) as show:
            results = api.compare(
                trials, body, settings, out, source=str(reference), access=access,
                on_progress=show,
            )  # fmt: skip
    except KeyboardInterrupt:
        if (out / RESULTS).is_file() and (results := load_results(out)).runs:
            write_files(out, results)
            count = len(results.runs) + len(results.missing)
            tell(f"{len(results.runs)} of {count} runs are in '{out / RESULTS}' and its pages")
        tell(f"interrupted; '{out}' is usable as it is, the same command goes on")
        return 1
    write_theory(out, trials, body)
    written = write_files(out, results) if results.runs else []
    if json:
        say_json(results.as_dict())
    else:
        _print(results)
        say(f"Results: {out / 'results.csv'}, {', '.join(str(path) for path in written if path.suffix != '.png')}")
    for sentence in _grouped(results.missing):
        tell(f"{sentence}")
    return 1 if results.missing else 0


def _print(results: ComparisonResults) -> None:
    from swim2real.cli import tables
    from swim2real.comparison.statistics import method_statistics
    from swim2real.comparison.tables import paper_table

    for protocol in results.protocols:
        if methods := method_statistics(results, protocol):
            made = paper_table(methods)
            rows = [(name, *(cell.text + "*" * cell.is_best for cell in cells)) for name, cells in made.rows]
            tables.table(made.title, made.columns, rows)
            say(made.note)


def _grouped(missing: Mapping[str, str]) -> list[str]:
    """One sentence for all runs that failed for the same reason."""
    keys: dict[str, list[str]] = {}
    for key, reason in missing.items():
        keys.setdefault(reason, []).append(key)
    return [
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''} failed: {reason}"
        for reason, names in keys.items()
    ]
