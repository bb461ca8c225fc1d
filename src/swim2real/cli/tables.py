"""Tables for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.cells import cell_len
from rich.console import Console
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
_GAP = 2  # characters between columns
_MOST_ROWS = 16  # of parameters at the end of a run
UNDETERMINED = "undetermined by these trials"
_NARROW = 24  # characters to which a column of words may shrink
_TEXTS = ("driven by", "finding", "parameters", _WORST)  # columns of words


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


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], spare: Sequence[str] = ()) -> None:
    """Prints a table whose first column is text and whose others are numbers, none of which is ever cut.

    Where a line is too narrow, spare columns are left out, then columns of words wrap, and then each row is a list of
    its own.

    Args:
        title: Title of the table; empty for none.
        columns: Headers.
        rows: Cells; those of the first column may have several lines.
        spare: Columns that are left out where a line is too narrow, the first ones first.
    """
    shown = [[visible(cell) for cell in row] for row in (columns, *rows)]
    if title:
        console.print(Text(visible(title), style="bold"))
    kept, left_out = list(range(len(columns))), list[str]()
    for name in (*spare, None):
        cells = [[row[i] for i in kept] for row in shown]
        widths = [max(cell_len(line) for row in cells for line in row[i].split("\n")) for i in range(len(kept))]
        room = console.width - (sum(widths) + _GAP * (len(kept) - 1))
        wordy = [i for i, k in enumerate(kept) if columns[k] in _TEXTS]
        if room < 0 and wordy and widths[wordy[-1]] + room >= _NARROW:
            widths[wordy[-1]] += room
            room = 0
        if room >= 0:
            _draw(cells, widths, wordy)
            break
        if name is not None:
            kept.remove(columns.index(name))
            left_out.append(name)
    else:
        _list(shown)
        left_out = []
    if left_out:
        console.print(Text(f"Left out in so narrow a window: {visible(', '.join(left_out))}."))
    console.print()


def _draw(cells: Sequence[Sequence[str]], widths: Sequence[int], wordy: Sequence[int]) -> None:
    """Prints cells in columns, the first row as headers."""
    for number, row in enumerate(cells):
        parts = [
            textwrap.wrap(cell, width) or [""] if i in wordy else cell.split("\n")
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        for level in range(max(map(len, parts))):
            line = list[str]()
            for i, (part, width) in enumerate(zip(parts, widths, strict=True)):
                text = part[level] if level < len(part) else ""
                room = " " * (width - cell_len(text))
                line.append(text + room if i == 0 or i in wordy else room + text)
            text = Text((" " * _GAP).join(line).rstrip(), style="" if number else "underline")
            console.print(text, soft_wrap=True)


def _list(cells: Sequence[Sequence[str]]) -> None:
    """Prints rows as lists of their cells, each after its header."""
    headers, *rows = cells
    for first, *others in rows:
        numbers = ", ".join(f"{header} {cell}" for header, cell in zip(headers[1:], others, strict=True) if cell)
        text = f"{' '.join(first.split())}: {numbers}"
        wrapped = textwrap.wrap(
            text, console.width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
        for line in wrapped:
            console.print(Text(line), soft_wrap=True)


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
            numbers = [(name, *(f.text(t[c]) for c, f in columns.items())) for name, t in trials.items()]
            table(heading, headings, numbers)
    for name, trial in content.trials.items():
        if trial.divergence:
            say(f"{name}: {trial.divergence}")


def marker_errors(content: FitFigures, names: Sequence[str]) -> None:
    """Prints what each marker adds to the loss."""
    rows = [((name,), trial.aligned_marker_errors, ()) for name, trial in content.trials.items()]
    by_marker("Aligned error per marker [mm]", names, ("trial",), (), rows, millimeters)


def parameters(rows: Sequence[ParameterRow], interval: str, hidden: Mapping[str, float] | None = None) -> None:
    """Prints what a run has found of each parameter and between which values it may lie; of many the best known ones.

    Args:
        rows: One per parameter.
        interval: Name of the rows' intervals; empty where they have none.
        hidden: Values that are to be found, by name, where they are known.
    """
    cells: list[tuple[str, ...]] = []
    for row in sorted(rows, key=lambda row: row.known == "undetermined") if len(rows) > _MOST_ROWS else rows:
        name, ends = row.parameter.name, row.interval
        span = "" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g}"
        if hidden is None and row.known == "undetermined":
            span = UNDETERMINED
        elif hidden is None and row.bound:
            span += f"{', ' if span else ''}on its {row.bound} bound"
        truth = () if hidden is None else (f"{hidden[name]:.3g}", "yes" if _inside(hidden[name], ends) else "no")
        cells.append((name, row.unit, f"{row.value:.4g}", span or "–", *truth))
    columns = ("parameter", "unit", "value", interval or "note", *(("hidden", "inside") if hidden is not None else ()))
    table("", columns, cells[:_MOST_ROWS], ("unit", "inside") if hidden is not None else ("unit",))
    if len(cells) > _MOST_ROWS:
        say(f"{len(cells) - _MOST_ROWS} more parameters are on the page.")
    if hidden is not None and interval:
        inside = sum(_inside(hidden[row.parameter.name], row.interval) for row in rows)
        say(f"{inside} of {len(rows)} hidden values lie inside.")


def _inside(value: float, ends: tuple[float, float] | None) -> bool:
    return ends is not None and ends[0] <= value <= ends[1]


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
