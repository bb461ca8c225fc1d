"""Tables of numbers as any program writes them: their encoding, their separator, and where header and rows are.

The rows of the table are like the middle one of the longest run of lines with as many cells that have a number; the
lines just above the first of them with as many cells are the header.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import accumulate, groupby
from pathlib import Path

import numpy as np

from swim2real.trials.units import kind_of, known_unit
from swimbase.arrays import Array
from swimbase.errors import TrialError
from swimbase.names import quoted
from swimbase.store import MOST_ROWS, MOST_TABLE, read_bytes, whole_file

Record = tuple[int, list[str], bool]
"""Its first line, its cells, and whether it is a comment."""

_LARGEST = 1e12  # of a number in a table, in whatever unit
_SEPARATORS = "\t;,| "  # a blank stands for any number of them
_SEPARATOR = re.compile(r'"?sep=(.)"?')  # Excel's first line
_SIGNS = (
    "#N/A #NA #NV #N/D #DIV/0! #VALUE! #REF! #NUM! #NAME? N/A n/a NA <NA> na NaN nan NAN -nan -NaN nan(ind) -nan(ind) "
    "1.#IND 1.#QNAN -1.#IND -1.#QNAN NULL null None none missing MISSING - -- --- ? . *"
)
_MISSING = frozenset(["", *_SIGNS.split()])
_COMMENT = re.compile(r"^\s*(?:#+(?!(?:N/?A|NV|N/D|[A-Z]+(?:/0)?[!?])(?:\W|$))|%+|//|[-=*]{3,}) *")
_NEIGHBORS = re.compile(rb"[\x80-\xff]{2}")
_SAMPLE = 1 << 16  # bytes from which an encoding is guessed
_MIDDLE = 500  # lines before and after the middle of a file, from which its separator is guessed
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1b]")
_PLAIN = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_CLOCK = r"\d{1,2}:\d\d(?::\d\d)?(?:[.,:]\d*)?(?: ?[AaPp][Mm])?(?:Z| ?[+-]\d\d:?\d\d)?"
_STAMP = rf"\d{{1,4}}[-/.]\d{{1,2}}[-/.]\d{{1,4}}(?:[ T]{_CLOCK})?|{_CLOCK}|\d{{8}}T\d{{4}}.*"
_number = re.compile(rf"{_PLAIN}|{_STAMP}").fullmatch  # a number or a time
_DECIMAL = r"(?m)^[+-]?\d*{}\d+(?:[eE][+-]?\d+)?$"
_FEWER = 2  # cells that a row above the names may lack: a name over x, y and z stands in the first of the three


@dataclass(frozen=True)
class TextTable:
    """A table that was read.

    Attributes:
        path: Its file.
        names: Names of its K columns; empty where it has no header.
        units: Unit of each column by a row of units, as written there; None where there is none.
        heads: The rows of the header. Shape (H, K).
        stated: Units that the lines above the table state, by what they measure.
        lines: Numbers of the rows' lines in the file. Shape (R,).
        cells: Texts of the cells, with a decimal point, by column. Shape (K, R).
        left_out: Which lines among the rows aren't read, in words; empty where all are.
    """

    path: Path
    names: Sequence[str]
    units: Sequence[str | None]
    heads: Sequence[Sequence[str]]
    stated: dict[str, str]
    lines: Sequence[int]
    cells: Sequence[Sequence[str]]
    left_out: str = ""

    def numbers(self, column: int, largest: float = _LARGEST) -> Array:
        """The numbers of a column, NaN where a cell is empty or infinite, or says that there is none. Shape (R,).

        Raises:
            TrialError: A cell is no number, or beyond the largest; the message names line and column.
        """
        import pandas as pd

        texts = pd.Series(self.cells[column], dtype=object)
        numbers = pd.to_numeric(texts, errors="coerce").to_numpy(dtype=float)
        for row in np.flatnonzero(np.isnan(numbers) & ~texts.isin(_MISSING).to_numpy())[:1]:
            said = "is not a number; where none is known, leave the cell empty"
            raise TrialError(f"{self.place(row, column)}: {quoted(texts[row])} {said}")
        values = np.where(np.isfinite(numbers), numbers, np.nan)
        for row in np.flatnonzero(np.abs(values) > largest)[:1]:
            raise TrialError(f"{self.place(row, column)}: {values[row]:g} is beyond ±{largest:g}; no reading is")
        return values

    def place(self, row: int, column: int | None = None) -> str:
        """Line and column of a cell, or the line of a row, for messages."""
        return f"{self.path}, line {self.lines[row]}" + ("" if column is None else f", column {column + 1}")

    def matrix(self, wanted: str, width: int = 0, least: int = 1) -> Array:
        """All numbers of a table that must be nothing but rows. Shape (R, K).

        Args:
            wanted: What was wanted, for messages.
            width: Columns that it must have; 0 for any number.
            least: Rows that it must have.

        Raises:
            TrialError: A cell is no number, a line no row, or there are fewer rows or another number of columns.
        """
        if self.left_out:
            raise TrialError(f"{self.path}: {self.left_out}; expected {wanted}")
        numbers = np.stack([self.numbers(column) for column in range(len(self.names))], axis=1)
        if width and len(self.names) != width:
            raise TrialError(f"{self.path}: {len(self.names)} columns; expected {wanted}")
        if len(self.lines) < least:
            raise TrialError(f"{self.path}: one frame only; a trial needs at least {least}")
        return numbers


def read_table(path: Path) -> TextTable:
    """Reads a text file as a table.

    Raises:
        TrialError: The file isn't there, isn't text or is too large, has no row, or one with another number of cells.
    """
    text = _read_text(path)
    lines = text.splitlines()
    given = _SEPARATOR.fullmatch(lines[0].strip()) if lines else None
    if given:
        lines[0] = ""
    middle = lines[max(0, len(lines) // 2 - _MIDDLE) : len(lines) // 2 + _MIDDLE]
    try:
        fits = [_fit(middle, one) for one in (given[1] if given else _SEPARATORS)]
        (longest, *_), separator, numeric = max(fits, key=lambda fit: fit[0])  # of equal ones the first
        records = list(_records(lines, separator))
    except csv.Error as error:
        raise TrialError(f"{path}: not readable as a table ({error}); look for a quote that isn't closed") from error
    if not longest:
        raise TrialError(f"{path}: the table is empty: no line has two cells or more with a number among them")
    first, heads = _header(records, numeric)
    wide = max(len(numeric), *map(len, heads), 0)
    names, units = _named([[*head, *[""] * (wide - len(head))] for head in heads], wide)
    rows: list[tuple[int, list[str]]] = []
    odd: list[int] = []
    for line, cells, comment in records[first:]:
        if comment or not any(cells):
            continue
        if len(numeric) <= len(cells) <= wide and any(map(_number, cells)):
            rows.append((line + 1, [*cells, *[""] * (wide - len(cells))]))
            continue
        odd.append(line)
        whole = line < records[-1][0] or text.endswith(("\n", "\r"))  # and not the half of a line at the end
        if whole and 2 * sum(map(bool, map(_number, cells))) >= len(cells):
            others = f"the other rows have {len(numeric)}: mend the line, or leave it out"
            raise TrialError(f"{path}, line {line + 1}: {len(cells)} columns; {others}")
    numbers, cells = zip(*rows, strict=True)
    columns: list[tuple[str, ...]] = list(zip(*cells, strict=True))
    width = max(k + 1 for k in range(wide) if (k < len(numeric) and names[k]) or any(columns[k]))
    if heads and not all(names[1:width]):
        named = f"the header names {sum(map(bool, names))}: give each a name"
        raise TrialError(f"{path}, line {numbers[0]}: {width} columns; {named}")
    comma, point = (any(re.search(_DECIMAL.format(m), "\n".join(column)) for column in columns) for m in (",", r"\."))
    if comma and not point:
        columns = [tuple(cell.replace(",", ".") for cell in column) for column in columns]
    said = f"first line {odd[0] + 1}, {quoted(lines[odd[0]].strip())}" if odd else ""
    return TextTable(
        path, names[:width], units[:width], [head[:width] for head in heads], _stated(lines[: records[first][0]]),
        numbers, columns[:width], f"{len(odd)} lines that are no rows are left out, {said}" if odd else "",
    )  # fmt: skip


def write_table(path: Path, heads: Iterable[Sequence[str]], rows: Iterable[Sequence[float]]) -> None:
    """Writes a CSV table that is read back to the last digit, whole or not at all; NaN becomes an empty cell."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(heads)
        writer.writerows(["" if value != value else repr(value) for value in row] for row in rows)


