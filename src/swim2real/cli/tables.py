"""Tables for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

console = Console(highlight=False)


def millimeters(value: float | None) -> str:
    """A length or speed in thousandths, a dash for None."""
    return "–" if value is None else f"{1e3 * value:.1f}"


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Prints a table whose first column is text and whose others are numbers."""
    out = Table(
        title=escape(title), title_justify="left", title_style="bold",
        box=SIMPLE_HEAD, padding=(0, 1), collapse_padding=True, pad_edge=False,
    )  # fmt: skip
    for i, column in enumerate(columns):
        out.add_column(column, justify="left" if i == 0 or column == "finding" else "right", overflow="fold")
    for row in rows:
        out.add_row(*row)
    console.print(out)


def figures(content: Mapping[str, Any], title: str) -> None:
    """Prints every figure of `evaluate`, overall and per trial."""
    lines = [
        ("marker error (paper's Eq. 1)", "marker_error"),
        ("aligned marker error", "aligned_marker_error"),
        ("  shape", "shape_error"),
        ("  progress (thrust and drag)", "progress_error"),
        ("static offset (registration)", "static_offset"),
    ]
    rows = [(label, millimeters(content[key]) + " mm") for label, key in lines]
    rows.append(
        (
            "lost tracks would add",
            millimeters(content["unweighted_error"] - content["aligned_marker_error"] + 0.0) + " mm",
        )
    )
    rows.append(("velocity error", millimeters(content["velocity_error"]) + " mm/s"))
    rows.append(("left out (lost markers)", f"{100 * content['left_out_share']:.1f} %"))
    table(title, ("figure", "value"), rows)
    table(
        "Per trial [mm, mm/s]",
        ("trial", "beat Hz", "v real", "v sim", "Eq. 1", "aligned", "shape", "progress", "offset", "out"),
        [
            (
                name, f"{t['frequency']:.3f}", millimeters(t["velocity_real"]), millimeters(t["velocity_simulated"]),
                *(millimeters(t[k]) for k in (
                    "marker_error", "aligned_marker_error", "shape_error", "progress_error", "static_offset")),
                f"{100 * t['left_out_share']:.0f} %",
            )
            for name, t in content["trials"].items()
        ],
    )  # fmt: skip
    for name, t in content["trials"].items():
        if t["divergence"]:
            console.print(f"{name}: {t['divergence']}")


def marker_errors(content: Mapping[str, Any], names: Sequence[str]) -> None:
    """Prints errors per marker."""
    table(
        "Aligned error per marker [mm]",
        ("trial", *names),
        [(n, *(millimeters(e) for e in t["aligned_marker_errors"])) for n, t in content["trials"].items()],
    )


def sensitivities(found: Sequence[Mapping[str, Any]]) -> None:
    """Prints each parameter's effect on the loss."""
    table(
        "Effect on the loss of a tenth of a parameter's range [mm]",
        ("parameter", "down", "up", "speed", "verdict"),
        [
            (s["name"], millimeters(s["lower"]), millimeters(s["upper"]), f"{100 * s['speed']:+.1f} %", s["verdict"])
            for s in found
        ],
    )
