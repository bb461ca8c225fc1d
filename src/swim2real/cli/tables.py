"""Tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swim2real.cli.terminal import say
from swim2real.escaping import visible


class PlainConsole(Console):
    """A console whose texts are only texts, in tables and titles as well: brackets are no markup, and see `visible`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text as it is shown."""
        return super().render_str(visible(text), **options)


console = PlainConsole()
MOST_COLUMNS = 10  # markers with a column each; of more only the worst are named
_WORST = "worst first"
_TEXTS = ("driven by", "finding", _WORST)  # columns of words


def progress_console() -> PlainConsole:
    """A console on standard error, for progress."""
    return PlainConsole(stderr=True, soft_wrap=True)


def millimeters(value: float | None) -> str:
    """A length or speed in thousandths, a dash for None."""
    return "–" if value is None else f"{1e3 * value:.1f}"


def degrees(value: float | None) -> str:
    """An angle in degrees, a dash for None."""
    return "–" if value is None else f"{math.degrees(value):.1f}"


def percent(share: float | None) -> str:
    """A share in hundredths, a dash for None and 0."""
    return f"{100 * share:.0f}" if share else "–"


def number(value: float | None) -> str:
    """Three digits, a dash for None."""
    return "–" if value is None else f"{value:.3g}"


# of all trials and of each: what is shown where there is such a figure
_OVERALL = (
    ("motion error", "motion_error"),
    ("  recoil of the head", "recoil_error"),
    ("  sway", "sway_error"),
    ("marker error (paper's Eq. 1)", "marker_error"),
    ("aligned marker error", "aligned_marker_error"),
    ("  shape", "shape_error"),
    ("  progress (thrust and drag)", "progress_error"),
    ("static offset (registration)", "static_offset"),
)
_PER_TRIAL = (
    ("Hz", "frequency", "{:.3f}".format),
    ("v real", "velocity_real", millimeters),
    ("v sim", "velocity_simulated", millimeters),
    ("motion", "motion_error", millimeters),
    ("Eq. 1", "marker_error", millimeters),
    ("aligned", "aligned_marker_error", millimeters),
    ("shape", "shape_error", millimeters),
    ("heading deg", "heading_error", degrees),
    ("progress", "progress_error", millimeters),
)
_HEAD = (
    ("recoil mm", "recoil_error", millimeters),
    ("yaw real deg", "yaw_real", degrees),
    ("simulated", "yaw_simulated", degrees),
    ("sway real mm", "sway_real", millimeters),
    ("simulated", "sway_simulated", millimeters),
)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Prints a table whose first column is text and whose others are numbers."""
    out = Table(
        title=title, title_justify="left", title_style="bold",
        box=SIMPLE_HEAD, padding=(0, 1), collapse_padding=True, pad_edge=False,
    )  # fmt: skip
    for i, column in enumerate(columns):
        out.add_column(column, justify="left" if i == 0 or column in _TEXTS else "right", overflow="fold")
    for row in rows:
        out.add_row(*row)
    console.print(out)


def by_marker(
    title: str, names: Sequence[str], before: Sequence[str], after: Sequence[str],
    rows: Sequence[tuple[Sequence[str], Sequence[float | None], Sequence[str]]], shown: Callable[[float | None], str],
) -> None:  # fmt: skip
    """Prints a table with a number for each marker: a column each, or, of more than ten, the ten largest in words.

    Args:
        title: What the numbers are.
        names: Names of the M markers.
        before: Headers of the columns before the markers'.
        after: Headers of the columns after them.
        rows: Cells before the markers', a number for each marker, None where there is none, and the cells after them.
        shown: A number as it is shown.
    """
    if not names:
        return
    if len(names) <= MOST_COLUMNS:
        columns = (*before, *names, *after)
        table(title, columns, [(*first, *map(shown, numbers), *last) for first, numbers, last in rows])
        return

    def worst(numbers: Sequence[float | None]) -> str:
        there = {name: number for name, number in zip(names, numbers, strict=True) if number}
        order = sorted(there, key=lambda name: -there[name])
        more = len(order) - MOST_COLUMNS
        text = ", ".join(f"{name} {shown(there[name])}" for name in order[:MOST_COLUMNS])
        return f"{text}, and {more} more" if more > 0 else text or "–"

    table(
        f"{title}, the {MOST_COLUMNS} worst of {len(names)} (all of them with --json)", (*before, _WORST, *after),
        [(*first, worst(numbers), *last) for first, numbers, last in rows],
    )  # fmt: skip


