"""Sends a table of commands to a started motor on schedule, reads back what it does, and keeps a log."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from swim2real.deployment.commands import RATE, CommandTable
from swim2real.deployment.control_table import MotorError, NoAnswerError
from swim2real.deployment.motor import Motor, Reading
from swim2real.deployment.schedule import Punctuality, Schedule
from swim2real.errors import ArgumentError

if TYPE_CHECKING:
    from swim2real.deployment.bus import Bus  # needs the maker's library

LOG_HEADER = (
    "due_s", "sent_s", "command_rad_s", "answered", "read_s", "velocity_rad_s", "position_rad", "voltage_v",
    "temperature_c",
)  # fmt: skip
_MOST_UNANSWERED = 10  # commands in a row without an answer before sending ends; the watchdog is as quick
_WHOLE_EVERY = RATE // 2  # readings; the first of them has voltage and temperature
_READING_BYTES = 14 + 11 + 19  # the question, and the longest answer
_READING_EXTRA = 0.004  # s: the adapter, the motor's return delay


@dataclass(frozen=True)
class SendingResult:
    """How the commands of a table were sent.

    Attributes:
        punctuality: Lateness of the commands.
        unanswered: Commands that the motor didn't answer.
        unread: Readings that the motor didn't answer.
        seconds: Time of the table that was sent [s].
        complete: Whether all of the table was sent.
        temperature: Highest temperature [°C]; None without a reading of it.
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
    motor: Motor, bus: Bus, table: CommandTable,
    log: TextIO | None = None, stop: Callable[[], bool] = lambda: False,
) -> SendingResult:  # fmt: skip
    """Sends each command when it is due. The motor must have been started.

    Args:
        motor: Motor that turns.
        bus: Bus that it is on.
        table: Commands.
        log: File that gets a line a command, as `LOG_HEADER` says.
        stop: Called before every command; sending ends when it returns true.

    Raises:
        MotorError: The motor refused, failed, or didn't answer ten commands in a row.
    """
    lateness: list[float] = []
    temperatures: list[int] = []
    voltages: list[float] = []
    unanswered = unread = in_a_row = read = 0
    reading_takes = _READING_BYTES * 10 / bus.baud + _READING_EXTRA
    last = -1
    schedule = Schedule()
    for k in schedule.ticks(len(table.velocities), stop):
        last = k
        wanted = table.velocities[k]
        answered = True
        try:
            wanted = motor.command(wanted)
            in_a_row = 0
        except NoAnswerError as error:
            answered = False
            unanswered += 1
            in_a_row += 1
            if in_a_row == _MOST_UNANSWERED:
                raise MotorError(f"{in_a_row} commands in a row without an answer: {error}") from error
        lateness.append(schedule.sent(k, bus.written_at))
        sent_at = bus.written_at - schedule.start
        reading: Reading | None = None
        if schedule.left(k + 1) > reading_takes:
            try:
                reading = motor.read(whole=read % _WHOLE_EVERY == 0)
                read += 1
            except NoAnswerError:
                unread += 1
        if reading and reading.temperature is not None and reading.voltage is not None:
            temperatures.append(reading.temperature)
            voltages.append(reading.voltage)
        if log:
            log.write(_log_line(k, sent_at, wanted, answered, bus.written_at - schedule.start, reading))
    complete = last == len(table.velocities) - 1
    if complete:
        schedule.wait_until(schedule.due(last + 1))  # the last command holds as long as the others
    return SendingResult(
        Punctuality.of(lateness, schedule.skipped), unanswered, unread, (last + 1) / RATE, complete,
        max(temperatures, default=None), min(voltages, default=None),
    )  # fmt: skip


@contextmanager
def log_file(path: Path | None) -> Generator[TextIO | None]:
    """Opens a log that is written line by line, so that it is complete whatever happens; yields None without a path."""
    if path is None:
        yield None
        return
    try:
        file = path.open("w", buffering=1, encoding="utf-8")
    except OSError as error:
        raise ArgumentError(f"log '{path}' can't be written: {error.strerror or error}") from error
    with file:
        file.write(",".join(LOG_HEADER) + "\n")
        yield file


def _log_line(k: int, sent_at: float, command: float, answered: bool, read_at: float, reading: Reading | None) -> str:
    cells = [f"{k / RATE:.2f}", f"{sent_at:.6f}", f"{command:.6f}", "1" if answered else "0"]
    if reading is None:
        cells += [""] * 5
    else:
        cells += [f"{read_at:.6f}", f"{reading.velocity:.6f}", f"{reading.position:.6f}"]
        cells += [
            "" if reading.voltage is None else f"{reading.voltage:.1f}",
            "" if reading.temperature is None else f"{reading.temperature}",
        ]
    return ",".join(cells) + "\n"
