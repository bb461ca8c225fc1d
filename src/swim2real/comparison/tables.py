"""The tables of a comparison: the form of the paper's Table II, and all that it leaves out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from swim2real.comparison import statistics
from swim2real.comparison.results import ComparisonResults
from swim2real.formatting import NOTHING, mm, number
from swimbase.escaping import plain_markdown, visible

if TYPE_CHECKING:
    import pandas as pd

THEORY = "elongated body theory"


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


def mm_cell(value: float | None) -> Cell:
    """Meters as millimeters, or m/s as mm/s."""
    return Cell(mm(value), _finite(value))


def spread_cell(values: pd.Series[float], digits: int | None = 1, factor: float = 1e3) -> Cell:
    """Mean ± standard deviation of a sample; by default in mm or mm/s. A single value has no deviation."""
    mean, deviation = float(values.mean()), float(values.std())
    text = number(mean, digits, factor)
    if not math.isnan(deviation):
        text += f" ± {number(deviation, digits, factor)}"
    return Cell(text, _finite(mean))


def tables(results: ComparisonResults, protocol: str, theory: Mapping[str, float] | None = None) -> tuple[Table, ...]:
    """All tables of a protocol that have rows, the paper's first; none without finished runs.

    Args:
        results: Results of the comparison.
        protocol: `motion`, `aligned`, `paper` or `playback`.
        theory: Speeds that elongated body theory predicts, by trial [m/s].
    """
    methods = statistics.method_statistics(results, protocol)
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


def paper_table(methods: Sequence[statistics.MethodStatistics]) -> Table:
    """Best, worst and AUC, as in the paper's Table II."""
    counts = sorted({len(method.runs) for method in methods})
    seeds = f"{counts[0]} seed{'s' * (counts[0] > 1)}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]} seeds"
    columns = [
        ("Best (mm)", [spread_cell(method.final) for method in methods]),
        ("Worst (mm)", [mm_cell(method.final.max()) for method in methods]),
        ("AUC (mm)", [spread_cell(method.auc) for method in methods]),
    ]
    note = (
        f"Best: mean ± standard deviation of each seed's lowest {methods[0].description.loss}. Worst: the highest "
        f"of them. AUC: mean over the {methods[0].curves.shape[1]} evaluations of the lowest so far."
    )
    return _table("paper", f"Calibration performance over {seeds}", methods, columns, note)


def _difference_table(methods: Sequence[statistics.MethodStatistics]) -> Table:
    """Table of the differences to the best method, with intervals."""
    final, auc = statistics.differences(methods), statistics.differences(methods, "auc")
    columns = [
        ("Median (mm)", [mm_cell(method.final.median()) for method in methods]),
        ("Best: above the lowest (mm)", [_gap_cell(final[method.method]) for method in methods]),
        ("AUC: above the lowest (mm)", [_gap_cell(auc[method.method]) for method in methods]),
    ]
    note = (
        "Difference to the method with the lowest mean, which has a dash, with its 95 % bootstrap interval over seeds, "
        "paired by seed. With few seeds such an interval is too narrow."
    )
    return _table("sureness", "Difference to the best method", methods, columns, note, unmarked=(1, 2))


def _figure_table(methods: Sequence[statistics.MethodStatistics], sensors: Mapping[str, str]) -> Table:
    """Every figure at the best parameters that a method has."""
    columns = [
        (figure.heading, [spread_cell(method.figures[name], figure.digits, figure.factor) for method in methods])
        for name, figure in statistics.figures_of(methods[0].protocol, sensors).items()
        if any(method.figures[name].notna().any() for method in methods)
    ]
    note = "Mean ± standard deviation over seeds."
    return _table("figures", "All figures at the best parameters", methods, columns, note)


def _seed_table(methods: Sequence[statistics.MethodStatistics]) -> Table:
    """The best loss of every seed."""
    seeds = sorted({seed for method in methods for seed in method.seeds})
    columns = [(f"Seed {seed} (mm)", [mm_cell(method.final.get(seed)) for method in methods]) for seed in seeds]
    return _table("seeds", "Best loss of every seed", methods, columns)


def _reached_table(methods: Sequence[statistics.MethodStatistics]) -> Table:
    """Table of the evaluations needed to reach given errors."""

    def cell(evaluations: pd.Series[float]) -> Cell:
        median = float(evaluations.fillna(math.inf).median())  # a seed that doesn't get there takes forever
        text = f"{median:g}" if math.isfinite(median) else "not reached"
        return Cell(f"{text} ({evaluations.count()}/{len(evaluations)})", _finite(median))

    reached = [statistics.evaluations_to_reach(method) for method in methods]
    columns = [(f"≤ {1e3 * error:g} mm", [cell(one[error]) for one in reached]) for error in statistics.ERRORS]
    note = "Median over all seeds, and how many of them got there; 'not reached' where the median seed did not."
    return _table("reached", "Evaluations to an error", methods, columns, note)


def _step_table(methods: Sequence[statistics.MethodStatistics]) -> Table | None:
    """Accept rates and step shares of the methods with rounds."""
    known = {
        method.method: steps for method in methods if (steps := statistics.step_statistics(method.runs)) is not None
    }
    if not known:
        return None
    sizes = sorted({size for steps in known.values() for size in steps.by_size}, reverse=True)

    def percents(shares: Sequence[float | None]) -> list[Cell]:
        return [Cell(number(share, 0, 100), _finite(share)) for share in shares]

    found = list(known.values())
    costs = [steps.steps_per_accepted for steps in found]
    columns = [
        ("Calls per run", [Cell(number(steps.calls), steps.calls) for steps in found]),
        ("Rounds", [Cell(str(steps.rounds), steps.rounds) for steps in found]),
        ("Accepted (%)", percents([steps.accept_rate for steps in found])),
        *((f"at step {size:g} (%)", percents([steps.shares.get(size) for steps in found])) for size in sizes),
        ("Evaluations per accepted one", [Cell(number(cost), _finite(cost)) for cost in costs]),
        ("Cut short", [Cell(str(steps.cut_short), steps.cut_short) for steps in found]),
    ]
    note = (
        "Over all seeds. A round is a proposal and its steps; shares are of the accepted rounds. Rounds that the "
        "budget cut short are in none of the other columns."
    )
    unmarked = range(len(columns))
    return _table("steps", "Proposals and line search", methods, columns, note, unmarked, list(known))


