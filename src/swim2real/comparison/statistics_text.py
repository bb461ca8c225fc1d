"""The tables of a comparison as plain text and as Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence

from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics_cells import Cell, Table
from swim2real.comparison.statistics_tables import tables


def as_text(table: Table) -> str:
    """A table for a terminal or a text file; the best of a column has a star."""
    body = [[name, *(cell.text + ("*" if cell.is_best else " ") for cell in cells)] for name, cells in table.rows]
    grid = [[name, *(f"{head} " for head in heads)] for name, *heads in (table.columns,)] + body
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


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")