def _read_text(path: Path) -> str:
    """The text of a file in whatever encoding it is, of at most 64 MB and a million lines."""
    large = "cut it into shorter trials, or leave out rows"
    try:
        content = read_bytes(path, MOST_TABLE)
    except OSError as error:
        raise TrialError(f"{path}: not readable as text ({error.strerror or error})") from error
    except ValueError as error:
        raise TrialError(f"{path}: {error}; {large}") from error
    for encoding in _encodings(content):
        with suppress(UnicodeDecodeError, LookupError):
            text = content.decode(encoding).rstrip("\x1a")
            if max(text.count("\n"), text.count("\r")) > MOST_ROWS:
                raise TrialError(f"{path}: more than {MOST_ROWS} rows; {large}")
            if not _CONTROL.search(text):
                return text
    raise TrialError(f"{path}: not readable as text; save the table as CSV in UTF-8")


def _encodings(content: bytes) -> Iterator[str]:
    """Encodings that a text may be in, the likeliest first.

    Signs of Western Europe, such as ° and ü, stand alone among others: they are too few for charset-normalizer.
    """
    if b"\0" not in content:
        yield "utf-8-sig"
        if not _NEIGHBORS.search(content):
            yield "cp1252"
    from charset_normalizer import from_bytes

    found = from_bytes(content[:_SAMPLE]).best()
    yield from ("utf-8-sig" if found is None else found.encoding, "cp1252")


