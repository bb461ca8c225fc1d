"""Tables of numbers as any program writes them: their encoding, their separator, and where header and rows are.

pandas reads the cells. What is found here is what its reader must be told: the rows of the table are the longest run of
lines with as many cells that have a number; the lines just above them with as many cells are the header.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, chain, compress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.names import quoted
from swim2real.store import MOST_ROWS, MOST_TABLE, read_bytes
from swim2real.trials.units import kind_of, known_unit

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

_LARGEST = 1e12  # of a number in a table, in whatever unit
_SEPARATORS = "\t;,| "  # a blank stands for any number of them
_SEPARATOR = re.compile(r'"?sep=(.)"?')  # Excel's first line
_COMMENT = re.compile(r"^\s*(?:#+|%+|//|[-=*]{3,})\s*")
_NEIGHBORS = re.compile(rb"[\x80-\xff]{2}")
_GUESSED = 1 << 16  # bytes from which an encoding is guessed
_DIGITS = "0123456789"
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1b]")
_PLAIN = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_CLOCK = r"\d{1,2}:\d\d(?::\d\d)?(?:[.,:]\d*)?(?: ?[AaPp][Mm])?(?:Z| ?[+-]\d\d:?\d\d)?"
_STAMP = rf"\d{{1,4}}[-/.]\d{{1,2}}[-/.]\d{{1,4}}(?:[ T]{_CLOCK})?|{_CLOCK}|\d{{8}}T\d{{4}}.*"
_number = re.compile(rf"\s*(?:{_PLAIN}|{_STAMP})\s*").fullmatch  # a number or a time
_SIGNS = (
    "#N/A #NA #NV #N/D #DIV/0! #VALUE! #REF! #NUM! #NAME? N/A n/a NA <NA> na NaN nan NAN -nan -NaN nan(ind) -nan(ind) "
    "1.#IND 1.#QNAN -1.#IND -1.#QNAN NULL null None none missing MISSING - -- --- ? . *"
)
_MISSING = ["", *_SIGNS.split()]
_FEWER = 2  # cells that a row above the names may lack: a name over x, y and z stands in the first of the three
_BEGIN, _END, _WIDTH, _KIND = range(4)  # of a record: its first line, the line after it, its cells, and what it is
_BLANK, _NOTE, _TEXT, _NUMBERS = range(4)  # what a record is


@dataclass(frozen=True)
class TextTable:
    """A table that was read.

    Attributes:
        path: Its file.
        names: Names of its K columns; empty where it has no header.
        units: Unit of each column by a row of units, as written there; None where there is none.
        heads: The rows of the header. Shape (H, K).
        stated: Units that the lines above the header state, by what they measure.
        lines: Numbers of the rows' lines in the file. Shape (R,).
        cells: Cells as pandas reads them. Shape (R, K).
        left_out: Which lines among the rows aren't read, in words; empty where all are.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    heads: tuple[tuple[str, ...], ...]
    stated: dict[str, str]
    lines: NDArray[np.int64]
    cells: pd.DataFrame
    left_out: str = ""

    def numbers(self, column: int) -> Array:
        """The numbers of a column, NaN where a cell is empty or infinite, or says that there is none. Shape (R,).

        Raises:
            TrialError: A cell is no number, or beyond ±1e12; the message names line and column.
        """
        import pandas as pd

        cells = self.cells[column]
        if cells.dtype.kind not in "iufb":
            texts = cells.astype("str").str.strip()
            numbers = pd.to_numeric(texts, errors="coerce").astype(float)
            for row in np.flatnonzero((numbers.isna() & cells.notna() & ~texts.isin(_MISSING)).to_numpy())[:1]:
                raise TrialError(
                    f"{self.place(row, column)}: {quoted(str(cells[row]))} is not a number; "
                    "where none is known, leave the cell empty"
                )
            cells = numbers
        values = cells.to_numpy(dtype=float)
        values = np.where(np.isfinite(values), values, np.nan)
        for row in np.flatnonzero(np.abs(values) > _LARGEST)[:1]:
            raise TrialError(f"{self.place(row, column)}: {values[row]:g} is beyond ±{_LARGEST:g}; no reading is")
        return values

    def place(self, row: int, column: int | None = None) -> str:
        """Where a cell or a row stands, for messages."""
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
    import pandas as pd

    text = _read_text(path)
    lines = text.splitlines()
    told = _SEPARATOR.fullmatch(lines[0].strip()) if lines else None
    if told:
        lines[0] = ""
    separators = told[1] if told else [one for one in _SEPARATORS if one in text]
    layout = max(
        filter(None, (_layout(lines, one) for one in separators)), key=lambda layout: layout.score, default=None
    )
    if layout is None:
        raise TrialError(f"{path}: the table is empty: no line has two cells or more with a number among them")
    wide = max(layout.width, *(len(head) for head in layout.heads), 0)
    kept, left_out = _rows(path, lines, layout, wide, cut_off=not text.endswith(("\n", "\r")))
    ends = np.bincount(kept[:, _BEGIN], minlength=len(lines) + 1) - np.bincount(kept[:, _END], minlength=len(lines) + 1)
    block = "\n".join(compress(lines, ends.cumsum() > 0))
    try:
        cells = pd.read_csv(
            io.StringIO(block), sep=r"\s+" if layout.separator == " " else layout.separator, header=None,
            names=list(range(wide)), index_col=False, decimal=_decimal(block, layout.separator),
            na_values=_MISSING, skipinitialspace=True, low_memory=False,
        )  # fmt: skip
    except ValueError as error:
        raise TrialError(f"{path}: not readable as a table ({error})") from error
    heads = [(*head, *("",) * (wide - len(head))) for head in layout.heads]
    names, units = _named(heads, wide)
    numbers = kept[:, _BEGIN] + 1
    width = max(k + 1 for k in range(wide) if (k < layout.width and names[k]) or cells[k].notna().any())
    if layout.heads and not all(names[1:width]):
        raise TrialError(
            f"{path}, line {numbers[0]}: {width} columns; the header names {sum(map(bool, names))}: give each a name"
        )
    kept_heads = tuple(head[:width] for head in heads)
    stated = _stated(lines[: layout.top])
    return TextTable(
        path, names[:width], units[:width], kept_heads, stated, numbers, cells[list(range(width))], left_out
    )  # fmt: skip


