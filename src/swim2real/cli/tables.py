"""Tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

console = Console(highlight=False)
_TEXTS = ("driven by", "finding")  # columns of words


def millimeters(value: float | None) -> str:
    """A length or speed in thousandths, a dash for None."""
    return "–" if value is None else f"{1e3 * value:.1f}"


def degrees(value: float | None) -> str:
    """An angle in degrees, a dash for None."""
    return "–" if value is None else f"{math.degrees(value):.1f}"


def number(value: float | None) -> str:
    """Three digits, a dash for None."""
    return "–" if value is None else f"{value:.3g}"


_LENGTHS = (
    ("aligned marker error", "aligned_marker_error"),
    ("  shape", "shape_error"),
    ("  progress (thrust and drag)", "progress_error"),
    ("static offset (registration)", "static_offset"),
)
_PER_TRIAL = (
    ("beat Hz", "frequency", "{:.3f}".format),
    ("v real", "velocity_real", millimeters),
    ("v sim", "velocity_simulated", millimeters),
    (None, "marker_error", millimeters),  # of swims the paper's
    ("aligned", "aligned_marker_error", millimeters),
    ("shape", "shape_error", millimeters),
    ("heading deg", "heading_error", degrees),
    ("progress", "progress_error", millimeters),
    ("offset", "static_offset", millimeters),
)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Prints a table whose first column is text and whose others are numbers."""
    out = Table(
        title=escape(title), title_justify="left", title_style="bold",
        box=SIMPLE_HEAD, padding=(0, 1), collapse_padding=True, pad_edge=False,
    )  # fmt: skip
    for i, column in enumerate(columns):
        out.add_column(column, justify="left" if i == 0 or column in _TEXTS else "right", overflow="fold")
    for row in rows:
        out.add_row(*row)
    console.print(out)


def figures(content: Mapping[str, Any], title: str) -> None:
    """Prints every figure of `evaluate`, overall and per trial; of swims and recordings what there is of it."""
    trials: Mapping[str, Mapping[str, Any]] = content["trials"]
    there = next(iter(trials.values()))
    swims = "aligned_marker_error" in content
    rows = [("marker error (paper's Eq. 1)" if swims else "marker error", millimeters(content["marker_error"]) + " mm")]
    if "sensor_errors" in content:
        rows.insert(0, ("playback error (markers and sensors)", millimeters(content["loss"]) + " mm"))
    rows += [(label, millimeters(content[key]) + " mm") for label, key in _LENGTHS if key in content]
    if swims:
        added = content["unweighted_error"] - content["aligned_marker_error"] + 0.0
        rows.append(("lost tracks would add", millimeters(added) + " mm"))
    if "velocity_error" in content:
        rows.append(("velocity error", millimeters(content["velocity_error"]) + " mm/s"))
    if "heading_error" in content:
        rows.append(("heading error", degrees(content["heading_error"]) + " deg"))
    rows += [(f"{name} (own unit)", number(error)) for name, error in content.get("sensor_errors", {}).items()]
    rows.append(("left out (lost markers)", f"{100 * content['left_out_share']:.1f} %"))
    table(title, ("figure", "value"), rows)
    columns = [column for column in _PER_TRIAL if column[1] in there]
    sensors = list(there.get("sensor_errors", {}))
    table(
        "Per trial [mm, mm/s]",
        ("trial", *(header or ("Eq. 1" if swims else "error") for header, _, _ in columns), *sensors, "out"),
        [
            (
                name, *(shown(t[key]) for _, key, shown in columns),
                *(number(t["sensor_errors"][sensor]) for sensor in sensors), f"{100 * t['left_out_share']:.0f} %",
            )
            for name, t in trials.items()
        ],
    )  # fmt: skip
    for name, t in trials.items():
        if t["divergence"]:
            console.print(f"{name}: {t['divergence']}")


def marker_errors(content: Mapping[str, Any], names: Sequence[str]) -> None:
    """Prints what each marker adds to the loss: of swims the aligned error, of recordings the error."""
    key = "aligned_marker_errors" if "aligned_marker_error" in content else "marker_errors"
    table(
        "Aligned error per marker [mm]" if key == "aligned_marker_errors" else "Error per marker [mm]",
        ("trial", *names),
        [(n, *(millimeters(e) for e in t[key])) for n, t in content["trials"].items()],
    )


def sensitivities(found: Sequence[Mapping[str, Any]]) -> None:
    """Prints each parameter's effect on the loss."""
    table(
        "Effect on the loss of a tenth of a parameter's range [mm]",
        ("parameter", "down", "up", "speed", "verdict"),
        [
            (
                s["name"], millimeters(s["lower"]), millimeters(s["upper"]),
                "–" if s["speed"] is None else f"{100 * s['speed']:+.1f} %", s["verdict"],
            )
            for s in found
        ],
    )  # fmt: skip
