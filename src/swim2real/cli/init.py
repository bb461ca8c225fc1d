"""`init`."""

from __future__ import annotations

from swim2real.cli.robot_arguments import Init
from swim2real.cli.tables import console
from swim2real.errors import ArgumentError
from swim2real.pipeline.drafting import draft_robot, write_draft


def init(a: Init) -> int:
    """Writes a robot file for a model."""
    out = a.out or a.model.with_suffix(".toml")
    if out.suffix != ".toml":
        raise ArgumentError(f"--out is '{out}'; a robot file ends in .toml")
    if out.exists() and not a.force:
        raise ArgumentError(f"'{out}' is there; give another --out, or --force to write over it")
    draft = draft_robot(a.model)
    write_draft(draft, a.model, out)
    calibrated = draft.calibrated
    console.print(
        f"{out}: {len(draft.markers)} markers, {len(calibrated)} parameters ({', '.join(calibrated)}), and "
        f"{len(draft.candidates) - len(calibrated)} more as comments. Edit it, then: swim2real check {out}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
    return 0
