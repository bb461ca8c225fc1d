"""The motors of a bus, started, commanded and stopped together: what stops one stops all."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from swim2real.deployment import control_table as ct
from swim2real.deployment.commands import CommandTable, is_speed
from swim2real.deployment.control_table import MotorError
from swim2real.deployment.motor import Identity, Motor, attempt
from swim2real.deployment.motors_file import MotorSettings

if TYPE_CHECKING:
    from swim2real.deployment.bus import Bus  # needs the maker's library

WATCHDOG = 0.2  # s without a packet after which a motor stops by itself
APPROACH = 0.5  # rad/s from where the motors are to the first row
_SLOW_DOWN = 1.0  # s that the motors are given to stop before their torque is switched off
_log = logging.getLogger(__name__)


class Motors:
    """Motors on a bus. A context manager: leaving it stops all of them, whatever happened.

    Nothing turns before `start`.

    Attributes:
        bus: Bus that they are on.
        each: The motors, in the order of the table's columns.
        watchdog: Time without a packet after which a motor stops by itself [s].
    """

    def __init__(self, bus: Bus, settings: Sequence[MotorSettings], watchdog: float = WATCHDOG) -> None:
        """Takes the bus.

        Args:
            bus: Bus that the motors are on.
            settings: What is known of each, in the order of the table's columns.
            watchdog: Time without a packet after which a motor stops by itself [s].
        """
        self.bus = bus
        self.each = tuple(Motor(bus, one, watchdog) for one in settings)
        self.watchdog = watchdog

    def __enter__(self) -> Motors:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        problems = self.stop()
        if problems and error is None:
            raise MotorError(problems)
        if problems:
            _log.warning("%s", problems)

    def identify(self) -> tuple[Identity, ...]:
        """Checks every motor and switches its torque off.

        Raises:
            MotorError: One doesn't answer, is another model, or has a hardware error.
        """
        return tuple(motor.identify() for motor in self.each)

    def start(self, table: CommandTable, approach: float = APPROACH) -> CommandTable:
        """Prepares all motors, then switches the torque of all on; those that follow angles hold where they are.

        Args:
            table: Commands, a column a motor, which begin and end with speeds 0.
            approach: Speed from where the motors are to the first row [rad/s].

        Returns:
            The table to send: with the way from the present angles to the first row.

        Raises:
            MotorError: The table asks for more than a motor's own limit, or a motor refuses.
        """
        present = {motor.settings.column: motor.prepare(table) for motor in self.each}
        angles = {column: angle for column, angle in present.items() if angle is not None}
        slowest = min(motor.settings.limits.speed for motor in self.each)
        table = table.approached(angles, min(approach, slowest)) if angles else table
        for motor in self.each:  # quickly, since the watchdogs count from here on
            motor.enable()
        return table

    def command(self, row: Sequence[float]) -> tuple[float, ...]:
        """Sends a row and returns it as the motors count it.

        One motor confirms its command. To several, one packet goes that none answers, or two where speeds and angles
        are in the row.

        Raises:
            NoAnswerError: No answer came from the one motor, or the packet couldn't be sent.
            MotorError: The one motor refused, has a hardware error or was stopped by its watchdog.
        """
        if len(self.each) == 1:
            return (self.each[0].command(row[0]),)
        units = [motor.to_units(value) for motor, value in zip(self.each, row, strict=True)]
        for goal in (ct.GOAL_VELOCITY, ct.GOAL_POSITION):
            together = {m.settings.id: u for m, u in zip(self.each, units, strict=True) if m.goal is goal}
            if together:
                self.bus.write_together(goal, together)
        return tuple(motor.from_units(u) for motor, u in zip(self.each, units, strict=True))

    def stop(self) -> str:
        """Sets speeds 0, waits for rest and switches torque and watchdogs off, each even where the step before failed.

        Several motors get speed 0 and torque off in one packet first, so none waits for another that doesn't answer.

        Returns:
            What failed, as a sentence; empty where nothing did.
        """
        motors = [motor for motor in self.each if motor.identified]
        if len(motors) > 1:
            speeds = {m.settings.id: 0 for m in motors if is_speed(m.settings.column)}
            attempt(lambda: self.bus.write_together(ct.GOAL_VELOCITY, speeds) if speeds else None)
        answering = [motor for motor in motors if not motor.rest()]
        until = time.monotonic() + _SLOW_DOWN
        for motor in answering:
            motor.wait_until_stopped(until)
        if len(motors) > 1:
            off = {motor.settings.id: 0 for motor in motors}
            attempt(lambda: self.bus.write_together(ct.TORQUE_ENABLE, off))
        failed = [f"stopping {motor.settings} failed: {why}" for motor in motors if (why := motor.release())]
        return f"{'; '.join(failed)}; cut the power if anything still turns" if failed else ""
