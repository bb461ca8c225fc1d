"""What a table of a comparison is made of: entries as texts, with the values behind them to sort by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from swim2real.comparison.statistics import Difference, Spread

NOTHING = "–"


@dataclass(frozen=True)
class Cell:
    """One entry.

    Attributes:
        text: As shown.
        value: To sort by; None sorts last.
        is_best: Whether it is the lowest of its column (the highest where high is good).
    """

    text: str
    value: float | None = None
    is_best: bool = False


@dataclass(frozen=True)
class Table:
    """Rows of methods and what is said about them.

    Attributes:
        key: A short name.
        title: What it shows, with the protocol.
        columns: Heads with units; the first is that of the methods.
        rows: A method's label and its cells.
        note: How to read it.
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    note: str = ""


def as_number(value: float | None, digits: int | None = 1, factor: float = 1.0) -> str:
    """A number with fixed digits, three in all for None, and a real minus sign; a dash for None, NaN and infinity."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{factor * value:{'.3g' if digits is None else f'.{digits}f'}}".replace("-", "−")


def known(value: float | None) -> float | None:
    """The value, None where it is not finite."""
    return value if value is not None and math.isfinite(value) else None


def mm_cell(value: float | None) -> Cell:
    """Meters as millimeters, or m/s as mm/s."""
    return Cell(as_number(value, 1, 1e3), known(value))


def spread_cell(spread: Spread, digits: int | None = 1, factor: float = 1e3) -> Cell:
    """Mean ± standard deviation over seeds; by default in mm or mm/s."""
    shown, std = (as_number(value, digits, factor) for value in (spread.mean, spread.std))
    return Cell(shown if math.isnan(spread.std) else f"{shown} ± {std}", known(spread.mean))


def difference_cell(difference: Difference | None) -> Cell:
    """A difference with its interval, in mm."""
    if difference is None:
        return Cell(NOTHING)
    shown = as_number(difference.mean, 1, 1e3)
    if not math.isnan(difference.low):
        shown += f" [{as_number(difference.low, 1, 1e3)}, {as_number(difference.high, 1, 1e3)}]"
    return Cell(shown, difference.mean)


def marked(table: Table, skip: Sequence[int] = ()) -> Table:
    """Marks the lowest of each column where there is more than one, but for the columns to skip."""
    best: list[float | None] = []
    for i in range(len(table.columns) - 1):
        values = [row[i].value for _, row in table.rows]
        known = [value for value in values if value is not None]
        best.append(min(known) if len(known) > 1 and i not in skip else None)
    rows = tuple(
        (
            name,
            tuple(replace(c, is_best=low is not None and c.value == low) for c, low in zip(cells, best, strict=True)),
        )
        for name, cells in table.rows
    )
    return replace(table, rows=rows)
