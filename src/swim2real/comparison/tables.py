"""The tables of a comparison, as text and as Markdown: the form of the paper's Table II, and all that it leaves out."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from swim2real.comparison.protocols import figures_of
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import (
    ERRORS,
    Difference,
    MethodStatistics,
    differences,
    evaluations_to_reach,
    held_out_errors,
    marker_errors,
    method_statistics,
    speeds,
    step_statistics,
)
from swim2real.escaping import plain_markdown, visible

if TYPE_CHECKING:
    import pandas as pd

THEORY = "elongated body theory"
MISSING = "–"
_Rows = Sequence[tuple[str, Sequence["Cell"]]]


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Attributes:
        text: Text as shown.
        value: Value to sort by; None sorts last.
        is_best: Whether it is the lowest of its column.
    """

    text: str
    value: float | None = None
    is_best: bool = False


@dataclass(frozen=True)
class Table:
    """Methods and their figures.

    Attributes:
        key: A short name.
        title: Title, with the protocol.
        columns: Headings with units; the first is that of the methods.
        rows: A method's label and its cells.
        note: How to read the table.
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    note: str = ""


def format_number(value: float | None, digits: int | None = 1, factor: float = 1.0) -> str:
    """A number with a real minus sign; a dash for None, NaN and infinity.

    Args:
        value: The number.
        digits: Digits after the point; None for three significant ones.
        factor: Factor to the unit that is shown.
    """
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{factor * value:{'.3g' if digits is None else f'.{digits}f'}}".replace("-", "−")


def mm_cell(value: float | None) -> Cell:
    """Meters as millimeters, or m/s as mm/s."""
    return Cell(format_number(value, 1, 1e3), _finite(value))


def spread_cell(values: pd.Series[float], digits: int | None = 1, factor: float = 1e3) -> Cell:
    """Mean ± standard deviation of a sample; by default in mm or mm/s. A single value has no deviation."""
    mean, deviation = float(values.mean()), float(values.std())
    text = format_number(mean, digits, factor)
    if not math.isnan(deviation):
        text += f" ± {format_number(deviation, digits, factor)}"
    return Cell(text, _finite(mean))


def tables(results: ComparisonResults, protocol: str, theory: Mapping[str, float] | None = None) -> tuple[Table, ...]:
    """All tables of a protocol that have rows, the paper's first; none without finished runs.

    Args:
        results: Results of the comparison.
        protocol: `aligned`, `paper` or `playback`.
        theory: Speeds that elongated body theory predicts, by trial [m/s].
    """
    methods = method_statistics(results, protocol)
    if not methods:
        return ()
    candidates = (
        paper_table(methods),
        _difference_table(methods),
        _figure_table(methods, results.sensors),
        _seed_table(methods),
        _reached_table(methods),
        _step_table(methods),
        _velocity_table(methods, theory),
        _marker_table(methods, results.markers),
        _held_out_table(results, methods),
    )
    return tuple(table for table in candidates if table is not None)


def paper_table(methods: Sequence[MethodStatistics]) -> Table:
    """Best, worst and AUC, as in the paper's Table II."""
    counts = sorted({len(method.runs) for method in methods})
    seeds = f"{counts[0]} seed{'s' * (counts[0] > 1)}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]} seeds"
    rows = [
        (method.method, (spread_cell(method.final), mm_cell(method.final.max()), spread_cell(method.auc)))
        for method in methods
    ]
    return _table(
        "paper", f"Calibration performance over {seeds}", methods, ("Best (mm)", "Worst (mm)", "AUC (mm)"), rows,
        f"Best: mean ± standard deviation of each seed's lowest {methods[0].description.loss}. Worst: the highest "
        f"of them. AUC: mean over the {methods[0].curves.shape[1]} evaluations of the lowest so far.",
        marked=(0, 1, 2),
    )  # fmt: skip


def _difference_table(methods: Sequence[MethodStatistics]) -> Table:
    """How surely the best method is best."""
    final, auc = differences(methods), differences(methods, "auc")
    rows = [
        (
            method.method,
            (mm_cell(method.final.median()), _gap_cell(final[method.method]), _gap_cell(auc[method.method])),
        )
        for method in methods
    ]
    return _table(
        "sureness", "Difference to the best method", methods,
        ("Median (mm)", "Best: above the lowest (mm)", "AUC: above the lowest (mm)"), rows,
        "Difference to the method with the lowest mean, which has a dash, with its 95 % bootstrap interval over "
        "seeds, paired by seed. With few seeds such an interval is too narrow.",
        marked=(0,),
    )  # fmt: skip


