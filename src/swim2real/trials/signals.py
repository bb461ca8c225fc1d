"""Numbers over time that were recorded beside a video: commands of a controller, readings of sensors; CSV tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swim2real.trials.text_table import read_table, write_table
from swimbase.arrays import Array
from swimbase.errors import TrialError, about
from swimbase.names import label_fault, quoted

TIME = "time_s"  # header of the first column of a table
_ROUNDING = 1e-9  # s
MEMORY = 5.0  # s of commands before a trial begins that tell the state of its actuators


@dataclass(frozen=True)
class Signals:
    """Columns of numbers over time, on the clock of their trial's track.

    Attributes:
        times: Time stamps, rising [s]. Shape (R,).
        names: Names of the columns, each in its own unit.
        values: NaN where nothing was recorded. Shape (R, K).
    """

    times: Array
    names: tuple[str, ...]
    values: Array

    def __init__(self, times: object, names: Sequence[str], values: object) -> None:
        stamps, columns = np.array(times, dtype=float), np.array(values, dtype=float)
        if stamps.ndim != 1 or columns.shape != (stamps.size, len(names)):
            raise TrialError(
                f"values have shape {columns.shape}, times {stamps.shape} and there are {len(names)} names; expected "
                f"(R, K), (R,) and K"
            )
        if not stamps.size:
            raise TrialError("a table of signals needs at least one row")
        if not np.all(np.isfinite(stamps)) or not np.all(np.diff(stamps) > 0):
            raise TrialError("time stamps must be finite and rise from row to row")
        if len(set(names)) < len(names) or not all(names):
            raise TrialError(f"columns are named {', '.join(map(repr, names))}; give each its own name")
        for name in names:
            if fault := label_fault(name):
                raise TrialError(f"column {quoted(name)} {fault}; give it another name")
        stamps.flags.writeable = columns.flags.writeable = False
        vars(self).update(times=stamps, names=tuple(names), values=columns)

    def column(self, name: str) -> Array:
        """Values of the column with a name. Shape (R,).

        Raises:
            TrialError: There is no such column.
        """
        if name not in self.names:
            raise TrialError(f"there is no column '{name}'; there are {', '.join(self.names)}")
        return self.values[:, self.names.index(name)]

    def at(self, name: str, times: Array, over: float = 0.0, *, interpolated: bool = False) -> Array:
        """A column at any times, or its means over a time from these on; the first value counts before its time, too.

        Args:
            name: Name of the column.
            times: Times [s]. Shape (N,).
            over: How long after each the mean is taken [s]; with 0 there are values.
            interpolated: Whether the column goes from row to row on a straight line; else each value holds until the
                next one.

        Raises:
            TrialError: There is no such column, or no value in it.
        """
        from scipy.interpolate import PPoly

        values = self.column(name)
        known = np.isfinite(values)
        if not known.any():
            raise TrialError(f"column '{name}' has no value")
        rows, levels = self.times[known], values[known]
        slopes = interpolated * np.diff(levels) / np.diff(rows)
        ends = np.array([rows[0] - 1, *rows, rows[-1] + 1])  # beyond which it stays as it is there
        curve = PPoly(np.array([[0.0, *slopes, 0.0], [levels[0], *levels]]), ends)
        if not over:
            return curve(times if interpolated else times + _ROUNDING)
        area = curve.antiderivative()
        return (area(times + over) - area(times)) / over

    def check_clock(self, first: float, last: float) -> None:
        """Checks that the rows overlap a track in time, as they do when they are on its clock.

        Args:
            first: Time stamp of the track's first frame [s].
            last: Time stamp of its last frame [s].

        Raises:
            TrialError: All rows are after the track, or all are before it.
        """
        if self.times[0] <= last + _ROUNDING and self.times[-1] >= first - _ROUNDING:
            return
        raise TrialError(
            f"its rows are from {self.times[0]:.10g} s to {self.times[-1]:.10g} s, and the frames that are compared "
            f"from {first:.10g} s to {last:.10g} s; give time_s on the clock of the track, which `track` counts in "
            f"seconds since the video's first frame"
        )

    def between(self, first: float, last: float) -> Signals:
        """The rows from one time to another, both included [s].

        Raises:
            TrialError: There is no such row.
        """
        self.check_clock(first, last)
        kept = (self.times >= first - _ROUNDING) & (self.times <= last + _ROUNDING)
        if not kept.any():
            raise TrialError(
                f"there is no row between {first:g} s and {last:g} s; the rows are from {self.times[0]:g} s to "
                f"{self.times[-1]:g} s; cut off less, or leave the table out"
            )
        return Signals(self.times[kept], self.names, self.values[kept])

    def cut(self, first: float, last: float, *, before: float | None = None) -> Signals:
        """The rows from one time to another, both included, with their times counted from the first.

        Args:
            first: Where times are counted from [s].
            last: Where the rows end [s].
            before: Of commands, which count until the next row: how long before the first time they are kept, too [s].
                What holds where that begins has a row there, and what holds at the first time where no other follows.

        Raises:
            TrialError: There is no such row.
        """
        if before is None:
            rows = self.between(first, last)
            return Signals(rows.times - first, self.names, rows.values)
        if self.times[0] > first + _ROUNDING:
            self.check_clock(first, last)
        kept = self.times <= last + _ROUNDING
        times, values = self.times[kept] - first, self.values[kept]
        latest = np.where(np.isfinite(values), np.arange(len(times))[:, None], 0)
        held = np.take_along_axis(values, np.maximum.accumulate(latest, axis=0), axis=0)
        begin = max(int(np.searchsorted(times, _ROUNDING - before, side="right")) - 1, 0)
        times, values = np.maximum(times[begin:], -before), np.vstack([held[begin], values[begin + 1 :]])
        if times[-1] < -_ROUNDING:
            times, values = np.append(times, 0.0), np.vstack([values, held[-1]])
        return Signals(times, self.names, values)


def read_signals(path: Path) -> Signals:
    """Reads a table with the header `time_s,NAME,…`; empty cells are NaN.

    Raises:
        TrialError: The table can't be read; the message names the file, and where it can line and column.
    """
    table = read_table(path)
    wanted = f"{TIME},NAME,…, with a name for each column"
    if table.names[:1] != (TIME,) or len(table.names) < 2:
        raise TrialError(f"{path}, line 1: the header must be {wanted}")
    rows = table.matrix(wanted)
    with about(path):
        return Signals(rows[:, 0], table.names[1:], rows[:, 1:])


def write_signals(signals: Signals, path: Path) -> None:
    """Writes a CSV table that `read_signals` reads back to the last digit, whole or not at all."""
    write_table(path, [[TIME, *signals.names]], np.column_stack([signals.times, signals.values]).tolist())