def figures(content: Mapping[str, Any], title: str) -> None:
    """Prints every figure of `evaluate`, overall and per trial, where the trials have it."""
    trials: Mapping[str, Mapping[str, Any]] = content["trials"]
    known = next(iter(trials.values()))
    sensors = list(known.get("sensor_errors") or {})
    rows: list[tuple[str, str]] = []
    if sensors:
        of = "markers and sensors" if "left_out_share" in content else "sensors"
        rows.append((f"playback error ({of})", millimeters(content["loss"]) + " mm"))
    rows += [(label, millimeters(content[key]) + " mm") for label, key in _OVERALL if key in content]
    if "unweighted_error" in content:
        added = content["unweighted_error"] - content["aligned_marker_error"] + 0.0
        rows.append(("lost tracks would add", millimeters(added) + " mm"))
    if "velocity_error" in content:
        rows.append(("velocity error", millimeters(content["velocity_error"]) + " mm/s"))
    if "yaw_error" in content:
        rows.append(("yaw error", degrees(content["yaw_error"]) + " deg"))
    if "heading_error" in content:
        rows.append(("heading error", degrees(content["heading_error"]) + " deg"))
    rows += [(f"{name} (own unit)", number(content["sensor_errors"][name])) for name in sensors]
    filmed = "left_out_share" in content
    if filmed:
        rows.append(("left out (lost markers)", f"{100 * content['left_out_share']:.1f} %"))
    table(title, ("figure", "value"), rows)
    columns = [column for column in _PER_TRIAL if column[1] in known]
    table(
        "Per trial [mm, mm/s]",
        ("trial", *(header for header, _, _ in columns), *sensors, *(["out"] if filmed else [])),
        [
            (
                name, *(shown(t[key]) for _, key, shown in columns),
                *(number(t["sensor_errors"][sensor]) for sensor in sensors),
                *([f"{100 * t['left_out_share']:.0f} %"] if filmed else []),
            )
            for name, t in trials.items()
        ],
    )  # fmt: skip
    if "recoil_error" in known:
        rows_of_head = [(name, *(shown(t[key]) for _, key, shown in _HEAD)) for name, t in trials.items()]
        table("Motion of the head", ("trial", *(header for header, _, _ in _HEAD)), rows_of_head)
    for name, t in trials.items():
        if t["divergence"]:
            say(f"{name}: {t['divergence']}")


def marker_errors(content: Mapping[str, Any], names: Sequence[str]) -> None:
    """Prints what each marker adds to the loss."""
    rows = [((name,), trial["aligned_marker_errors"], ()) for name, trial in content["trials"].items()]
    by_marker("Aligned error per marker [mm]", names, ("trial",), (), rows, millimeters)


def truth(found: Mapping[str, float], hidden: Mapping[str, float], verdicts: Mapping[str, str]) -> None:
    """Prints the values that were found beside the ones that were hidden, and whether the loss sees them."""
    words = {"identified": "yes", "weak": "weakly", "not identified": "no"}
    table(
        "Found, and what was hidden",
        ("parameter", "found", "hidden", "off", "seen in the loss"),
        [
            (
                name, f"{found[name]:.3g}", f"{value:.3g}", f"{100 * (found[name] / value - 1):+.0f} %",
                words.get(verdicts.get(name, ""), "–"),
            )
            for name, value in hidden.items()
        ],
    )  # fmt: skip
    say("What the loss doesn't see, or other values make up for, can be far off: `swim2real identify` tells which.")


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