def _read_text(path: Path) -> str:
    """The text of a file in whatever encoding it is, of at most 64 MB and a million lines."""
    try:
        content = read_bytes(path, MOST_TABLE)
    except OSError as error:
        raise TrialError(f"{path}: not readable as text ({error.strerror or error})") from error
    except ValueError as error:
        raise TrialError(f"{path}: {error}; cut it into shorter trials, or leave out rows") from error
    for encoding in _encodings(content):
        try:
            text = content.decode(encoding).rstrip("\x1a")
        except (UnicodeDecodeError, LookupError):
            continue
        if text.count("\n") + text.count("\r") > 2 * MOST_ROWS:  # a line's end has at most two characters
            raise TrialError(_too_many(path))
        if not _CONTROL.search(text):
            return text
    raise TrialError(f"{path}: not readable as text; save the table as CSV in UTF-8")


def _encodings(content: bytes) -> Iterator[str]:
    """Encodings that a text may be in, the likeliest first.

    Signs of Western Europe, such as ° and ü, stand alone among others: they tell charset-normalizer too little.
    """
    if b"\0" not in content:
        yield "utf-8-sig"
        if not _NEIGHBORS.search(content):
            yield "cp1252"
    from charset_normalizer import from_bytes

    found = from_bytes(content[:_GUESSED]).best()
    yield from ("utf-8-sig" if found is None else found.encoding, "cp1252")