def _velocity_table(methods: Sequence[statistics.MethodStatistics], theory: Mapping[str, float] | None) -> Table | None:
    """Error in speed by frequency; elongated body theory has a row where its speeds are given."""
    known = {method.method: own for method in methods if (own := statistics.speeds(method.runs)) is not None}
    if not known:
        return None
    first = next(iter(known.values()))
    rows = {
        method: [*map(mm_cell, own.errors.mean()), spread_cell(own.mean_error)]
        for method, own in known.items()
        if own.trials == first.trials
    }
    if theory is not None:
        errors = first.real.rsub([theory.get(name, math.nan) for name in first.trials]).abs()
        rows[THEORY] = [*map(mm_cell, errors), mm_cell(errors.mean())]
    headings = [*(f"{frequency:.2f} Hz (mm/s)" for frequency in first.frequencies), "Mean (mm/s)"]
    columns = list(zip(headings, zip(*rows.values(), strict=True), strict=True))
    real = ", ".join(f"{1e3 * speed:.0f}" for speed in first.real)
    note = f"|simulated − real|, mean over seeds. The real speeds are {real} mm/s."
    return _table("velocity", "Velocity error by frequency", methods, columns, note, labels=list(rows))


def _marker_table(methods: Sequence[statistics.MethodStatistics], markers: Sequence[str]) -> Table:
    """Error of each marker, of swims with and without registration."""
    protocol = methods[0].description
    several = len(protocol.markers) > 1
    rows = [(method, described) for method in methods for described in protocol.markers]
    labels = [f"{method.method}, {about}" if several else method.method for method, (_, about) in rows]
    errors = [
        list(map(mm_cell, statistics.marker_errors(method.runs, kind, len(markers)).mean()))
        for method, (kind, _) in rows
    ]
    columns = [(f"{marker} (mm)", [row[i] for row in errors]) for i, marker in enumerate(markers)]
    note = f"Mean over seeds and over the trials in which tracking has the marker. {protocol.markers_note}"
    return _table("markers", protocol.markers_title, methods, columns, note, range(len(markers)), labels)


def _held_out_table(results: ComparisonResults, methods: Sequence[statistics.MethodStatistics]) -> Table | None:
    """Error on trials that a fit did not know."""
    found = {method.method: statistics.held_out_errors(results, method.method, method.protocol) for method in methods}
    known = {method: errors for method, errors in found.items() if errors is not None}
    if not known:
        return None
    spreads = {"held_out": "Left out (mm)", "same_when_fitted": "Same, when fitted (mm)"}
    if any(errors["velocity"].notna().any() for errors in known.values()):
        spreads["velocity"] = "Velocity, left out (mm/s)"
    columns = [(heading, [spread_cell(errors[name]) for errors in known.values()]) for name, heading in spreads.items()]
    for trial in results.trials:
        if any(trial in set(errors["trial"]) for errors in known.values()):
            means = [errors["held_out"][errors["trial"] == trial].mean() for errors in known.values()]
            columns.append((f"{trial} (mm)", list(map(mm_cell, means))))
    note = (
        "Each run leaves one trial out and is judged on it; mean ± standard deviation over trials and seeds. "
        "'Same, when fitted' is the error on the same trials of the runs that knew them."
    )
    return _table("left-out", "Trials left out of the fit", methods, columns, note, (1,), list(known))


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


def all_tables(results: ComparisonResults) -> str:
    """Every table of every protocol in one text, in Markdown."""
    return "\n".join(as_markdown(table) for protocol in results.protocols for table in tables(results, protocol))


def _table(
    key: str, title: str, methods: Sequence[statistics.MethodStatistics], columns: Sequence[tuple[str, Sequence[Cell]]],
    note: str = "", unmarked: Sequence[int] = (), labels: Sequence[str] | None = None,
) -> Table:  # fmt: skip
    """A table under one protocol, with the lowest of each column marked where there are several.

    Args:
        key: A short name.
        title: Title, without the protocol.
        methods: The methods.
        columns: Heading of each column, and its cells.
        note: How to read the table.
        unmarked: Columns of which none is marked.
        labels: Label of each row; by default the methods'.
    """
    marked: list[list[Cell]] = []
    for i, (_, cells) in enumerate(columns):
        values = [cell.value for cell in cells if cell.value is not None]
        lowest = min(values) if len(values) > 1 and i not in unmarked else None
        marked.append([replace(cell, is_best=lowest is not None and cell.value == lowest) for cell in cells])
    names = labels or [method.method for method in methods]
    rows = tuple((name, tuple(cells[row] for cells in marked)) for row, name in enumerate(names))
    title = f"{title}, {methods[0].protocol} protocol, {methods[0].curves.shape[1]} evaluations"
    return Table(key, title, ("Method", *(heading for heading, _ in columns)), rows, note)


def _gap_cell(difference: statistics.Difference | None) -> Cell:
    """A difference with its interval, in mm."""
    if difference is None:
        return Cell(NOTHING)
    text = mm(difference.mean)
    if not math.isnan(difference.low):
        text += f" [{mm(difference.low)}, {mm(difference.high)}]"
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
