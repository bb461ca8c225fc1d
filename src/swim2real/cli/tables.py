"""Tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swim2real.cli.terminal import say
from swim2real.objective.figures import SENSORS, FitFigures, figure_values, figures_for, sensor_figure
from swimbase.escaping import visible

if TYPE_CHECKING:
    from swim2real.calibration import Verdict
    from swim2real.calibration.sensitivity import Sensitivity
    from swim2real.report.tables import ParameterRow
    from swim2real.robots.robot import Sensor


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
_WHOLE = 32  # characters of a name that isn't broken; numbers wrap in its place
_WIDE = 10_000  # characters of a line, in which any table is whole
_UNDETERMINED = 0.8  # share of its bounds within which a parameter may be anywhere
_TEXTS = ("driven by", "finding", _WORST)  # columns of words


def progress_console() -> PlainConsole:
    """A console on standard error, for progress."""
    return PlainConsole(stderr=True, soft_wrap=True)


def verdict(found: Verdict) -> None:
    """Prints the verdict on a run, its kind in color."""
    style = {"good": "bold green", "not finished": "bold yellow", "not usable": "bold red"}[found.kind]
    text = Text(f"{found.title}.", style=style)
    console.print(text.append(f" {visible(_sentence(found.sentence))}", style="not bold default"), soft_wrap=True)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def millimeters(value: float | None) -> str:
    """A length or speed in thousandths, a dash for None."""
    return "–" if value is None else f"{1e3 * value:.1f}"


def percent(share: float | None) -> str:
    """A share in hundredths, a dash for None and 0."""
    return f"{100 * share:.0f}" if share else "–"


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Prints a table whose first column is text and whose others are numbers."""
    out = Table(
        title=title, title_justify="left", title_style="bold",
        box=SIMPLE_HEAD, padding=(0, 1), collapse_padding=True, pad_edge=False,
    )  # fmt: skip
    names = (*columns[0].split(), *(row[0].partition("\n")[0] for row in rows))
    whole = min(max(map(len, names)), _WHOLE)
    for i, column in enumerate(columns):
        justify = "left" if i == 0 or column in _TEXTS else "right"
        out.add_column(column, justify=justify, overflow="fold")
    for row in rows:
        out.add_row(*row)
    if console.measure(out, options=console.options.update(width=_WIDE)).maximum > console.width:  # the others wrap
        out.columns[0].width = whole
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


def figures(content: FitFigures, title: str, sensors: Sequence[Sensor]) -> None:
    """Prints every figure of `evaluate`, overall and per trial, where the trials have it.

    Args:
        content: Figures of all trials and of each.
        title: Title of the first table.
        sensors: Sensors that are compared beside the markers.
    """
    known = figures_for(registered=content.static_offset is not None)
    compared = {f"{SENSORS}.{s.name}": sensor_figure(s.name, s.unit) for s in sensors}
    values = figure_values(content)
    rows = [(f.label, f"{f.text(values[name])} {f.unit}") for name, f in (known | compared).items() if name in values]
    if sensors:
        of = "markers and sensors" if "aligned_marker_error" in values else "sensors"
        rows.insert(0, (f"Playback error ({of})", f"{millimeters(content.loss)} mm"))
    table(title, ("figure", "value"), rows)
    trials = {name: figure_values(trial) for name, trial in content.trials.items()}
    shown = next(iter(trials.values()))
    for heading, parts in (("Per trial [mm, mm/s]", ("fit", "tracks")), ("Motion of the head [mm]", ("head",))):
        columns = {name: f for name, f in (known | compared).items() if name in shown and f.of in parts and f.per_trial}
        if columns:
            headings = ("trial", *(f.short if f.unit in ("mm", "mm/s") else f.column for f in columns.values()))
            table(
                heading, headings, [(name, *(f.text(t[c]) for c, f in columns.items())) for name, t in trials.items()]
            )
    for name, trial in content.trials.items():
        if trial.divergence:
            say(f"{name}: {trial.divergence}")


def marker_errors(content: FitFigures, names: Sequence[str]) -> None:
    """Prints what each marker adds to the loss."""
    rows = [((name,), trial.aligned_marker_errors, ()) for name, trial in content.trials.items()]
    by_marker("Aligned error per marker [mm]", names, ("trial",), (), rows, millimeters)


def truth(
    found: Mapping[str, float], hidden: Mapping[str, float], intervals: Mapping[str, tuple[float, float]]
) -> None:  # fmt: skip
    """Prints the values that were found beside the ones that were hidden, and whether intervals hold these."""
    rows: list[tuple[str, ...]] = []
    for name, value in hidden.items():
        low, high = intervals.get(name, (math.nan, math.nan))
        interval = f"{low:.3g} to {high:.3g}{'' if low <= value <= high else ' (missed)'}" if name in intervals else "–"
        rows.append((name, f"{found[name]:.3g}", f"{value:.3g}", interval))
    table("Found, and what was hidden", ("parameter", "found", "hidden", "95 % interval"), rows)


def parameters(rows: Sequence[ParameterRow], ranges: Mapping[str, Sequence[float]]) -> None:
    """Prints the values that a run has found beside the model's, and how well the trials determine them.

    Args:
        rows: One per parameter.
        ranges: Values within which the error rises by less than a tenth, by name, where they are known.
    """
    cells: list[tuple[str, ...]] = []
    for row in rows:
        p, ends = row.parameter, ranges.get(row.parameter.name)
        wide = ends is not None and ends[1] - ends[0] >= _UNDETERMINED * (p.upper - p.lower)
        within = "–" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g}{': undetermined' if wide else ''}"
        cells.append((p.name, f"{p.published:.4g}", f"{row.value:.4g}", p.unit, row.bound or "–", within))
    table(
        "Parameters; the error rises by less than a tenth within the last column, all others following",
        ("parameter", "model", "found", "unit", "on bound", "within"), cells,
    )  # fmt: skip
    if not ranges:
        say("How well the trials determine them: `swim2real identify`, or a search by least squares (the default).")


def sensitivities(found: Sequence[Sensitivity]) -> None:
    """Prints each parameter's effect on the loss."""
    table(
        "Effect on the loss of a tenth of a parameter's range [mm]",
        ("parameter", "down", "up", "speed"),
        [
            (
                s.name, millimeters(s.lower), millimeters(s.upper),
                "–" if s.speed is None else f"{100 * s.speed:+.1f} %",
            )
            for s in found
        ],
    )  # fmt: skip
