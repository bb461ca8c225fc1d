"""Columns of other programs' logs, taken by name, in whatever unit they are and whatever clock they are on."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swim2real.formatting import listed
from swim2real.trials.text_table import TextTable, read_table
from swim2real.trials.units import factor, kind_of, unit_of_header, without_unit
from swimbase.arrays import Array
from swimbase.checking import did_you_mean
from swimbase.errors import ArgumentError, TrialError, about
from swimbase.names import quoted

if TYPE_CHECKING:
    import pandas as pd


_TIMES = ("time", "t", "timestamp", "stamp")
_GAP = 5.0  # usual steps from one row to the next, that make a gap
_MOST_GAPS = 3  # that are reported of a log
_MOST_NAMED = 40  # columns in a sentence
_PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
_EPOCH = 631_152_000, 4_102_444_800  # s since 1970 of 1990 and 2100
_NANO = 1e-9
_CLOCK = re.compile(r"\d[:T]\d")  # in a date or a time of day
_FACTOR = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(.*)", re.IGNORECASE)


Column = tuple[str, Array]
"""A column of a log: its name, unit and factor in words, and its values in the unit that was wanted, of shape (R,)."""


@dataclass(frozen=True)
class Stamps:
    """Time stamps of the rows of a log.

    Attributes:
        words: The column of the stamps, in words.
        first: Stamp of the first row on the log's own clock, such as the one that counts from 1970 [ns].
        values: Times of the rows after the first one, rising [s]. Shape (R,).
        notes: Sentences on what was understood without being said.
    """

    words: str
    first: int
    values: Array
    notes: tuple[str, ...] = ()

    def since(self, zero: int) -> Array:
        """Times of the rows after a moment on the log's own clock [ns]. Shape (R,), in s."""
        return _NANO * (self.first - zero) + self.values


