"""`quality`."""

from __future__ import annotations

import json

from swim2real.calibration import examine, examined
from swim2real.cli import tables
from swim2real.cli.arguments import Quality
from swim2real.errors import ArgumentError
from swim2real.robots.fish import FISH
from swim2real.trials import load_reference


def quality(a: Quality) -> int:
    """Checks tracks and says what drove each trial."""
    real = examine(load_reference(a.reference), FISH)
    content = {one.trial.name: examined(one, FISH.marker_names) for one in real}
    if a.json:
        print(json.dumps(content, indent=2))
    else:
        tables.table(
            "What drove each trial",
            ("trial", "nominal Hz", "beat Hz", "±", "ratio", "phase rad", "speed mm/s", "±", "tail mm"),
            [
                (
                    name, "–" if t["nominal_frequency"] is None else f"{t['nominal_frequency']:.2f}",
                    f"{t['frequency']:.4f}", f"{t['frequency_std']:.4f}",
                    "–" if t["nominal_frequency"] is None else f"{t['frequency'] / t['nominal_frequency']:.3f}",
                    f"{t['phase']:.2f}", tables.millimeters(t["start_speed"]),
                    tables.millimeters(t["start_speed_std"]), tables.millimeters(t["amplitude"]),
                )
                for name, t in content.items()
            ],
        )  # fmt: skip
        tables.table(
            "Frames for which each marker is lost [%]",
            ("trial", *FISH.marker_names, "head ±%", "body ±%", "usable as it is"),
            [
                (
                    name, *("–" if share == 0 else f"{100 * share:.0f}" for share in t["lost_share"]),
                    f"{100 * t['head_spread']:.1f}", f"{100 * t['body_spread']:.1f}", "yes" if t["usable"] else "no",
                )
                for name, t in content.items()
            ],
        )  # fmt: skip
        for name, t in content.items():
            for line in t["findings"]:
                tables.console.print(f"{name}: {line}")
    if a.plot is not None:
        from swim2real.report import write_quality_page

        try:
            write_quality_page(real, FISH.marker_names, a.plot)
        except OSError as error:
            raise ArgumentError(f"--plot '{a.plot}' can't be written: {error.strerror or error}") from error
    return 0 if all(t["usable"] for t in content.values()) else 1