def _records(lines: Sequence[str], separator: str) -> Iterator[Record]:
    """The records of a text, by a separator; a comment without its mark."""
    bare = [_COMMENT.sub("", line) for line in lines]
    source = bare if separator != " " else [" ".join(line.split()) for line in bare]
    reader = csv.reader(source, delimiter=separator, skipinitialspace=True)
    end = 0
    for cells in reader:
        begin, end = end, reader.line_num
        yield begin, [cell.strip() for cell in cells], bare[begin] != lines[begin]


def _fit(lines: Sequence[str], separator: str) -> tuple[tuple[int, bool, float], str, list[bool]]:
    """A measure of a separator's fit to lines, more is better; the separator; which cells of a row are numbers."""
    records = [(cells, comment) for _, cells, comment in _records(lines, separator) if any(cells)]
    found = [[not comment and _number(cell) is not None for cell in cells] for cells, comment in records]
    groups = groupby(found, lambda numeric: len(numeric) * (len(numeric) > 1 and any(numeric)))
    run = max((list(run) for width, run in groups if width), key=len, default=[])
    if not run:
        return (0, False, 0.0), separator, []
    row = run[len(run) // 2]
    named = any(len(numeric) == len(row) and not any(numeric) for numeric in found)
    return (len(run), named, sum(row) / len(row)), separator, row


def _header(records: Sequence[Record], numeric: Sequence[bool]) -> tuple[int, list[list[str]]]:
    """Number of a table's first row among records, whose cells are numbers where they are in others, and the header."""
    width = len(numeric)

    def alike(cells: list[str], *, comment: bool) -> bool:
        if comment or len(cells) != width or not any(map(_number, cells)):
            return False
        return all(_number(cell) or cell in _MISSING for known, cell in zip(numeric, cells, strict=True) if known)

    first = next(i for i, (_, cells, comment) in enumerate(records) if alike(cells, comment=comment))
    heads: list[list[str]] = []
    for i, (_, cells, comment) in reversed(list(enumerate(records[:first]))):
        begin = next(filter(None, cells), "")
        if not begin and heads:
            break
        most = max(width, *map(len, heads or [cells]))
        if not heads and len(cells) == width and _number(begin):
            first = i  # a row that isn't like the others: its cell will be named
        elif begin and not _number(begin) and max(2, width - _FEWER) <= len(cells) <= most:
            heads.insert(0, cells)
        elif heads or (begin and not comment):
            break
    return first, heads


def _named(heads: list[list[str]], width: int) -> tuple[tuple[str, ...], Sequence[str | None]]:
    """Names and units of columns, from the rows above them.

    The names stand in one row, the lowest with most of them, or are put together of as many rows as distinguish them.
    """
    rows, units = heads, [None] * width
    for row in heads[:0:-1]:
        cells = [cell.strip("[](){}") for cell in row]
        cells = [None if cell in _MISSING or cell.isdigit() else cell for cell in cells]
        known = [known_unit(cell) is not None for cell in cells if cell]
        if known and 2 * sum(known) >= len(known):
            rows, units = [other for other in heads if other is not row], cells
            break

    def distinct(row: Sequence[str]) -> int:
        return len({*row} - {""})

    names = max(reversed(rows), key=distinct, default=[""] * width)
    if rows and (not all(names[1:]) or distinct(names) < sum(map(bool, names))):
        names = rows[-1]
        for row in sorted(rows[:-1], key=distinct, reverse=True):
            stems = [name.rstrip("0123456789") for name in names]  # X1 and X2 are the X of one thing and of another
            joined = [
                f"{above} {stem}".strip() if not stem or stems.count(stem) > 1 else name
                for above, stem, name in zip(accumulate(row, lambda a, b: b or a), stems, names, strict=True)
            ]
            names = max(names, joined, key=lambda row: len({*row}))
    return tuple(names), units


def _stated(lines: list[str]) -> dict[str, str]:
    """Units that the lines above a table state beside or below the word, by what they measure."""
    rows = [[cell.strip(' "') for cell in re.split(r"[,;\t=:]", line)] for line in lines]
    found: dict[str, str] = {}
    for row, below in zip(rows, [*rows[1:], []], strict=False):
        for i, cell in enumerate(row):
            if cell.lower() == "indegrees" and row[i + 1 : i + 2] == ["yes"]:
                found["angle"] = "deg"
            if re.fullmatch(r"(?i)(.*\W)?units?", cell):
                units = filter(None, map(known_unit, row[i + 1 : i + 2] + below[i : i + 1]))
                found |= {kind_of(unit): unit for unit in units}
    return found