@dataclass(frozen=True)
class LogTable(TextTable):
    """A log that was read."""

    def has(self, text: str) -> bool:
        """True for a text that names a column, with or without its unit."""
        return any(self._named(name) for name in _split(text))

    def column(self, text: str, what: str, into: str = "") -> Column:
        """A column, as numbers; NaN where a cell is empty.

        Args:
            text: Its name, or NAME:UNIT, NAME:FACTOR or NAME:FACTOR UNIT. Without a unit it is in the one that its name
                or the row below its name says (`hip_deg`, `load [mN]`), else in the one that the lines above the table
                state for all, else in the unit that is wanted.
            what: What it is taken for, such as `sensor 'load'`.
            into: Unit that is wanted; by default that of SI.

        Raises:
            ArgumentError: There is no such column, or its unit isn't known or can't be the one that is wanted.
            TrialError: A cell is no number; the message names line and column.
        """
        place, unit, scale = self._chosen(text, what, into)
        return f"'{self.names[place]}'{unit}", scale * self.numbers(place)

    def _chosen(self, text: str, what: str, into: str) -> tuple[int, str, float]:
        """Place of a column, its unit and factor in words, and how many of the wanted unit one of its numbers is."""
        named = next((name for name in _split(text) if self._named(name)), None)
        if named is None:
            raise ArgumentError(self.missing(text, what))
        places = self._named(named)
        headers = [self.names[place] for place in places]
        if len(places) > 1:
            several = f"'{named}' for {what} may be {', '.join(map(quoted, headers))}; give the whole name"
            alike = f"several columns are named '{headers[0]}'; give each its own name"
            raise ArgumentError(f"{self.path}: {alike if len(set(headers)) == 1 else several}")
        place, given = places[0], text[len(named) + 1 :]
        number = _FACTOR.fullmatch(given)
        times, given = (float(number[1]), number[2]) if number else (1.0, given)
        below = None if _CLOCK.search(self.cells[place][0]) else self.units[place]  # of dates it is none
        unit = given or unit_of_header(headers[0]) or below or self.stated.get(kind_of(into))
        remedy = "" if given else f"; say its unit with '{headers[0]}:UNIT'"
        with about(f"{self.path}: column '{headers[0]}' for {what}", remedy):
            scale = times if unit is None else times * factor(unit, into)
        return place, f"{f' in {unit}' * bool(unit)}{f' times {times:g}' * bool(number)}", scale

    def _named(self, text: str) -> list[int]:
        """Places of the columns that a text names: exactly, else without regard to unit, case and signs.

        What is before a name, up to a dot, a slash or a colon, says whose it is, and may be left out.
        """
        names = self.names
        exact = [place for place, name in enumerate(names) if name == text]
        if exact or not (wanted := _words(text)):
            return exact
        called = [_calls(name) for name in names]
        whole = [place for place, calls in enumerate(called) if calls[0] == wanted]
        return whole or [place for place, calls in enumerate(called) if wanted in calls]

    def missing(self, text: str, what: str) -> str:
        """A sentence that there is no such column, with those that there are."""
        near = next(filter(None, (did_you_mean(name, self.names) for name in _split(text))), "")
        return f"{self.path} has no column '{text}' for {what}{f'{near} Its' if near else '; its'} {self._columns}"

    @property
    def _columns(self) -> str:
        odd = "" if "".join(self.names).isascii() else "; where these look wrong, save the table in UTF-8"
        return f"columns are {listed(list(map(quoted, self.names)), _MOST_NAMED)}{odd}"

    def times(self, *texts: str) -> Stamps:
        """The time stamps.

        Args:
            texts: Names of their column, or NAME:UNIT, of which the first that the table has is taken; by default, or
                where it has none, the column that is called time, t, timestamp or stamp, or else is in a unit of time.

        Raises:
            ArgumentError: There is no such column, or its unit is none of time.
            TrialError: One is missing, or they don't rise.
        """
        called = [name for name in self.names if _calls(name)[-1].replace(" ", "") in _TIMES]
        for place, (name, below) in enumerate(zip(self.names, self.units, strict=True)):
            dated = _CLOCK.search(self.cells[place][0]) is not None
            called += [name] if dated or kind_of(unit_of_header(name) or below or "") == "time" else []
        text = next(filter(self.has, texts), next(iter([*called, *texts]), ""))
        if not text:
            raise ArgumentError(
                f"{self.path} has no column that is called time, t, timestamp or stamp: say --time COLUMN:UNIT, or of "
                f"one that counts rows --time COLUMN:SECONDS, as in frame:0.01; its {self._columns}"
            )
        place, unit, scale = self._chosen(text, "the time stamps (--time COLUMN:UNIT)", "s")
        header = self.names[place]
        first, values, unit = self._counted(place, unit, scale)
        steps = np.diff(values)
        notes = [self.left_out] if self.left_out else []
        if not (steps < 0).any() and (steps == 0).any() and (steps > 0).sum() > 1:
            tick = float(np.median(steps[steps > 0]))
            notes.append(
                f"the clock in '{header}' ticks every {1e3 * tick:.4g} ms, and {(steps == 0).sum()} of {len(values)} "
                f"rows have the time of the row above: they are spread evenly, at most one tick off"
            )
            values = _spread(values, tick)
        for row in np.flatnonzero(np.diff(values) <= 0)[:1]:
            before, after = _NANO * first + values[row : row + 2]
            where = f"is {'the time of' if after == before else 'before'} the row above ({before:.10g} s)"
            remedy = "times must rise, so leave the row out, or cut a log that begins anew in two"
            raise TrialError(f"{self.place(row + 1)}: {after:.10g} s {where}; {remedy}")
        steps = np.diff(values)
        long = np.flatnonzero(steps > _GAP * np.median(steps))
        gaps = ", ".join(f"{steps[row]:.3g} s from {values[row] - values[0]:.3f} s on" for row in long[:_MOST_GAPS])
        more = f" and {len(long) - _MOST_GAPS} more" if len(long) > _MOST_GAPS else ""
        if gaps:
            notes.append(f"rows are missing for {gaps}{more}; cut it off with --from and --until if it matters")
        return Stamps(f"'{header}'{unit}", first + round(values[0] / _NANO), values - values[0], tuple(notes))

    def _counted(self, place: int, unit: str, scale: float) -> tuple[int, Array, str]:
        """First stamp [ns], all of them after it [s], and what they are, in words.

        The first one is subtracted before anything else, so that nanoseconds since 1970 keep their last digit.

        Raises:
            TrialError: A row has none.
        """
        texts, dates = self.cells[place], _dates(self.cells[place])
        if dates is None and _CLOCK.search(texts[0]):
            known = "write 2024-06-18T09:40:00.010, 09:40:00.010 or seconds"
            raise TrialError(f"{self.place(0, place)}: {quoted(texts[0])} is no time that is known; {known}")
        numbers = self.numbers(place, math.inf) if dates is None else dates.dt.total_seconds().to_numpy(float)
        for row in np.flatnonzero(np.isnan(numbers))[:1]:
            raise TrialError(f"{self.place(row)}: no time in column '{self.names[place]}'; each row needs one")
        if dates is not None:
            return int(dates[0].value), (dates - dates[0]).dt.total_seconds().to_numpy(float), ", dates or times of day"
        for one, per in _PER_SECOND.items() if not unit else ():
            if _EPOCH[0] * per <= numbers.min() and numbers.max() <= _EPOCH[1] * per:
                unit, scale = f" in {one} since 1970", 1 / per
        stamps = [Decimal(text) for text in texts]
        values = scale * np.array([float(stamp - stamps[0]) for stamp in stamps])
        return round(stamps[0] * Decimal(str(scale)) * 10**9), values, unit


