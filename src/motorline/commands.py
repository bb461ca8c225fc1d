"""Tables of commands at 50 Hz: a column an actuator, their file, their limits, their ramps."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from motorline.control_table import XW540
from swimbase.errors import ArgumentError
from swimbase.store import MOST_ROWS, MOST_TABLE, read_text, write_text, writing

RATE = 50  # Hz
TIME = "time_s"
FISH = "velocity_rad_s"
"""The column of the fish's tables: the speed of its one motor."""
_SPEEDS = ("rad_s", "m_s")  # units of speeds; any other unit is what follows the last underscore
_TIME_TOLERANCE = 1e-4  # s, of a time stamp in a file
_ROUNDING = 1e-9  # rad, rad/s


@dataclass(frozen=True)
class MotorLimits:
    """MotorLimits of one column.

    Attributes:
        speed: Greatest speed, either way [rad/s].
        acceleration: Greatest change of the speed [rad/s²]. A column of angles isn't checked against it: the motor
            keeps it by itself.
        lowest: Lowest angle [rad]; of no account for a column of speeds.
        highest: Highest angle [rad]; of no account for a column of speeds.
    """

    speed: float
    acceleration: float
    lowest: float = -math.inf
    highest: float = math.inf

    def __post_init__(self) -> None:
        for name, value in (("speed", self.speed), ("acceleration", self.acceleration)):
            if not (math.isfinite(value) and value > 0):
                raise ArgumentError(f"the limit of the {name} is {value:g}; it must be finite and above 0")
        if not self.lowest < self.highest:
            raise ArgumentError(f"the lowest angle is {self.lowest:g} and the highest {self.highest:g}; swap them")


ACCELERATION = 100.0  # rad/s²
XW540_T140 = MotorLimits(XW540.speed, ACCELERATION)
"""Of the Dynamixel XW540-T140-R as it is sold.

Speed: Velocity Limit (44) is 304 of 0.229 rev/min, 69.6 rev/min or 7.29 rad/s (e-Manual); without load the motor turns
72 rev/min at 12.0 V. Acceleration: a choice, 2 rad/s from one command to the next. The manual gives none but the range
of Profile Acceleration (108), to 12,271 rad/s², which no load follows.
"""