@dataclass(frozen=True)
class _Layout:
    """Where a table is in a text, if its cells are separated by a character.

    Attributes:
        separator: The character.
        records: First line, line after the last, number of cells and kind of all that the lines hold. Shape (N, 4).
        first: The first of them that is a row of the table.
        width: Cells of a row.
        heads: Rows of the header.
        top: The line at which the header begins.
        score: How well the text is explained; more is better.
    """

    separator: str
    records: NDArray[np.int64]
    first: int
    width: int
    heads: list[list[str]]
    top: int
    score: tuple[int, bool, float]


def _layout(lines: list[str], separator: str) -> _Layout | None:
    """The layout by a separator; None where no line has two cells with a number among them."""
    try:
        records = np.fromiter(chain.from_iterable(_records(lines, separator)), np.int64).reshape(-1, 4)
    except csv.Error:
        return None
    filled = records[records[:, _KIND] >= _TEXT]
    widths = np.where((filled[:, _KIND] == _NUMBERS) & (filled[:, _WIDTH] > 1), filled[:, _WIDTH], 0)
    edges = np.flatnonzero(np.diff(widths, prepend=-1, append=-1))
    runs = np.where(widths[edges[:-1]] > 0, np.diff(edges), 0)
    if not runs.any():
        return None
    longest = int(np.argmax(runs))
    begin, end, width, _ = filled[(edges[longest] + edges[longest + 1]) // 2]
    numeric = [_number(cell) is not None for cell in _split(lines[begin:end], separator)]
    texts = sum(map(_is_text, _split(lines[begin:end], separator)))

    def alike(record: NDArray[np.int64]) -> bool:
        if record[_KIND] != _NUMBERS or record[_WIDTH] != width:
            return False
        cells = _split(lines[record[_BEGIN] : record[_END]], separator)
        return not any(known and _is_text(cell) for known, cell in zip(numeric, cells, strict=True))

    first = next(i for i, record in enumerate(records) if alike(record))
    heads: list[list[str]] = []
    top = int(records[first, _BEGIN])
    for i, (begin, end, cells, kind) in reversed(list(enumerate(records[:first].tolist()))):
        if kind == _BLANK and heads:
            break
        if not heads and cells == width and _number(_split(lines[begin:end], separator)[0]):
            first = i  # a row that isn't like the others: its cell will be named
            continue
        bare = _COMMENT.sub("", lines[begin])
        options = [_split([head, *lines[begin + 1 : end]], separator) for head in (bare, lines[begin])]
        head = min(options, key=lambda cells: abs(len(cells) - width))
        most = max([width, *map(len, heads)]) if heads else len(head)
        if max(2, width - _FEWER) <= len(head) <= most and not _number(next(filter(None, head), "")):
            heads.insert(0, head)
            top = begin
        elif heads or kind >= _TEXT:
            break
    named = any(len(head) == width for head in heads)
    return _Layout(
        separator, records, first, int(width), heads, top,
        (int(runs[longest]), named, sum(numeric) / (sum(numeric) + texts)),
    )  # fmt: skip


def _records(lines: list[str], separator: str) -> Iterator[tuple[int, int, int, int]]:
    """First line, line after the last, number of cells and kind of all that the lines hold."""
    source = [" ".join(line.split()) for line in lines] if separator == " " else lines
    reader = csv.reader(source, delimiter=separator, skipinitialspace=True)
    end = 0
    for cells in reader:
        begin, end = end, reader.line_num
        if _COMMENT.match(lines[begin]) and cells[0].strip() not in _MISSING:
            kind = _NOTE
        elif any(map(_number, cells)):
            kind = _NUMBERS
        else:
            kind = _TEXT if any(map(str.strip, cells)) else _BLANK
        yield begin, end, len(cells), kind


def _split(lines: Sequence[str], separator: str) -> list[str]:
    """The cells of a record."""
    source = [" ".join(line.split()) for line in lines] if separator == " " else lines
    try:
        return [cell.strip() for cell in next(csv.reader(source, delimiter=separator, skipinitialspace=True), [])]
    except csv.Error:
        return list(lines)


def _is_text(cell: str) -> bool:
    """Whether a cell holds neither a number nor a sign that there is none."""
    return cell.strip() not in _MISSING and not _number(cell)


def _rows(path: Path, lines: list[str], layout: _Layout, wide: int, *, cut_off: bool) -> tuple[NDArray[np.int64], str]:
    """First line and line after the last of each row, and in words which lines among them aren't rows.

    Args:
        path: The file, for messages.
        lines: Its lines.
        layout: Where the table is in them.
        wide: Cells that a row may have, as the header.
        cut_off: Whether the last line has no end, and so may be half of one.
    """
    records = layout.records[layout.first :]
    good = (records[:, _KIND] == _NUMBERS) & (layout.width <= records[:, _WIDTH]) & (records[:, _WIDTH] <= wide)
    if good.sum() > MOST_ROWS:
        raise TrialError(_too_many(path))
    odd = records[~good & (records[:, _KIND] >= _TEXT)].tolist()
    for begin, end, width, kind in odd:
        cells = _split(lines[begin:end], layout.separator)
        half = cut_off and end == len(lines)
        if not half and kind == _NUMBERS and 2 * sum(map(bool, map(_number, cells))) >= len(cells):
            raise TrialError(
                f"{path}, line {begin + 1}: {width} columns; the other rows have {layout.width}: mend the line, or "
                f"leave it out"
            )
    said = f"first line {odd[0][_BEGIN] + 1}, {quoted(lines[odd[0][_BEGIN]].strip())}" if odd else ""
    return records[good, :_WIDTH], f"{len(odd)} lines that are no rows are left out, {said}" if odd else ""


def _too_many(path: Path) -> str:
    return f"{path}: more than {MOST_ROWS} rows; cut it into shorter trials, or leave out rows"


def _decimal(block: str, separator: str) -> str:
    """What the numbers of a table have as decimal mark: a comma where there is one and no point."""
    edge = r"\s" if separator == " " else re.escape(separator)
    number = r'(?m)(?:^|{0})[ "]*[+-]?\d*{1}\d+(?:[eE][+-]?\d+)?[ "]*(?:{0}|$)'
    commas = re.search(r'"[+-]?\d*,\d+"' if separator == "," else number.format(edge, ","), block)
    return "," if commas and not re.search(number.format(edge, r"\."), block) else "."


def _named(heads: list[tuple[str, ...]], width: int) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    """Names and units of columns, from the rows above them.

    The names stand in one row, the lowest with most of them, or are put together of as many rows as distinguish them.
    """
    rows = list(heads)
    units: list[str | None] = [None] * width
    for row in rows[:0:-1]:
        cells = [cell.strip("[](){}") for cell in row]
        cells = ["" if cell in _MISSING or cell.isdigit() else cell for cell in cells]
        known = [known_unit(cell) is not None for cell in cells if cell]
        if known and 2 * sum(known) >= len(known):
            units = [cell or None for cell in cells]
            rows.remove(row)
            break
    if not rows:
        return ("",) * width, tuple(units)
    names = max(reversed(rows), key=_distinct)
    if not all(names[1:]) or _distinct(names) < sum(map(bool, names)):
        names = rows[-1]
        for row in sorted(rows[:-1], key=_distinct, reverse=True):
            above = accumulate(row, lambda before, cell: cell or before)
            stems = [name.rstrip(_DIGITS) for name in names]  # X1 and X2 are the X of one thing and of another
            doubled = Counter(stems)
            joined = [
                f"{top} {stem}".strip() if not stem or doubled[stem] > 1 else name
                for top, stem, name in zip(above, stems, names, strict=True)
            ]
            if len(set(joined)) > len(set(names)):
                names = tuple(joined)
    return names, tuple(units)


def _distinct(row: Sequence[str]) -> int:
    return len({cell for cell in row if cell})


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