def _dates(cells: Sequence[str]) -> pd.Series[Any] | None:
    """Times of dates since 1970, or of times of day since midnight; None where they are neither."""
    import pandas as pd

    if not _CLOCK.search(cells[0]):
        return None
    texts = pd.Series(cells, dtype=object).str.replace(r",|(?<=:\d\d):(?=\d{3})", ".", regex=True)
    for read in (
        lambda: pd.to_datetime(texts, format="ISO8601", utc=True) - pd.Timestamp(0, tz="UTC"),
        lambda: pd.to_timedelta(texts.str.replace(r"^(\d+:\d\d(?:\.\d*)?)$", r"00:\1", regex=True)),
        lambda: pd.to_datetime(texts, format="mixed", dayfirst=True, utc=True) - pd.Timestamp(0, tz="UTC"),
    ):
        with suppress(ValueError, OverflowError):
            return read()
    return None


def _spread(values: Array, tick: float) -> Array:
    """Times of rows on a clock that is coarser than they are.

    They are even throughout if that explains all stamps, else from one tick to the next.

    Args:
        values: Times that don't fall, of which some are equal [s]. Shape (R,).
        tick: From one tick to the next [s].
    """
    rows, turns = np.arange(len(values)), np.flatnonzero(np.diff(values)) + 1
    step, begin = np.polyfit(rows, values, 1)
    late = values - step * rows - begin
    if np.ptp(late) <= tick + step:
        return step * rows + begin + late.max()  # a row is read at its stamp or later
    step = (values[turns[-1]] - values[turns[0]]) / (turns[-1] - turns[0])
    outside = np.minimum(rows - turns[0], 0) + np.maximum(rows - turns[-1], 0)
    even = np.interp(rows, turns, values[turns]) + step * outside
    return values + np.clip(even - values, -tick, tick)


def read_log(path: Path) -> LogTable:
    """Reads a log.

    Raises:
        TrialError: It isn't there, or is no table with a header; the message names the line.
    """
    table = read_table(path)
    if len(table.names) < 2 or not any(table.names):
        raise TrialError(f"{path}, line {table.lines[0]}: a line above the numbers must name the columns")
    if len(table.lines) < 2:
        raise TrialError(f"{path}: {len(table.lines)} rows of numbers; a trial needs at least 2")
    return LogTable(**vars(table))


def choices(
    option: str, texts: Sequence[str], known: Sequence[str], what: str, behind: Callable[[str], str] = lambda name: ""
) -> dict[str, str]:
    """Columns that were given as NAME=COLUMN, by name; a name alone stands for a column of the same name.

    Args:
        option: Name of the option, for messages.
        texts: What was given.
        known: Names that there are.
        what: What they are names of, such as "sensor of robot 'arm'".
        behind: Where a name is that isn't known, in words; empty where it is nowhere.

    Raises:
        ArgumentError: A name isn't known, or is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, column = text.partition("=")
        if not equals:
            name = next((one for one in _split(text) if one in known), text)
        if name not in known:
            near = behind(name) or did_you_mean(name, known) or f"; there are {', '.join(known) or 'none'}"
            raise ArgumentError(f"--{option} has '{text}', and '{name}' is no {what}{near}")
        if name in found:
            raise ArgumentError(f"--{option} has '{name}' twice; give it one column")
        if equals and not column:
            raise ArgumentError(f"--{option} has '{text}'; say {name}=COLUMN, or {name}=COLUMN:UNIT")
        found[name] = column or text
    return found


def _split(text: str) -> tuple[str, ...]:
    """The column that a text may name: all of it, or what is before its unit."""
    name, colon, _ = text.rpartition(":")
    return (text, name) if colon else (text,)


def _words(text: str) -> str:
    """The letters and digits of a name, its words apart."""
    return " ".join(re.findall(r"[^\W_]+", text.lower()))


def _calls(header: str) -> list[str]:
    """Names of a column without its unit, whole and without whose it is, as in robot/arm.angle."""
    parts = re.split(r"[./:]", without_unit(header))
    return [_words(" ".join(parts[place:])) for place in range(len(parts))]
