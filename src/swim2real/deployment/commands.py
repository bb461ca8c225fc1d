"""Tables of motor commands: speeds [rad/s] at 50 Hz, their file, their limits, their ramps."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swim2real.deployment.control_table import VELOCITY_LIMIT, VELOCITY_UNIT
from swim2real.errors import ArgumentError
from swim2real.store import write_text

RATE = 50  # Hz
HEADER = ("time_s", "velocity_rad_s")
_TIME_TOLERANCE = 1e-4  # s, of a time stamp in a file
_ROUNDING = 1e-9  # rad/s


@dataclass(frozen=True)
class Limits:
    """Limits of the commands.

    Attributes:
        speed: Greatest speed, either way [rad/s].
        acceleration: Greatest change of the speed [rad/s²].
    """

    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        for name, value in (("speed", self.speed), ("acceleration", self.acceleration)):
            if not (math.isfinite(value) and value > 0):
                raise ArgumentError(f"the limit of the {name} is {value:g}; it must be finite and above 0")


XW540_T140 = Limits(VELOCITY_LIMIT.default * VELOCITY_UNIT, 100.0)
"""Of the Dynamixel XW540-T140-R as it is sold.

Speed: Velocity Limit (44) is 304 of 0.229 rev/min, 69.6 rev/min or 7.29 rad/s (e-Manual); without load the motor turns
72 rev/min at 12.0 V. Acceleration: a choice, 2 rad/s from one command to the next. The manual gives none but the range
of Profile Acceleration (108), to 12,271 rad/s², which no load follows.
"""


@dataclass(frozen=True)
class CommandTable:
    """Motor speeds at 50 Hz. The speed of row k holds from its time to that of the next row.

    Attributes:
        times: Times k/50 from 0 on [s].
        velocities: Speeds, positive as the motor counts [rad/s].
    """

    times: tuple[float, ...]
    velocities: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.velocities):
            raise ArgumentError(f"a table has {len(self.times)} times and {len(self.velocities)} velocities")
        if not self.times:
            raise ArgumentError("a table of commands has no rows; it needs at least one")
        for k, (time, velocity) in enumerate(zip(self.times, self.velocities, strict=True)):
            if problem := _problem(k, time, velocity):
                raise ArgumentError(f"command {k}: {problem[1]}")

    @staticmethod
    def of(velocities: Iterable[float]) -> CommandTable:
        """The table of these speeds [rad/s], from time 0 on."""
        speeds = tuple(float(v) for v in velocities)
        return CommandTable(tuple(k / RATE for k in range(len(speeds))), speeds)

    @property
    def duration(self) -> float:
        """Length of the table [s], the last command included."""
        return len(self.times) / RATE

    @property
    def speed(self) -> float:
        """Greatest speed, either way [rad/s]."""
        return max(map(abs, self.velocities))

    @property
    def acceleration(self) -> float:
        """Greatest change from one row to the next [rad/s²], without those from and to rest."""
        return max((abs(b - a) * RATE for a, b in zip(self.velocities, self.velocities[1:], strict=False)), default=0.0)

    def within(self, limits: Limits) -> CommandTable:
        """Checks the table and returns it.

        Raises:
            ArgumentError: A row asks for more than the limits; the message names the first one.
        """
        before = self.velocities[0]
        for time, velocity in zip(self.times, self.velocities, strict=True):
            if abs(velocity) > limits.speed + _ROUNDING:
                raise ArgumentError(
                    f"the command at {time:.2f} s is {velocity:g} rad/s; the limit is {limits.speed:.4g} rad/s "
                    f"either way: make the table slower, or ask for clipping"
                )
            if abs(velocity - before) > limits.acceleration / RATE + _ROUNDING:
                raise ArgumentError(
                    f"the command at {time:.2f} s goes from {before:g} to {velocity:g} rad/s, "
                    f"{abs(velocity - before) * RATE:.4g} rad/s²; the limit is {limits.acceleration:.4g} rad/s²: "
                    f"make the table smoother, or ask for clipping"
                )
            before = velocity
        return self

    def clipped(self, limits: Limits) -> CommandTable:
        """The nearest table that can be followed: speeds cut off, and no change steeper than allowed."""
        step = limits.acceleration / RATE
        speeds: list[float] = []
        for velocity in self.velocities:
            wanted = min(max(velocity, -limits.speed), limits.speed)
            speeds.append(min(max(wanted, speeds[-1] - step), speeds[-1] + step) if speeds else wanted)
        return CommandTable(self.times, tuple(speeds))

    def ramped(self, acceleration: float) -> CommandTable:
        """The same commands between ramps from and to rest, which add rows; none where they begin or end at rest."""
        start = _ramp(self.velocities[0], acceleration)
        end = _ramp(self.velocities[-1], acceleration)[::-1]
        return CommandTable.of((*start, *self.velocities, *end))

    def repeated(self, times: int) -> CommandTable:
        """The commands several times, one after the other."""
        if times < 1:
            raise ArgumentError(f"a table can't be repeated {times} times; it must be 1 or more")
        return CommandTable.of(self.velocities * times)


def read_table(path: str | Path) -> CommandTable:
    """Reads a CSV file with the header `time_s,velocity_rad_s` and 50 rows a second from 0 s on.

    Raises:
        ArgumentError: The file can't be read or a cell in it is wrong; the message names line and column.
    """
    file = Path(path)
    try:
        with file.open(newline="", encoding="utf-8-sig") as lines:
            rows = list(csv.reader(lines))
    except OSError as error:
        raise ArgumentError(f"command table '{file}' can't be read: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ArgumentError(f"command table '{file}' is not a CSV text file: {error}") from error
    header = tuple(cell.strip() for cell in rows[0]) if rows else ()
    if header != HEADER:
        raise ArgumentError(f"{file.name} line 1: the header is '{','.join(header)}'; it must be '{','.join(HEADER)}'")
    while len(rows) > 1 and not rows[-1]:
        rows.pop()
    if len(rows) == 1:
        raise ArgumentError(f"{file.name}: there are no commands below the header; one row for every 0.02 s is needed")
    times: list[float] = []
    velocities: list[float] = []
    for k, row in enumerate(rows[1:]):
        line = f"{file.name} line {k + 2}"
        if len(row) != len(HEADER):
            raise ArgumentError(f"{line}: there are {len(row)} columns; there must be {len(HEADER)}")
        cells = [_number(cell, f"{line}, column {name}") for cell, name in zip(row, HEADER, strict=True)]
        if problem := _problem(k, cells[0], cells[1]):
            raise ArgumentError(f"{line}, column {problem[0]}: {problem[1]}")
        times.append(k / RATE)
        velocities.append(cells[1])
    return CommandTable(tuple(times), tuple(velocities))


def write_table(path: str | Path, times: Sequence[float], velocities: Sequence[float]) -> CommandTable:
    """Writes motor speeds [rad/s] at times k/50 s, and returns them as a table.

    Raises:
        ArgumentError: They don't make a table, or the file can't be written.
    """
    table = CommandTable(tuple(float(t) for t in times), tuple(float(v) for v in velocities))
    lines = [",".join(HEADER), *(f"{k / RATE:.2f},{velocity!r}" for k, velocity in enumerate(table.velocities))]
    try:
        write_text(path, "\n".join(lines) + "\n")
    except OSError as error:
        raise ArgumentError(f"command table '{path}' can't be written: {error.strerror or error}") from error
    return table


def _problem(k: int, time: float, velocity: float) -> tuple[str, str] | None:
    """The column of row k that is wrong, and what is wrong in it; None where nothing is."""
    if not abs(time - k / RATE) <= _TIME_TOLERANCE:
        return HEADER[0], f"the time is {time:g} s; it must be {k / RATE:g}, since rows are 0.02 s apart from 0 on"
    if not math.isfinite(velocity):
        return HEADER[1], f"the velocity is {velocity:g}; it must be finite, in rad/s"
    return None


def _number(cell: str, where: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise ArgumentError(f"{where}: '{cell}' is not a number") from None


def _ramp(velocity: float, acceleration: float) -> tuple[float, ...]:
    """Speeds from rest up to, but without, a velocity: equal steps, none steeper than the acceleration."""
    if not (math.isfinite(acceleration) and acceleration > 0):
        raise ArgumentError(f"the ramps' acceleration is {acceleration:g}; it must be finite and above 0")
    steps = math.ceil(abs(velocity) * RATE / acceleration - _ROUNDING)
    return tuple(velocity * k / steps for k in range(steps))