def _figure_table(methods: Sequence[MethodStatistics], sensors: Mapping[str, str]) -> Table:
    """Every figure at the best parameters that a method has."""
    figures = {
        name: figure
        for name, figure in figures_of(methods[0].protocol, sensors).items()
        if any(method.figures[name].notna().any() for method in methods)
    }
    rows = [
        (method.method, [spread_cell(method.figures[name], f.digits, f.factor) for name, f in figures.items()])
        for method in methods
    ]
    return _table(
        "figures", "All figures at the best parameters", methods, [f.heading for f in figures.values()], rows,
        "Mean ± standard deviation over seeds.", marked=range(len(figures)),
    )  # fmt: skip


def _seed_table(methods: Sequence[MethodStatistics]) -> Table:
    """The best loss of every seed."""
    seeds = sorted({seed for method in methods for seed in method.seeds})
    rows = [(method.method, [mm_cell(method.final.get(seed)) for seed in seeds]) for method in methods]
    headings = [f"Seed {seed} (mm)" for seed in seeds]
    return _table("seeds", "Best loss of every seed", methods, headings, rows, marked=range(len(seeds)))


def _reached_table(methods: Sequence[MethodStatistics]) -> Table:
    """How many evaluations it takes to reach given errors."""
    by_method = {method.method: evaluations_to_reach(method) for method in methods}

    def cell(evaluations: pd.Series[float]) -> Cell:
        median = float(evaluations.fillna(math.inf).median())  # a seed that doesn't get there takes forever
        text = f"{median:g}" if math.isfinite(median) else "not reached"
        return Cell(f"{text} ({evaluations.count()}/{len(evaluations)})", _finite(median))

    rows = [(method, [cell(reached[error]) for error in ERRORS]) for method, reached in by_method.items()]
    return _table(
        "reached", "Evaluations to an error", methods, [f"≤ {1e3 * error:g} mm" for error in ERRORS], rows,
        "Median over all seeds, and how many of them got there; 'not reached' where the median seed did not.",
        marked=range(len(ERRORS)),
    )  # fmt: skip


def _step_table(methods: Sequence[MethodStatistics]) -> Table | None:
    """Accept rates and step shares of the methods with rounds."""
    by_method = {method.method: steps for method in methods if (steps := step_statistics(method.runs)) is not None}
    if not by_method:
        return None
    sizes = sorted({size for steps in by_method.values() for size in steps.by_size}, reverse=True)

    def percent(share: float | None) -> Cell:
        return Cell(format_number(share, 0, 100), _finite(share))

    rows = [
        (
            method,
            (
                Cell(format_number(steps.calls), steps.calls),
                Cell(str(steps.rounds), steps.rounds),
                percent(steps.accept_rate),
                *(percent(steps.shares.get(size)) for size in sizes),
                Cell(format_number(steps.steps_per_accepted), _finite(steps.steps_per_accepted)),
                Cell(str(steps.cut_short), steps.cut_short),
            ),
        )
        for method, steps in by_method.items()
    ]
    headings = (
        "Calls a run", "Rounds", "Accepted (%)", *(f"at step {size:g} (%)" for size in sizes),
        "Evaluations an accepted one", "Cut short",
    )  # fmt: skip
    return _table(
        "steps", "Proposals and line search", methods, headings, rows,
        "Over all seeds. A round is a proposal and its steps; shares are of the accepted rounds. Rounds that the "
        "budget cut short are in none of the other columns.",
    )  # fmt: skip


def _velocity_table(methods: Sequence[MethodStatistics], theory: Mapping[str, float] | None) -> Table | None:
    """Error in speed by frequency; elongated body theory has a row where its speeds are given."""
    by_method = {method.method: own for method in methods if (own := speeds(method.runs)) is not None}
    if not by_method:
        return None
    first = next(iter(by_method.values()))
    rows = [
        (method, [*map(mm_cell, own.errors.mean()), spread_cell(own.mean_error)])
        for method, own in by_method.items()
        if own.trials == first.trials
    ]
    if theory is not None:
        errors = first.real.rsub([theory.get(name, math.nan) for name in first.trials]).abs()
        rows.append((THEORY, [*map(mm_cell, errors), mm_cell(errors.mean())]))
    headings = [*(f"{frequency:.2f} Hz (mm/s)" for frequency in first.frequencies), "Mean (mm/s)"]
    real = ", ".join(f"{1e3 * speed:.0f}" for speed in first.real)
    return _table(
        "velocity", "Velocity error by frequency", methods, headings, rows,
        f"|simulated − real|, mean over seeds. The real speeds are {real} mm/s.", marked=range(len(headings)),
    )  # fmt: skip


def _marker_table(methods: Sequence[MethodStatistics], markers: Sequence[str]) -> Table:
    """Error of each marker, of swims with and without registration."""
    protocol = methods[0].description
    several = len(protocol.markers) > 1
    rows = [
        (
            f"{method.method}, {description}" if several else method.method,
            [mm_cell(error) for error in marker_errors(method.runs, kind).mean()],
        )
        for method in methods
        for kind, description in protocol.markers
    ]
    return _table(
        "markers", protocol.markers_title, methods, [f"{marker} (mm)" for marker in markers], rows,
        f"Mean over seeds and over the trials in which tracking has the marker. {protocol.markers_note}",
    )  # fmt: skip


