"""The fish's motor: checked, switched to velocity mode, sent speeds, read back, and always stopped."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING

from swim2real.deployment import control_table as ct
from swim2real.deployment.commands import CommandTable, Limits
from swim2real.deployment.control_table import HardwareAlertError, MotorError, NoAnswerError

if TYPE_CHECKING:
    from swim2real.deployment.bus import Bus  # needs the maker's library

WATCHDOG = 0.2  # s without a packet after which the motor stops by itself
_STOPPED = 0.05  # rad/s, about two units
_SLOW_DOWN = 1.0  # s that the motor is given to stop before its torque is switched off
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Identity:
    """What the motor reports of itself before it is started.

    Attributes:
        firmware: Version of its firmware.
        velocity_limit: Its own limit of the speed [rad/s].
        voltage: Input voltage [V].
        temperature: Present temperature [°C].
        temperature_limit: Temperature at which it switches off [°C].
        reversed: Whether it counts angles in reverse.
    """

    firmware: int
    velocity_limit: float
    voltage: float
    temperature: int
    temperature_limit: int
    reversed: bool


@dataclass(frozen=True)
class Reading:
    """What was read back.

    Attributes:
        velocity: Speed [rad/s].
        position: Angle [rad].
        voltage: Input voltage [V]; None in a short reading.
        temperature: Temperature [°C]; None in a short reading.
    """

    velocity: float
    position: float
    voltage: float | None = None
    temperature: int | None = None


class Motor:
    """A motor on a bus. A context manager: leaving it stops the motor, whatever happened.

    Nothing turns before `start`.
    """

    def __init__(self, bus: Bus, watchdog: float = WATCHDOG) -> None:
        """Takes the bus.

        Args:
            bus: Bus that the motor is on.
            watchdog: Time without a packet after which the motor stops by itself [s].
        """
        self._bus = bus
        self._watchdog = max(1, min(127, math.ceil(watchdog / ct.WATCHDOG_UNIT - 1e-9)))
        self._identified = False  # until it is known to be the right model, nothing is written to it

    def __enter__(self) -> Motor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        problems = self.stop()
        if problems and error is None:
            raise MotorError(problems)
        if problems:
            _log.warning("%s", problems)

    def identify(self) -> Identity:
        """Checks that the motor is the right model and fit to turn, and switches its torque off.

        Raises:
            MotorError: The motor doesn't answer, is another model, or has a hardware error.
        """
        bus = self._bus
        try:
            model = bus.ping()
            if model != ct.MODEL_NUMBER:
                raise MotorError(
                    f"motor {bus.device} on {bus.name} has model number {model}, not {ct.MODEL_NUMBER} "
                    f"({ct.MODEL}); its limits are others: nothing was sent to it"
                )
            self._identified = True
            self._enable_answers()
            bus.write(ct.TORQUE_ENABLE, 0)
            bus.write(ct.BUS_WATCHDOG, 0)
            settings = bus.read_block(ct.MODEL_REGISTER, ct.SHUTDOWN)
            present = bus.read_block(ct.PRESENT_VELOCITY, ct.PRESENT_TEMPERATURE)
        except HardwareAlertError as error:
            raise self._alert() from error
        if settings[ct.DRIVE_MODE] & ct.TIME_BASED_PROFILE:
            raise MotorError(
                f"motor {bus.device} has Drive Mode {settings[ct.DRIVE_MODE]}, with a time-based profile; "
                f"switch it to the velocity-based profile with Dynamixel Wizard"
            )
        return Identity(
            firmware=settings[ct.FIRMWARE],
            velocity_limit=settings[ct.VELOCITY_LIMIT] * ct.VELOCITY_UNIT,
            voltage=present[ct.PRESENT_VOLTAGE] * ct.VOLTAGE_UNIT,
            temperature=present[ct.PRESENT_TEMPERATURE],
            temperature_limit=settings[ct.TEMPERATURE_LIMIT],
            reversed=bool(settings[ct.DRIVE_MODE] & ct.REVERSE),
        )

    def start(self, table: CommandTable, limits: Limits) -> None:
        """Sets velocity mode, goal 0, an acceleration within the limit and the watchdog, and switches the torque on.

        Raises:
            MotorError: The table asks for more than the motor's own limit, or the motor refuses.
        """
        bus = self._bus
        try:
            limit = bus.read(ct.VELOCITY_LIMIT)
            if abs(to_units(table.speed)) > limit:
                raise MotorError(
                    f"the table asks for {table.speed:.3g} rad/s; the motor's own Velocity Limit (44) is {limit}, "
                    f"{limit * ct.VELOCITY_UNIT:.3g} rad/s: make the table slower, or raise the motor's limit with "
                    f"Dynamixel Wizard"
                )
            if bus.read(ct.OPERATING_MODE) != ct.VELOCITY_MODE:  # EEPROM, which wears with every write
                bus.write(ct.OPERATING_MODE, ct.VELOCITY_MODE)
            bus.write(ct.GOAL_VELOCITY, 0)
            steepness = max(1, min(32_767, math.ceil(limits.acceleration / ct.ACCELERATION_UNIT)))
            bus.write(ct.PROFILE_ACCELERATION, steepness)
            bus.write(ct.BUS_WATCHDOG, self._watchdog)
            bus.write(ct.TORQUE_ENABLE, 1)
        except HardwareAlertError as error:
            raise self._alert() from error

    def command(self, velocity: float) -> float:
        """Sends a speed [rad/s] once and returns it as the motor counts it, in steps of 0.024 rad/s.

        Raises:
            NoAnswerError: No answer came.
            MotorError: The motor refused, has a hardware error or was stopped by its watchdog.
        """
        units = to_units(velocity)
        try:
            self._bus.write(ct.GOAL_VELOCITY, units, attempts=1)
        except HardwareAlertError as error:
            raise self._alert() from error
        except NoAnswerError:
            raise
        except MotorError as error:
            if self._bus.read(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED:
                raise MotorError(
                    f"the motor's watchdog has stopped it: for {self._watchdog * ct.WATCHDOG_UNIT:g} s no packet came; "
                    f"was this program halted or the machine overloaded?"
                ) from error
            raise
        return units * ct.VELOCITY_UNIT

    def read(self, whole: bool = False) -> Reading:
        """Reads speed and angle in one attempt, and voltage and temperature too where `whole` is set.

        Raises:
            NoAnswerError: No answer came.
            MotorError: The motor has a hardware error.
        """
        last = ct.PRESENT_TEMPERATURE if whole else ct.PRESENT_POSITION
        try:
            values = self._bus.read_block(ct.PRESENT_VELOCITY, last, attempts=1)
        except HardwareAlertError as error:
            raise self._alert() from error
        return Reading(
            velocity=values[ct.PRESENT_VELOCITY] * ct.VELOCITY_UNIT,
            position=values[ct.PRESENT_POSITION] * ct.POSITION_UNIT,
            voltage=values[ct.PRESENT_VOLTAGE] * ct.VOLTAGE_UNIT if whole else None,
            temperature=values[ct.PRESENT_TEMPERATURE] if whole else None,
        )

    def stop(self) -> str:
        """Sets goal 0 and switches torque and watchdog off, each even where the step before failed.

        The watchdog stays on where the torque may still be on: then the watchdog is what stops the motor.

        Returns:
            What failed, as a sentence; empty where nothing did.
        """
        if not self._identified:
            return ""
        self._attempt(lambda: self._bus.write(ct.GOAL_VELOCITY, 0))  # refused where the watchdog has stopped it already
        self._attempt(self._slow_down)
        failed = self._attempt(lambda: self._bus.write(ct.TORQUE_ENABLE, 0))
        failed = failed or self._attempt(lambda: self._bus.write(ct.BUS_WATCHDOG, 0))
        return f"stopping the motor failed: {failed}; cut its power if it still turns" if failed else ""

    @staticmethod
    def _attempt(step: Callable[[], None]) -> str:
        """Makes a step, at most twice, and returns why it failed; empty where it didn't."""
        problem = ""
        for _ in range(2):  # the first answer may be a late one to something else
            try:
                step()
            except HardwareAlertError:  # the step was made; the alert comes with its answer
                return ""
            except MotorError as error:
                problem = str(error)
            else:
                return ""
        return problem

    def _slow_down(self) -> None:
        until = time.monotonic() + _SLOW_DOWN
        while time.monotonic() < until:
            if abs(self._bus.read(ct.PRESENT_VELOCITY, ignore_alert=True)) * ct.VELOCITY_UNIT < _STOPPED:
                return
            time.sleep(0.01)

    def _enable_answers(self) -> None:
        """Makes a motor answer that was set to answer reads only, or pings only."""
        try:
            answers = self._bus.read(ct.STATUS_RETURN_LEVEL) == 2
        except NoAnswerError:
            answers = False
        if not answers:
            self._bus.write_unanswered(ct.STATUS_RETURN_LEVEL, 2)
            time.sleep(0.05)

    def _alert(self) -> MotorError:
        """The hardware error that the motor reports, as an exception."""
        try:
            status = self._bus.read(ct.HARDWARE_ERROR, ignore_alert=True)
        except MotorError as error:
            return MotorError(f"the motor reports a hardware error, and doesn't say which: {error}")
        return MotorError(
            f"the motor reports {ct.hardware_errors(status)} (Hardware Error Status (70) is {status}); "
            f"let it cool down, check supply and load, then switch its power off and on"
        )


def to_units(velocity: float) -> int:
    """A speed in the motor's units of 0.229 rev/min, rounded."""
    return round(velocity / ct.VELOCITY_UNIT)
