"""CSV tables of numbers, and of signals: read with errors that name file, line and column."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.trials.signals import Signals

TIME = "time_s"


def read_signals(table: Path) -> Signals:
    """A table with the header `time_s,NAME,…`; empty cells are NaN.

    Raises:
        TrialError: It can't be read.
    """
    lines = read_lines(table)
    header = next(csv.reader(lines[:1]), [])
    if header[:1] != [TIME] or len(header) < 2:
        raise TrialError(f"{table}, line 1: the header must be {TIME},NAME,…, with a name for each column")
    rows = read_numbers(table, lines[1:], first_line=2)
    if len(rows) == 0 or rows.shape[1] != len(header):
        width = rows.shape[1] if len(rows) else 0
        raise TrialError(f"{table}: {width} columns of numbers; expected {len(header)} columns, as the header")
    try:
        return Signals(rows[:, 0], header[1:], rows[:, 1:])
    except TrialError as error:
        raise TrialError(f"{table}: {error}") from error


def write_signals(signals: Signals, path: Path) -> None:
    """Writes a table that `read_signals` reads back to the last digit."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([TIME, *signals.names])
        for time, row in zip(signals.times, signals.values, strict=True):
            writer.writerow([repr(float(time)), *("" if np.isnan(value) else repr(float(value)) for value in row)])


def read_lines(table: Path) -> list[str]:
    """Lines of a text file."""
    try:
        return table.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TrialError(f"{table}: not readable as text ({error})") from error


def read_numbers(table: Path, lines: list[str], first_line: int) -> NDArray[np.float64]:
    """Rows of numbers, empty cells as NaN; the error names line and column."""
    rows: list[list[float]] = []
    for line, cells in enumerate(csv.reader(lines), start=first_line):
        if not cells:
            continue
        row: list[float] = []
        for column, cell in enumerate(cells, start=1):
            try:
                row.append(float(cell) if cell.strip() else float("nan"))
            except ValueError:
                raise TrialError(f"{table}, line {line}, column {column}: '{cell}' is not a number") from None
        if rows and len(row) != len(rows[0]):
            raise TrialError(f"{table}, line {line}: {len(row)} columns, the rows above have {len(rows[0])}")
        rows.append(row)
    numbers = np.array(rows, dtype=float) if rows else np.empty((0, 0))
    return np.where(np.isinf(numbers), np.nan, numbers)