def _held_out_table(results: ComparisonResults, methods: Sequence[MethodStatistics]) -> Table | None:
    """Error on trials that a fit did not know."""
    by_method = {
        method.method: errors
        for method in methods
        if (errors := held_out_errors(results, method.method, method.protocol)) is not None
    }
    if not by_method:
        return None
    spreads = {"held_out": "Left out (mm)", "same_when_fitted": "Same, when fitted (mm)"}
    if any(errors["velocity"].notna().any() for errors in by_method.values()):
        spreads["velocity"] = "Velocity, left out (mm/s)"
    trials = [name for name in results.trials if any(name in set(errors["trial"]) for errors in by_method.values())]
    rows = [
        (
            method,
            [
                *(spread_cell(errors[column]) for column in spreads),
                *(mm_cell(errors["held_out"][errors["trial"] == name].mean()) for name in trials),
            ],
        )
        for method, errors in by_method.items()
    ]
    headings = (*spreads.values(), *(f"{name} (mm)" for name in trials))
    return _table(
        "left-out", "Trials left out of the fit", methods, headings, rows,
        "Each run leaves one trial out and is judged on it; mean ± standard deviation over trials and seeds. "
        "'Same, when fitted' is the error on the same trials of the runs that knew them.",
        marked=[column for column in range(len(headings)) if column != 1],
    )  # fmt: skip


def as_text(table: Table) -> str:
    """A table for a terminal or a text file; the best of a column has a star."""
    body = [[name, *(cell.text + ("*" if cell.is_best else " ") for cell in cells)] for name, cells in table.rows]
    grid = [[name, *(f"{heading} " for heading in headings)] for name, *headings in (table.columns,)] + body
    widths = [max(len(row[i]) for row in grid) for i in range(len(table.columns))]

    def line(row: list[str]) -> str:
        cells = (t.rjust(w) if i else t.ljust(w) for i, (t, w) in enumerate(zip(row, widths, strict=True)))
        return "  ".join(cells).rstrip()

    rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
    note = textwrap.wrap(table.note, max(80, min(len(rule), 120)))
    return "\n".join([table.title, rule, line(grid[0]), rule, *map(line, body), rule, *note]) + "\n"


def as_markdown(table: Table) -> str:
    """A table in Markdown; the best of a column is bold."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cells) + " |"

    def shown(cell: Cell) -> str:
        return f"**{_escaped(cell.text)}**" if cell.is_best else _escaped(cell.text)

    rule = line(["---", *["---:"] * (len(table.columns) - 1)])
    body = [line([_escaped(name), *map(shown, cells)]) for name, cells in table.rows]
    parts = [f"### {_escaped(table.title)}", "", line([_escaped(c) for c in table.columns]), rule, *body]
    return "\n".join(parts + (["", _escaped(table.note)] if table.note else [])) + "\n"


def all_tables(results: ComparisonResults, form: Callable[[Table], str] = as_text) -> str:
    """Every table of every protocol in one text."""
    return "\n".join(form(table) for protocol in results.protocols for table in tables(results, protocol))


def _table(
    key: str, title: str, methods: Sequence[MethodStatistics], headings: Sequence[str], rows: _Rows, note: str = "",
    marked: Sequence[int] = (),
) -> Table:  # fmt: skip
    """A table of methods under one protocol, with the lowest of the marked columns marked where there are several."""
    lowest: dict[int, float] = {}
    for column in marked:
        values = [value for _, cells in rows if (value := cells[column].value) is not None]
        if len(values) > 1:
            lowest[column] = min(values)
    marked_rows = (
        (name, tuple(replace(cell, is_best=i in lowest and cell.value == lowest[i]) for i, cell in enumerate(cells)))
        for name, cells in rows
    )
    title = f"{title}, {methods[0].protocol} protocol, {methods[0].curves.shape[1]} evaluations"
    return Table(key, title, ("Method", *headings), tuple(marked_rows), note)


def _gap_cell(difference: Difference | None) -> Cell:
    """A difference with its interval, in mm."""
    if difference is None:
        return Cell(MISSING)
    text = format_number(difference.mean, 1, 1e3)
    if not math.isnan(difference.low):
        text += f" [{format_number(difference.low, 1, 1e3)}, {format_number(difference.high, 1, 1e3)}]"
    return Cell(text, difference.mean)


def _finite(value: float | None) -> float | None:
    """The value, None where it is not finite."""
    return float(value) if value is not None and math.isfinite(value) else None


def _escaped(text: str) -> str:
    """A text as a cell of Markdown, in which it is only text."""
    line = visible(text).replace("\n", " ")
    for sign in "\\`|*_~":
        line = line.replace(sign, f"\\{sign}")
    return plain_markdown(line.replace("&", "&amp;"))
