"""Sends a table of commands to started motors on schedule, reads back what they do, and keeps a log."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from motorline.commands import FISH, RATE, CommandTable, is_speed
from motorline.control_table import MotorError, NoAnswerError, check_baud
from motorline.motors import Motors, Reading
from motorline.motors_file import MotorSettings
from motorline.schedule import Punctuality, Schedule
from swimbase.errors import ArgumentError
from swimbase.store import writing

_READ = ("read_s", "velocity_rad_s", "position_rad", "voltage_v", "temperature_c")
_MOST_UNANSWERED = 10  # exchanges in a row without an answer before sending ends; the watchdog is as quick
_FEWEST_UNANSWERED = 3  # of one motor among several
_WHOLE_EVERY = RATE // 2  # readings of a motor; the first of them has voltage and temperature
_LONGEST_UNREAD = RATE // 2  # rows without a reading; then one of several motors is read even if a command is delayed
_COMMAND_BYTES = 16 + 11  # a command to one motor, and its answer
_TOGETHER_BYTES = 14  # a command to several, and 5 more for each
_READING_BYTES = 14 + 11 + 19  # the question, and the longest answer
_READING_EXTRA = 0.004  # s: the adapter, the motor's return delay
_MOST_TIME = 0.95  # of the time between two commands, for a command and a reading


@dataclass(frozen=True)
class SendingResult:
    """Result of sending a table's commands.

    Attributes:
        punctuality: Lateness of the commands.
        unanswered: Commands that the one motor didn't answer, or that couldn't be sent.
        unread: Readings that weren't answered.
        seconds: Time of the table that was sent [s].
        complete: Whether all of the table was sent.
        temperature: Highest temperature of all motors [°C]; None without a reading of it.
        voltage: Lowest voltage [V]; None without a reading of it.
    """

    punctuality: Punctuality
    unanswered: int
    unread: int
    seconds: float
    complete: bool
    temperature: int | None
    voltage: float | None


def send(
    motors: Motors, table: CommandTable, log: TextIO | None = None, stop: Callable[[], bool] = lambda: False
) -> SendingResult:
    """Sends each row when it is due, and reads back one motor in turn after it. The motors must have been started.

    Args:
        motors: Motors that turn.
        table: Commands, a column per motor.
        log: File that gets a line per row, under the columns of `open_log`.
        stop: Called before every row; sending ends when it returns true.

    Raises:
        MotorError: A motor refused, failed, or didn't answer several exchanges in a row.
    """
    bus, several = motors.bus, len(motors.each) > 1
    lateness: list[float] = []
    unanswered = in_a_row = 0
    readings = _Readings(motors)
    # one motor has answered its command before it is read
    leaving = _command_bytes([motor.settings for motor in motors.each]) if several else 0
    reading_takes = (leaving + _READING_BYTES) * 10 / bus.baud + _READING_EXTRA
    last = asked_at = -1
    schedule = Schedule()
    for k in schedule.ticks(len(table.rows), stop):
        last, wanted, before = k, table.rows[k], bus.written_at
        try:
            wanted, answered, in_a_row = motors.command(wanted), True, 0
        except NoAnswerError as error:
            answered, unanswered, in_a_row = False, unanswered + 1, in_a_row + 1
            if in_a_row == _MOST_UNANSWERED:
                raise MotorError(f"{in_a_row} commands in a row without an answer: {error}") from error
        lateness.append(schedule.sent(k, bus.written_at))
        sent_at = bus.written_at - schedule.start
        if bus.written_at - before > motors.watchdog:
            readings.doubt_all()
        turn: tuple[str, bool, Reading | None] | None = None
        if (several and k - asked_at >= _LONGEST_UNREAD) or schedule.left(k + 1) > reading_takes:
            asked_at, turn = k, readings.next()
        if log:
            asked = [turn[0], str(int(turn[1]))] if turn else ["", ""]
            cells = [f"{k / RATE:.2f}", f"{sent_at:.6f}", *(f"{command:.6f}" for command in wanted)]
            cells += asked if several else [str(int(answered))]
            cells += _reading_cells(turn[2] if turn else None, bus.written_at - schedule.start)
            log.write(",".join(cells) + "\n")
    complete = last == len(table.rows) - 1
    if complete:
        schedule.wait_until(schedule.due(last + 1))  # the last command holds as long as the others
    return SendingResult(
        Punctuality.of(lateness, schedule.skipped), unanswered, readings.unread, (last + 1) / RATE, complete,
        max(readings.temperatures, default=None), min(readings.voltages, default=None),
    )  # fmt: skip


class _Readings:
    """Asks one motor in turn what it does, and counts the answers that are missing.

    Commands to several motors aren't answered. So a motor that is dead shows here: as many of its answers may be
    missing in a row as take the time of ten commands, but at least three. And a motor that may have been stopped by its
    watchdog, since it missed packets, is asked that instead.
    """

    def __init__(self, motors: Motors) -> None:
        count = len(motors.each)
        self._motors = motors.each
        self._most = max(_FEWEST_UNANSWERED, math.ceil(_MOST_UNANSWERED / count)) if count > 1 else math.inf
        self._asked = 0
        self._answered = [0] * count
        self._missing = [0] * count
        self._doubted = [False] * count
        self.unread = 0
        self.temperatures: list[int] = []
        self.voltages: list[float] = []

    def doubt_all(self) -> None:
        """Notes that the watchdogs of all motors may have stopped them."""
        self._doubted = [len(self._motors) > 1] * len(self._motors)  # one motor's answers to commands tell

    def next(self) -> tuple[str, bool, Reading | None]:
        """Asks the motor whose turn it is.

        Returns:
            Its name, whether it answered, and what it does: None without an answer, or where its watchdog was asked.

        Raises:
            MotorError: It has failed, was stopped by its watchdog, or doesn't answer for too long.
        """
        k = self._asked % len(self._motors)
        self._asked += 1
        motor, reading = self._motors[k], None
        try:
            if self._doubted[k]:
                motor.check_watchdog()
                self._doubted[k] = False
            else:
                reading = motor.read(whole=self._answered[k] % _WHOLE_EVERY == 0)
                self._answered[k] += 1
        except NoAnswerError as error:
            self.unread += 1
            self._missing[k] += 1
            self._doubted[k] = len(self._motors) > 1
            if self._missing[k] == self._most:
                raise MotorError(
                    f"{motor.settings}: {self._most} readings in a row without an answer: {error}"
                ) from error
            return motor.settings.name, False, None
        self._missing[k] = 0
        if reading and reading.temperature is not None and reading.voltage is not None:
            self.temperatures.append(reading.temperature)
            self.voltages.append(reading.voltage)
        return motor.settings.name, True, reading


def check_time(motors: Sequence[MotorSettings], baud: int) -> None:
    """Refuses more motors than can be commanded, and one of them read back, between two commands.

    Raises:
        ArgumentError: The baud rate can't be used, or is too low for them.
    """
    check_baud(baud)
    takes = (_command_bytes(motors) + _READING_BYTES) * 10 / baud + _READING_EXTRA
    if len(motors) > 1 and takes > _MOST_TIME / RATE:
        raise ArgumentError(
            f"at {baud} baud a command to {len(motors)} motors and a reading of one take {1e3 * takes:.1f} ms; "
            f"{1e3 * _MOST_TIME / RATE:.0f} ms of the {1e3 / RATE:.0f} ms between two commands may be used: "
            f"set the motors to a higher baud rate with Dynamixel Wizard, and give it as --baud"
        )


def open_log(path: Path, motors: Sequence[MotorSettings]) -> TextIO:
    """Opens a log that is written line by line, so that it is complete whatever happens, and writes its header.

    The command of the fish's motor has no name in it; those of others have.

    Raises:
        ArgumentError: The file can't be written.
    """
    with writing(path, ArgumentError, what="log"):
        file = path.open("w", buffering=1, encoding="utf-8")
    columns = [motor.column for motor in motors]
    commands = [f"command_{column}" for column in (["rad_s"] if columns == [FISH] else columns)]
    asked = ["answered"] if len(motors) == 1 else ["motor", "answered"]
    file.write(",".join(["due_s", "sent_s", *commands, *asked, *_READ]) + "\n")
    return file


def _command_bytes(motors: Sequence[MotorSettings]) -> int:
    """Bytes on the line for the commands of a row, with the answer of the one motor that gives one."""
    if len(motors) == 1:
        return _COMMAND_BYTES
    packets = len({is_speed(motor.column) for motor in motors})
    return packets * _TOGETHER_BYTES + 5 * len(motors)


def _reading_cells(reading: Reading | None, read_at: float) -> list[str]:
    if reading is None:
        return [""] * len(_READ)
    voltage = "" if reading.voltage is None else f"{reading.voltage:.1f}"
    temperature = "" if reading.temperature is None else str(reading.temperature)
    return [f"{read_at:.6f}", f"{reading.velocity:.6f}", f"{reading.position:.6f}", voltage, temperature]