@dataclass(frozen=True)
class CommandTable:
    """Commands at 50 Hz. Row k is due at k/50 s and holds until the next.

    Attributes:
        columns: Names with units, one an actuator: `NAME_rad_s` is a speed, and so is `NAME_m_s`; `NAME_rad` is an
            angle. Any other unit counts as a position.
        rows: Values in the order of the columns, in their units, positive as the actuator counts.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if problem := _header_problem((TIME, *self.columns)):
            raise ArgumentError(f"a table of commands can't have these columns: {problem}")
        if not self.rows:
            raise ArgumentError("a table of commands has no rows; it needs at least one")
        for k, row in enumerate(self.rows):
            if len(row) != len(self.columns) or not all(map(math.isfinite, row)):
                raise ArgumentError(f"command {k} is {row}; it needs a finite number for each of {self.columns}")

    @staticmethod
    def of(columns: Mapping[str, Iterable[float]]) -> CommandTable:
        """The table of these columns, from time 0 on.

        Raises:
            ArgumentError: A name isn't allowed, a value isn't finite, or the columns differ in length.
        """
        values = {name: tuple(map(float, column)) for name, column in columns.items()}
        lengths = {name: len(column) for name, column in values.items()}
        if len(set(lengths.values())) > 1:
            raise ArgumentError(f"the columns of a table differ in length ({lengths}); they must have the same")
        return CommandTable(tuple(values), tuple(zip(*values.values(), strict=True)))

    @property
    def duration(self) -> float:
        """Length of the table [s], the last command included."""
        return len(self.rows) / RATE

    def column(self, name: str) -> tuple[float, ...]:
        """The values of a column, in its unit."""
        k = self._place(name)
        return tuple(row[k] for row in self.rows)

    def speed(self, name: str) -> float:
        """Greatest speed of a column, either way [rad/s]; of an angle, the greatest change from row to row."""
        values = self.column(name)
        return max(map(abs, values)) if is_speed(name) else _steepest(values)

    def acceleration(self, name: str) -> float:
        """Greatest change of a column of speeds from row to row [rad/s²], without those from and to rest."""
        return _steepest(self.column(name))

    def within(self, limits: Mapping[str, MotorLimits]) -> CommandTable:
        """Checks the table and returns it.

        Args:
            limits: MotorLimits by column; a column that isn't named has none.

        Raises:
            ArgumentError: A row asks for more than the limits; the message names the first one of a column.
        """
        for name, limit in limits.items():
            _check(name, self.column(name), limit)
        return self

    def clipped(self, limits: Mapping[str, MotorLimits]) -> CommandTable:
        """The nearest table that can be followed: values cut off, and no change steeper than allowed.

        Args:
            limits: MotorLimits by column; a column that isn't named stays as it is.
        """
        clipped = {name: _clip(name, self.column(name), limit) for name, limit in limits.items()}
        return CommandTable.of({name: clipped.get(name, self.column(name)) for name in self.columns})

    def ramped(self, acceleration: float) -> CommandTable:
        """The same commands between ramps of the speeds from and to rest, while the other columns hold their values.

        The ramps add rows; none where all speeds begin or end at rest. All speeds take the same time.

        Args:
            acceleration: Of the speed that changes most [rad/s²].

        Raises:
            ArgumentError: The acceleration isn't above 0, or so low that a ramp would be longer than a table may be.
        """
        if not (math.isfinite(acceleration) and acceleration > 0):
            raise ArgumentError(f"the ramps' acceleration is {acceleration:g}; it must be finite and above 0")

        def ramp(row: tuple[float, ...]) -> list[tuple[float, ...]]:
            """Rows from rest up to, but without, a row: equal steps, none steeper than the acceleration."""
            fastest = max((abs(v) for name, v in zip(self.columns, row, strict=True) if is_speed(name)), default=0.0)
            steps = _steps(fastest, acceleration, f"a ramp from rest to {fastest:g} at {acceleration:g} rad/s²")
            return [
                tuple(v * k / steps if is_speed(name) else v for name, v in zip(self.columns, row, strict=True))
                for k in range(steps)
            ]

        return CommandTable(self.columns, (*ramp(self.rows[0]), *self.rows, *ramp(self.rows[-1])[::-1]))

    def approached(self, angles: Mapping[str, float], speed: float) -> CommandTable:
        """The same commands after a way from these angles to the first row, which adds rows; speeds are 0 meanwhile.

        Args:
            angles: Where the actuators are now, by column [rad]. They leave and arrive together.
            speed: Of the actuator with the longest way [rad/s].

        Raises:
            ArgumentError: The speed isn't above 0, or so low that the way would be longer than a table may be.
        """
        if not (math.isfinite(speed) and speed > 0):
            raise ArgumentError(f"the speed of the approach is {speed:g}; it must be finite and above 0")
        first = self.rows[0]
        ways = {self._place(name): angle - first[self._place(name)] for name, angle in angles.items()}
        longest = max(map(abs, ways.values()), default=0.0)
        steps = _steps(longest, speed, f"the way of {longest:g} rad to the first angles at {speed:g} rad/s")

        def row(left: float) -> tuple[float, ...]:
            return tuple(
                0.0 if is_speed(name) else value + left * ways.get(k, 0.0)
                for k, (name, value) in enumerate(zip(self.columns, first, strict=True))
            )

        return CommandTable(self.columns, (*(row(1 - k / steps) for k in range(steps)), *self.rows))

    def _place(self, name: str) -> int:
        if name not in self.columns:
            raise ArgumentError(f"there is no column {name} in the table; it has {', '.join(self.columns)}")
        return self.columns.index(name)


def is_speed(column: str) -> bool:
    """True if a column is of speeds: its unit is rad/s or m/s."""
    return split_column(column)[1] in _SPEEDS


def split_column(column: str) -> tuple[str, str]:
    """The actuator and the unit that the name of a column consists of: `servo1` and `rad` of `servo1_rad`."""
    for unit in _SPEEDS:
        if column.endswith(f"_{unit}"):
            return column.removesuffix(f"_{unit}"), unit
    name, _, unit = column.rpartition("_")
    return name, unit


def read_table(path: str | Path) -> CommandTable:
    """Reads a CSV file with `time_s` and a column per actuator in its header, and 50 rows per second from 0 s on.

    Raises:
        ArgumentError: The file can't be read or a cell in it is wrong; the message names line and column.
    """
    file = Path(path)
    try:
        text = read_text(file, MOST_TABLE, "utf-8-sig")
        if text.count("\n") > MOST_ROWS:
            raise ArgumentError(f"{file.name}: more than {MOST_ROWS} rows; send it in parts")
        cells = list(csv.reader(io.StringIO(text, newline="")))
    except OSError as error:
        raise ArgumentError(f"command table '{file}' can't be read: {error.strerror or error}") from error
    except (ValueError, csv.Error) as error:
        raise ArgumentError(f"command table '{file}' is not a CSV text file: {error}") from error
    header = tuple(cell.strip() for cell in cells[0]) if cells else ()
    if problem := _header_problem(header):
        raise ArgumentError(f"{file.name} line 1: the header is '{','.join(header)}'; {problem}")
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    if len(cells) == 1:
        raise ArgumentError(f"{file.name}: there are no commands below the header; one row for every 0.02 s is needed")
    rows: list[tuple[float, ...]] = []
    for k, line in enumerate(cells[1:]):
        where = f"{file.name} line {k + 2}"
        if len(line) != len(header):
            raise ArgumentError(f"{where}: there are {len(line)} columns; there must be {len(header)}")
        time, *row = [_number(cell, f"{where}, column {name}") for cell, name in zip(line, header, strict=True)]
        if not abs(time - k / RATE) <= _TIME_TOLERANCE:
            raise ArgumentError(
                f"{where}, column {TIME}: the time is {time:g} s; it must be {k / RATE:g}, "
                f"since rows are 0.02 s apart from 0 on"
            )
        rows.append(tuple(row))
    return CommandTable(header[1:], tuple(rows))


def write_table(path: str | Path, table: CommandTable) -> None:
    """Writes a table, from which `read_table` gets the same one.

    Raises:
        ArgumentError: The file can't be written.
    """
    lines = [",".join((TIME, *table.columns))]
    lines += [",".join((f"{k / RATE:.2f}", *map(repr, row))) for k, row in enumerate(table.rows)]
    with writing(path, ArgumentError, what="command table"):
        write_text(path, "\n".join(lines) + "\n")


def _bounds(name: str, limits: MotorLimits) -> tuple[float, float, float]:
    """The lowest and the highest value of a column, and its greatest change a second."""
    if is_speed(name):
        return -limits.speed, limits.speed, limits.acceleration
    return limits.lowest, limits.highest, limits.speed


def _check(name: str, values: Sequence[float], limits: MotorLimits) -> None:
    """Raises what the first value beyond the limits asks for."""
    unit, (low, high, rate) = split_column(name)[1].replace("_", "/"), _bounds(name, limits)
    rate_unit, before = f"{unit}²" if is_speed(name) else f"{unit}/s", values[0]
    for k, value in enumerate(values):
        command, cut = f"{name}: the command at {k / RATE:.2f} s", "or cut it off at the limits with --clip"
        if not low - _ROUNDING <= value <= high + _ROUNDING:
            raise ArgumentError(
                f"{command} is {value:g} {unit}; the limits are {low:.4g} to {high:.4g} {unit}: change the table, {cut}"
            )
        if abs(value - before) > rate / RATE + _ROUNDING:
            raise ArgumentError(
                f"{command} goes from {before:g} to {value:g} {unit}, {abs(value - before) * RATE:.4g} {rate_unit}; "
                f"the limit is {rate:.4g} {rate_unit}: make the table smoother, {cut}"
            )
        before = value


def _clip(name: str, values: Sequence[float], limits: MotorLimits) -> list[float]:
    low, high, rate = _bounds(name, limits)
    clipped: list[float] = []
    for value in values:
        wanted = min(max(value, low), high)
        step = rate / RATE
        clipped.append(min(max(wanted, clipped[-1] - step), clipped[-1] + step) if clipped else wanted)
    return clipped


def _steps(change: float, rate: float, what: str) -> int:
    """Rows of a steady change, before one is made."""
    steps = change * RATE / rate - _ROUNDING
    if steps > MOST_ROWS:
        raise ArgumentError(f"{what} would take {steps:.3g} commands; at most {MOST_ROWS} are made: make it faster")
    return math.ceil(steps)


def _steepest(values: Sequence[float]) -> float:
    """Greatest change a second from one value to the next."""
    return max((abs(b - a) * RATE for a, b in pairwise(values)), default=0.0)


def _header_problem(header: Sequence[str]) -> str:
    """Error in a header, in a sentence; empty if there is none."""
    wanted = f"it must be {TIME} and a column an actuator, as '{TIME},{FISH}' or '{TIME},servo1_rad,servo2_rad'"
    if len(header) < 2 or header[0] != TIME:
        return wanted
    for k, column in enumerate(header[1:], start=1):
        if not all(split_column(column)) or any(sign in column for sign in ',"\r\n') or column != column.strip():
            return f"'{column}' isn't a name and a unit, as servo1_rad is; {wanted}"
        if column in header[:k]:
            return f"the column {column} is there twice; {wanted}"
    return ""


def _number(cell: str, where: str) -> float:
    try:
        value = float(cell) if cell.isascii() and "_" not in cell else math.nan  # Python reads ٣ and 0_1 as well
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ArgumentError(f"{where}: '{cell}' is not a finite number; write it with the digits 0 to 9, as -0.25")
    return value
