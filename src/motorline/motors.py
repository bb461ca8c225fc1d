"""The motors of a bus: checked, set to their modes, commanded, read back, and stopped. What stops one stops all."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from motorline import control_table as ct
from motorline.commands import CommandTable, is_speed
from motorline.control_table import HardwareAlertError, MotorError, NoAnswerError
from motorline.motors_file import MotorSettings

if TYPE_CHECKING:
    from motorline.bus import Bus  # needs the maker's library

WATCHDOG = 0.2  # s without a packet after which a motor stops by itself
APPROACH = 0.5  # rad/s from where the motors are to the first row
_SLOW_DOWN = 1.0  # s that the motors are given to stop before their torque is switched off
_STOPPED = 0.05  # rad/s, about two units
_TURN = 4096  # units of the position
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Identity:
    """Identity of a motor, as it reports it before it is started.

    Attributes:
        model: Name of its model.
        firmware: Version of its firmware.
        velocity_limit: Its own limit of the speed [rad/s].
        voltage: Input voltage [V].
        temperature: Present temperature [°C].
        temperature_limit: Temperature at which it switches off [°C].
        reversed: Whether it counts angles in reverse.
    """

    model: str
    firmware: int
    velocity_limit: float
    voltage: float
    temperature: int
    temperature_limit: int
    reversed: bool


@dataclass(frozen=True)
class Reading:
    """Reading of a motor, counted as the motor's column counts.

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
    """A motor on a bus. Its torque is off until `enable`; `Motors` stops it.

    Angles are sent in position mode, not in extended position mode: its angles are those of the shaft within one turn,
    whatever happened before, so `zero` stays where it is; its commands can't wind the motor around several turns; and
    the motor's own position limits hold.

    Attributes:
        settings: What is known of it.
        identified: Whether it is the right model; until then, nothing is written to it.
    """

    def __init__(self, bus: Bus, settings: MotorSettings, watchdog: float) -> None:
        """Takes the bus.

        Args:
            bus: Bus that the motor is on.
            settings: What is known of it.
            watchdog: Time without a packet after which the motor stops by itself [s].
        """
        self.settings = settings
        self.identified = False
        self._bus = bus
        self._id = settings.id
        self._watchdog = max(1, min(127, math.ceil(watchdog / ct.WATCHDOG_UNIT - 1e-9)))
        self._follows_speed = is_speed(settings.column)

    def identify(self) -> Identity:
        """Checks that the motor is the right model and fit to turn, and switches its torque off.

        Raises:
            MotorError: The motor doesn't answer, is another model, or has a hardware error.
        """
        bus, model = self._bus, self.settings.model
        with self._named_alerts():
            number = bus.ping(self._id)
            if number != model.number:
                found = next((f" ({m.name})" for m in ct.MODELS.values() if m.number == number), "")
                raise MotorError(
                    f"{self.settings} on {bus.name} has model number {number}{found}, not {model.number} "
                    f"({model.name}); its limits are others: nothing was sent to it"
                )
            self.identified = True
            self._enable_answers()
            self._write(ct.TORQUE_ENABLE, 0)
            settings = bus.read_block(self._id, ct.MODEL_REGISTER, ct.SHUTDOWN)
            if settings[ct.FIRMWARE] < ct.WATCHDOG_FIRMWARE:
                self.identified = False  # its torque is off, and more can't be done
                raise MotorError(
                    f"{self.settings} has firmware {settings[ct.FIRMWARE]}, without the watchdog that stops it when "
                    f"this program can't; it must be {ct.WATCHDOG_FIRMWARE} or later: update it with Dynamixel Wizard"
                )
            self._write(ct.BUS_WATCHDOG, 0)
            present = bus.read_block(self._id, ct.PRESENT_VELOCITY, ct.PRESENT_TEMPERATURE)
        if settings[ct.DRIVE_MODE] & ct.TIME_BASED_PROFILE:
            raise MotorError(
                f"{self.settings} has Drive Mode {settings[ct.DRIVE_MODE]}, with a time-based profile; "
                f"switch it to the velocity-based profile with Dynamixel Wizard"
            )
        if settings[ct.HOMING_OFFSET] and not self._follows_speed:
            raise MotorError(
                f"{self.settings} has Homing Offset (20) {settings[ct.HOMING_OFFSET]}; it must be 0, since zero in the "
                f"motors file does the same: set it with Dynamixel Wizard"
            )
        return Identity(
            model=model.name,
            firmware=settings[ct.FIRMWARE],
            velocity_limit=settings[ct.VELOCITY_LIMIT] * ct.VELOCITY_UNIT,
            voltage=present[ct.PRESENT_VOLTAGE] * ct.VOLTAGE_UNIT,
            temperature=present[ct.PRESENT_TEMPERATURE],
            temperature_limit=settings[ct.TEMPERATURE_LIMIT],
            reversed=bool(settings[ct.DRIVE_MODE] & ct.REVERSE),
        )

    def prepare(self, table: CommandTable) -> float | None:
        """Sets the mode, an acceleration and a speed within the limits, the watchdog, and a goal that means rest.

        Returns:
            Where the motor is [rad], if it follows angles.

        Raises:
            MotorError: The table asks for more than the motor's own limits, or the motor refuses.
        """
        s, limits = self.settings, self.settings.limits
        with self._named_alerts():
            own = self._read(ct.VELOCITY_LIMIT)
            s.check_speed(table, own)
            mode = ct.VELOCITY_MODE if self._follows_speed else ct.POSITION_MODE
            if self._read(ct.OPERATING_MODE) != mode:  # EEPROM, which wears with every write
                self._write(ct.OPERATING_MODE, mode)
            steepness = max(1, min(32_767, math.ceil(limits.acceleration / ct.ACCELERATION_UNIT)))
            self._write(ct.PROFILE_ACCELERATION, steepness)
            self._write(ct.BUS_WATCHDOG, self._watchdog)
            if self._follows_speed:
                self._write(ct.GOAL_VELOCITY, 0)
                return None
            self._write(ct.PROFILE_VELOCITY, max(1, min(own, math.ceil(limits.speed / ct.VELOCITY_UNIT))))
            return self._hold(table.column(s.column))

    def enable(self) -> None:
        """Switches the torque on."""
        with self._named_alerts():
            self._write(ct.TORQUE_ENABLE, 1)

    def command(self, value: float) -> float:
        """Sends a command [rad/s or rad] once and returns it as the motor counts it, rounded to its unit.

        Raises:
            NoAnswerError: No answer came.
            MotorError: The motor refused, has a hardware error or was stopped by its watchdog.
        """
        units = self.settings.to_units(value)
        with self._named_alerts():
            try:
                self._bus.write(self._id, self.settings.goal, units, attempts=1)
            except (HardwareAlertError, NoAnswerError):
                raise
            except MotorError:
                self.check_watchdog()
                raise
        return self.settings.from_units(units)

    def check_watchdog(self) -> None:
        """Looks whether the watchdog has stopped the motor, in one attempt.

        Raises:
            NoAnswerError: No answer came.
            MotorError: It has, or the motor has a hardware error.
        """
        with self._named_alerts():
            tripped = self._bus.read_block(self._id, ct.BUS_WATCHDOG, ct.BUS_WATCHDOG, attempts=1)[ct.BUS_WATCHDOG]
        if tripped == ct.WATCHDOG_TRIPPED:
            raise MotorError(
                f"the watchdog of {self.settings} has stopped it: for {self._watchdog * ct.WATCHDOG_UNIT:g} s no "
                f"packet came; was this program halted or the machine overloaded, or is a cable loose?"
            )

    def read(self, whole: bool = False) -> Reading:
        """Reads speed and angle in one attempt, and voltage and temperature too where `whole` is set.

        Raises:
            NoAnswerError: No answer came.
            MotorError: The motor has a hardware error.
        """
        last = ct.PRESENT_TEMPERATURE if whole else ct.PRESENT_POSITION
        with self._named_alerts():
            values = self._bus.read_block(self._id, ct.PRESENT_VELOCITY, last, attempts=1)
        s = self.settings
        return Reading(
            velocity=s.direction * values[ct.PRESENT_VELOCITY] * ct.VELOCITY_UNIT,
            position=s.direction * (values[ct.PRESENT_POSITION] * ct.POSITION_UNIT - s.zero),
            voltage=values[ct.PRESENT_VOLTAGE] * ct.VOLTAGE_UNIT if whole else None,
            temperature=values[ct.PRESENT_TEMPERATURE] if whole else None,
        )

    def rest(self) -> str:
        """Sets speed 0; a motor that follows angles keeps its goal. Returns why it failed, or nothing."""
        # refused where the watchdog has stopped it already
        return _attempt(lambda: self._write(ct.GOAL_VELOCITY, 0)) if self._follows_speed else ""

    def wait_until_stopped(self, until: float) -> str:
        """Waits until the motor has stopped, at most until a time [s of time.monotonic]. Returns why it failed."""

        def wait() -> None:
            while time.monotonic() < until:
                speed = self._bus.read(self._id, ct.PRESENT_VELOCITY, ignore_alert=True)
                if abs(speed) * ct.VELOCITY_UNIT < _STOPPED:
                    return
                time.sleep(0.01)

        return _attempt(wait)

    def release(self) -> str:
        """Switches torque and watchdog off. Returns why it failed, or nothing.

        The watchdog stays on where the torque may still be on: then the watchdog is what stops the motor.
        """
        failed = _attempt(lambda: self._write(ct.TORQUE_ENABLE, 0))
        return failed or _attempt(lambda: self._write(ct.BUS_WATCHDOG, 0))

    def _hold(self, angles: tuple[float, ...]) -> float:
        """Makes the present angle the goal, and returns it [rad]."""
        s = self.settings
        low, high = self._read(ct.MIN_POSITION), self._read(ct.MAX_POSITION)

        def own() -> str:
            ends = sorted((s.from_units(low), s.from_units(high)))
            return f"its own Min and Max Position Limit (52, 48) allow {ends[0]:.4g} to {ends[1]:.4g} rad"

        for angle in (min(angles), max(angles)):
            if not low <= s.to_units(angle) <= high:
                raise MotorError(
                    f"the table asks {s} for {angle:.4g} rad; {own()}: change the table, zero in the motors file, or "
                    f"the motor's limits with Dynamixel Wizard"
                )
        present = self._read(ct.PRESENT_POSITION) % _TURN  # what it is within one turn, once the torque is on
        if not low <= present <= high:
            raise MotorError(f"{s} is at {s.from_units(present):.4g} rad; {own()}: turn it there by hand")
        self._write(ct.GOAL_POSITION, present)
        return s.from_units(present)

    def _read(self, register: ct.Register) -> int:
        return self._bus.read(self._id, register)

    def _write(self, register: ct.Register, value: int) -> None:
        self._bus.write(self._id, register, value)

    def _enable_answers(self) -> None:
        """Makes a motor answer that was set to answer reads only, or pings only."""
        with suppress(NoAnswerError):
            if self._read(ct.STATUS_RETURN_LEVEL) == 2:
                return
        with suppress(NoAnswerError):  # an answer to this write may be missing as well
            self._bus.write(self._id, ct.STATUS_RETURN_LEVEL, 2, attempts=1)

    @contextmanager
    def _named_alerts(self) -> Generator[None]:
        """Raises a hardware error that the motor reports with an answer as a sentence that says which."""
        try:
            yield
        except HardwareAlertError as alert:
            try:
                status = self._bus.read(self._id, ct.HARDWARE_ERROR, ignore_alert=True)
            except MotorError as error:
                what = f"{self.settings} reports a hardware error, and doesn't say which: {error}"
                raise MotorError(what) from error
            raise MotorError(
                f"{self.settings} reports {ct.hardware_errors(status)} (Hardware Error Status (70) is {status}); "
                f"let it cool down, check supply and load, then switch its power off and on"
            ) from alert


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

    def __exit__(self, kind: object, error: object, trace: object) -> None:
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
            table: Commands, a column per motor, which begin and end with speeds 0.
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
        units = [(m.settings, m.settings.to_units(value)) for m, value in zip(self.each, row, strict=True)]
        for goal in (ct.GOAL_VELOCITY, ct.GOAL_POSITION):
            if together := {s.id: u for s, u in units if s.goal is goal}:
                self.bus.write_together(goal, together)
        return tuple(s.from_units(u) for s, u in units)

    def stop(self) -> str:
        """Sets speeds 0, waits for rest and switches torque and watchdogs off, each even where the step before failed.

        Several motors get speed 0 and torque off in one packet first, so none waits for another that doesn't answer.

        Returns:
            What failed, as a sentence; empty where nothing did.
        """
        motors = [motor for motor in self.each if motor.identified]
        if len(motors) > 1:
            speeds = {m.settings.id: 0 for m in motors if is_speed(m.settings.column)}
            _attempt(lambda: self.bus.write_together(ct.GOAL_VELOCITY, speeds) if speeds else None)
        answering = [motor for motor in motors if not motor.rest()]
        until = time.monotonic() + _SLOW_DOWN
        for motor in answering:
            motor.wait_until_stopped(until)
        if len(motors) > 1:
            off = {motor.settings.id: 0 for motor in motors}
            _attempt(lambda: self.bus.write_together(ct.TORQUE_ENABLE, off))
        failed = [f"stopping {motor.settings} failed: {why}" for motor in motors if (why := motor.release())]
        return f"{'; '.join(failed)}; cut the power if anything still turns" if failed else ""


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
