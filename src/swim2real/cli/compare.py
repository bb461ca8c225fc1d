"""`compare`."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence

from swim2real.cli.calibrate import horizon
from swim2real.cli.compare_arguments import Compare
from swim2real.cli.compare_progress import comparison_shown
from swim2real.cli.comparison_files import write_files, write_theory
from swim2real.comparison import ComparisonResults, contestants, make_plan, table_methods
from swim2real.comparison import compare as run
from swim2real.comparison.statistics import method_statistics
from swim2real.comparison.tables import as_text, paper_table
from swim2real.errors import ArgumentError
from swim2real.robots import robot_named
from swim2real.settings import BriefingSettings, VlmAccess
from swim2real.trials import load_reference


def compare(a: Compare) -> int:
    """Runs a comparison or goes on with it; 1 when a run failed."""
    if a.workers < 0:
        raise ArgumentError(f"--workers is {a.workers}; it must be 0 (as many as there are cores) or above")
    if a.cluster is not None and a.workers:
        raise ArgumentError(f"--workers {a.workers} is for this machine; leave it out with --cluster {a.cluster}")
    if a.vlm.once:
        raise ArgumentError("--once is for advisor files, which a comparison can't wait for")
    seeds, robot = chosen_seeds(a.seeds), robot_named(a.robot)
    methods = contestants(a.methods or table_methods(robot), a.scale)
    access = VlmAccess(
        a.vlm.base_url, a.vlm.key_variable, a.vlm.max_calls, a.vlm.max_cost, a.vlm.reply_tokens, a.vlm.timeout,
        a.vlm.tries,
    )  # fmt: skip
    reference = load_reference(a.reference)
    plan = make_plan(
        methods, seeds, a.protocols, a.budget, reference, robot, leave_one_out=a.leave_one_out,
        horizon=horizon(a.horizon), briefing=BriefingSettings(a.vlm.show, a.vlm.media, a.vlm.detail),
        source=str(a.reference), start=a.start,
    )  # fmt: skip
    try:
        with comparison_shown(a.quiet or a.json) as show:
            results = run(
                plan, reference, robot, a.out, workers=a.workers or None, cluster=a.cluster, access=access,
                on_progress=show,
            )  # fmt: skip
    except KeyboardInterrupt:
        print(f"swim2real: interrupted; '{a.out}' is usable as it is, the same command goes on", file=sys.stderr)
        return 1
    write_theory(a.out, reference, robot)
    written = write_files(a.out, results) if results.runs else []
    if a.json:
        print(json.dumps(results.as_dict(), indent=2))
    elif not a.quiet:
        _print(results)
        print(f"Results: {a.out / 'results.csv'}, {', '.join(str(path) for path in written if path.suffix != '.png')}")
    for sentence in _grouped(results.missing):
        print(f"swim2real: {sentence}", file=sys.stderr)
    return 1 if results.missing else 0


def chosen_seeds(words: Sequence[str]) -> list[int]:
    """Seeds from numbers and ranges such as 0:5.

    Raises:
        ArgumentError: A word is neither.
    """
    found: list[int] = []
    for word in words:
        begin, colon, end = word.partition(":")
        numbers = (begin, end) if colon else (begin,)
        if not all(number.isdecimal() for number in numbers):
            raise ArgumentError(f"--seeds has '{word}'; write numbers from 0 on, and ranges such as 0:5")
        if colon and int(end) <= int(begin):
            raise ArgumentError(f"--seeds has '{word}', which is empty; 0:5 is 0 1 2 3 4")
        found += range(int(begin), int(end)) if colon else [int(begin)]
    if not found:
        raise ArgumentError("--seeds is empty; write numbers from 0 on, and ranges such as 0:5")
    return found


def _print(results: ComparisonResults) -> None:
    for protocol in results.protocols:
        if any(run.protocol == protocol and run.held_out is None for run in results.runs):
            print(as_text(paper_table(method_statistics(results, protocol))))


def _grouped(missing: Mapping[str, str]) -> list[str]:
    """One sentence for all runs that failed of the same."""
    keys: dict[str, list[str]] = {}
    for key, why in missing.items():
        keys.setdefault(why, []).append(key)
    return [f"{of[0]}{f' and {len(of) - 1} more' if len(of) > 1 else ''} failed: {why}" for why, of in keys.items()]
