"""Tables of other programs' logs: CSV with a header, whose columns are taken by name, in whatever unit they are."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.checking import did_you_mean
from swim2real.errors import ArgumentError, TrialError
from swim2real.names import quoted
from swim2real.store import MOST_ROWS
from swim2real.trials.signals import TIME, is_number, read_header, read_lines, read_number
from swim2real.trials.units import factor, unit_of_header, without_unit

Array = NDArray[np.float64]

_TIMES = ("time", "t", "timestamp", "stamp")
_SEPARATORS = ",;\t"
_GAP = 5.0  # usual steps from one row to the next, that make a gap
_MOST_NAMED = 40  # columns in a sentence


@dataclass(frozen=True)
class Column:
    """A column of a log, in the unit that was wanted.

    Attributes:
        header: Its name in the table.
        unit: Unit that it was taken to be in; None where nothing says one.
        values: NaN where a cell is empty. Shape (R,).
    """

    header: str
    unit: str | None
    values: Array

    def __str__(self) -> str:
        return f"'{self.header}'" + (f" in {self.unit}" if self.unit else "")


@dataclass(frozen=True)
class LogTable:
    """A log that was read.

    Attributes:
        path: Its file.
        headers: Names of its columns.
        rows: Number of its line in the file, and its cells, for every row that isn't blank.
        decimal_comma: Whether a comma in a cell is a decimal point, as where columns are separated by semicolons.
    """

    path: Path
    headers: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]
    decimal_comma: bool

    def has(self, text: str) -> bool:
        """Whether a text names a column, with or without its unit."""
        return any(name in self.headers for name in _split(text))

    def column(self, text: str, what: str, into: str = "") -> Column:
        """A column, as numbers.

        Args:
            text: Its name, or NAME:UNIT. Without a unit it is in the one that its name ends in (`hip_deg`,
                `load [mN]`), else in the unit that is wanted.
            what: What it is taken for, such as `sensor 'load'`.
            into: Unit that is wanted; by default that of SI.

        Raises:
            ArgumentError: There is no such column, or its unit isn't known or can't be the one that is wanted.
            TrialError: A cell is no number; the message names line and column.
        """
        named = next((name for name in _split(text) if name in self.headers), None)
        if named is None:
            raise ArgumentError(self.missing(text, what))
        if self.headers.count(named) > 1:
            raise ArgumentError(f"{self.path}: several columns are named '{named}'; give each its own name")
        unit = text[len(named) + 1 :] or unit_of_header(named)
        try:
            scale = 1.0 if unit is None else factor(unit, into)
        except ArgumentError as error:
            remedy = f"; say its unit with '{named}:UNIT'" if named == text else ""
            raise ArgumentError(f"{self.path}: column '{named}' for {what}: {error}{remedy}") from error
        place = self.headers.index(named)
        cells = ((line, row[place].replace(",", ".") if self.decimal_comma else row[place]) for line, row in self.rows)
        values = np.array([read_number(self.path, line, place + 1, cell.strip()) for line, cell in cells])
        return Column(named, unit, scale * values)

    def missing(self, text: str, what: str) -> str:
        """That there is no such column, and which there are."""
        lower = {header.lower(): header for header in self.headers}
        near = next((f"; did you mean '{lower[name.lower()]}'?" for name in _split(text) if name.lower() in lower), "")
        near = near or next(filter(None, (did_you_mean(name, self.headers) for name in _split(text))), "")
        more = f" and {len(self.headers) - _MOST_NAMED} more" if len(self.headers) > _MOST_NAMED else ""
        there = f"{', '.join(map(quoted, self.headers[:_MOST_NAMED]))}{more}"
        end = f"{near} Its" if near else "; its"
        return f"{self.path} has no column '{text}' for {what}{end} columns are {there}"

    def times(self, text: str | None = None) -> Column:
        """The time stamps, rising [s].

        Args:
            text: Name of their column, or NAME:UNIT; by default the first that is called time, t, timestamp or stamp.

        Raises:
            ArgumentError: There is no such column, or its unit is none of time.
            TrialError: One is missing, or they don't rise.
        """
        called = (header for header in self.headers if without_unit(header).lower() in _TIMES)
        column = self.column(text or next(called, TIME), "the time stamps (--time COLUMN:UNIT)", "s")
        times = column.values
        for row in np.flatnonzero(~np.isfinite(times))[:1]:
            line = self.rows[row][0]
            raise TrialError(f"{self.path}, line {line}: no time in column '{column.header}'; each row needs one")
        for row in np.flatnonzero(np.diff(times) <= 0)[:1]:
            told = "is the time of the row above" if times[row + 1] == times[row] else "is before the row above"
            raise TrialError(
                f"{self.path}, line {self.rows[row + 1][0]}: {times[row + 1]:.10g} s {told} "
                f"({times[row]:.10g} s); times must rise, so leave the row out, or cut a log that begins anew in two"
            )
        return column


def read_log(path: Path) -> LogTable:
    """Reads a log: columns separated by commas, semicolons or tabs, with their names in the first line.

    Raises:
        TrialError: It isn't there or isn't such a table; the message names the line.
    """
    lines = read_lines(path)
    first = next((number for number, line in enumerate(lines) if line.strip()), 0)
    header = lines[first] if lines else ""
    separator = max(_SEPARATORS, key=header.count)
    headers = tuple(cell.strip() for cell in read_header(path, [header], separator))
    if len(headers) < 2 or all(map(is_number, headers)):
        raise TrialError(
            f"{path}, line {first + 1}: it must name the columns, separated by commas, semicolons or tabs; it is "
            f"{quoted(header)}"
        )
    rows: list[tuple[int, list[str]]] = []
    reader = csv.reader(lines[first + 1 :], delimiter=separator)
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            line = first + 1 + reader.line_num
            if len(cells) != len(headers):
                raise TrialError(f"{path}, line {line}: {len(cells)} columns; the header has {len(headers)}")
            rows.append((line, cells))
            if len(rows) > MOST_ROWS:
                raise TrialError(f"{path}: more than {MOST_ROWS} rows; cut it into shorter trials, or leave out rows")
    except csv.Error as error:
        raise TrialError(f"{path}, after line {reader.line_num}: not readable as a table ({error})") from error
    if len(rows) < 2:
        raise TrialError(f"{path}: {len(rows)} rows of numbers; a trial needs at least 2")
    return LogTable(path, headers, tuple(rows), separator != ",")


def choices(option: str, texts: Sequence[str], known: Sequence[str], what: str) -> dict[str, str]:
    """What was given as NAME=COLUMN, by name; a name alone stands for a column of the same name.

    Args:
        option: Name of the option, for messages.
        texts: What was given.
        known: Names that there are.
        what: What they are names of, such as "sensor of robot 'arm'".

    Raises:
        ArgumentError: A name isn't known, or is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, column = text.partition("=")
        if not equals:
            name = next((one for one in _split(text) if one in known), text)
        if name not in known:
            near = did_you_mean(name, known) or f"; there are {', '.join(known) or 'none'}"
            raise ArgumentError(f"--{option} has '{text}', and '{name}' is no {what}{near}")
        if name in found:
            raise ArgumentError(f"--{option} has '{name}' twice; give it one column")
        if equals and not column:
            raise ArgumentError(f"--{option} has '{text}'; say {name}=COLUMN, or {name}=COLUMN:UNIT")
        found[name] = column or text
    return found


def gaps(times: Array) -> list[tuple[float, float]]:
    """Where rows are missing: beginning and length of each stretch that is far longer than the usual step [s]."""
    steps = np.diff(times)
    long = np.flatnonzero(steps > _GAP * np.median(steps))
    return [(float(times[row]), float(steps[row])) for row in long]


def _split(text: str) -> tuple[str, ...]:
    """The column that a text may name: all of it, or what is before its unit."""
    name, colon, _ = text.rpartition(":")
    return (text, name) if colon else (text,)
