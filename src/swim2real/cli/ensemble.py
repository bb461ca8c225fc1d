"""`ensemble`."""

from __future__ import annotations

import json
import sys

from rich.console import Console

from swim2real.calibration.ensemble import make_ensemble, write_ensemble
from swim2real.calibration.reopened import reopen
from swim2real.cli import tables
from swim2real.cli.calibrate import threads
from swim2real.cli.interruption import noted_interrupts
from swim2real.cli.study_arguments import Ensemble
from swim2real.cli.subject import robot_for
from swim2real.errors import ArgumentError
from swim2real.settings import EnsembleSettings
from swim2real.trials import load_reference


def ensemble(a: Ensemble) -> int:
    """Gathers near-best parameter sets of runs."""
    settings = EnsembleSettings(a.within, a.count, a.evaluations, a.seed)
    if not a.out.resolve().parent.is_dir():
        raise ArgumentError(f"--out is '{a.out}'; its folder is not there, make it first")
    reference = load_reference(a.reference)
    runs = [reopen(path, reference, robot_for(path), threads(a.threads)) for path in a.runs]
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    try:
        with noted_interrupts() as asked:

            def told(evaluations: int, most: int, found: int) -> None:
                if not a.quiet:
                    console.print(f"{evaluations:5d}/{most}  {found} near-best sets")
                if asked():
                    raise KeyboardInterrupt

            content = make_ensemble(runs, settings, told)
    except KeyboardInterrupt:
        print("swim2real: interrupted; nothing was written", file=sys.stderr)
        return 1
    write_ensemble(a.out, content)
    members = content["members"]
    if len(members) < a.count:
        print(
            f"swim2real: warning: only {len(members)} sets are within {a.within:g} times the lowest loss; "
            f"raise --evaluations or --within, or give more runs",
            file=sys.stderr,
        )
    if a.json:
        print(json.dumps(content, indent=2))
        return 0
    worst = max(member["loss"] for member in members)
    tables.table(
        f"{len(members)} parameter sets, {1e3 * content['best_loss']:.2f} to {1e3 * worst:.2f} mm",
        ("parameter", "5 %", "median", "95 %", "min", "max", "unit"),
        [
            (name, *(f"{one[key]:.3g}" for key in ("p5", "median", "p95", "min", "max")), one["unit"])
            for name, one in content["ranges"].items()
        ],
    )
    tables.console.print(f"Written: {a.out}", soft_wrap=True)
    return 0
