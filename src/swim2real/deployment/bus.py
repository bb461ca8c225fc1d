"""Reading and writing a motor's registers through the maker's library, with its errors as sentences."""

from __future__ import annotations

import contextlib
import os
from types import TracebackType
from typing import Any

from swim2real.deployment import control_table as ct
from swim2real.deployment.control_table import MotorError, Register
from swim2real.errors import ArgumentError, MissingExtraError

USABLE_BAUDS = tuple(rate for rate in ct.BAUD_RATES.values() if 57_600 <= rate <= 4_000_000)
_PINGS = 30  # about a second
_TRIES = 10  # of what isn't bound to a time; a busy computer misses some answers

_ERRORS = {
    ct.RESULT_FAIL: "it failed to do so",
    ct.INSTRUCTION_ERROR: "it doesn't know the instruction",
    ct.CRC_ERROR: "the packet arrived damaged: check cable and ground",
    ct.RANGE_ERROR: "the value is outside the register's range",
    ct.LENGTH_ERROR: "the value has the wrong number of bytes",
    ct.LIMIT_ERROR: "the value is beyond the motor's own limit",
    ct.ACCESS_ERROR: "the register can't be written now (read-only, or locked while torque is on)",
}


class NoAnswerError(MotorError):
    """No answer came, or none that can be read. The next one may."""


class HardwareAlertError(MotorError):
    """The motor reports a hardware error with its answer."""


class Bus:
    """One motor on a serial port. A context manager, which closes the port.

    Raises:
        MissingExtraError: The maker's library isn't installed.
        ArgumentError: The baud rate can't be used.
        MotorError: The port can't be opened.
    """

    def __init__(self, port: str, device: int = 1, baud: int = 57_600) -> None:
        if baud not in USABLE_BAUDS:
            usable = ", ".join(map(str, USABLE_BAUDS))
            raise ArgumentError(f"{baud} baud can't be used for 50 commands a second; one of {usable} can")
        if not 0 <= device <= 252:
            raise ArgumentError(f"motor id {device} is not allowed; ids are 0 to 252")
        try:
            import dynamixel_sdk

            from swim2real.deployment.port import Port
        except ModuleNotFoundError as error:
            raise MissingExtraError(
                "the motor needs dynamixel-sdk; install it with: pip install 'swim2real[deploy]'"
            ) from error
        self._sdk: Any = dynamixel_sdk
        self.name, self.device, self.baud = port, device, baud
        self._packets: Any = dynamixel_sdk.PacketHandler(2.0)
        self._port = Port(port, baud)
        try:
            self._port.open()
        except self._lost() as error:
            with contextlib.suppress(Exception):
                self._port.closePort()
            raise MotorError(
                f"serial port {port} can't be opened ({_reason(error)}); is the U2D2 plugged in, the name right "
                f"(ls /dev/ttyUSB*), nobody else using it, and are you in the group dialout?"
            ) from error

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the port, whatever state it is in."""
        with contextlib.suppress(Exception):
            self._port.closePort()

    @property
    def written_at(self) -> float:
        """When the last packet had been handed to the operating system [s of time.monotonic]."""
        return self._port.written_at

    def ping(self) -> int:
        """The model number of the motor."""

        def once() -> int:
            number, result, error = self._talk("a ping", self._packets.ping, self.device)
            self._check("a ping", result, error)
            return int(number)

        return _several(once, _PINGS)

    def read(self, register: Register, despite_alert: bool = False) -> int:
        """A register's value."""
        return self.read_block(register, register, despite_alert=despite_alert)[register]

    def read_block(
        self, first: Register, last: Register, tries: int = _TRIES, despite_alert: bool = False
    ) -> dict[Register, int]:
        """All registers from one to another, in one packet."""
        size = last.address + last.size - first.address
        what = f"reading {first}"

        def once() -> dict[Register, int]:
            data, result, error = self._talk(what, self._packets.readTxRx, self.device, first.address, size)
            self._check(what, result, error & ~ct.ALERT if despite_alert else error)
            if len(data) != size:  # a late answer to another question
                raise NoAnswerError(f"{self._who}: {what} got {len(data)} bytes instead of {size}")
            cells = bytes(data)
            return {
                r: int.from_bytes(cells[r.address - first.address :][: r.size], "little", signed=r.signed)
                for r in ct.REGISTERS
                if first.address <= r.address <= last.address
            }

        return _several(once, tries)

    def write(self, register: Register, value: int, tries: int = _TRIES) -> None:
        """Sets a register and waits for the motor's word that it is set."""
        what = f"writing {value} to {register}"
        cells = list(value.to_bytes(register.size, "little", signed=register.signed))

        def once() -> None:
            result, error = self._talk(
                what, self._packets.writeTxRx, self.device, register.address, register.size, cells
            )
            self._check(what, result, error)

        _several(once, tries)

    def write_unanswered(self, register: Register, value: int) -> None:
        """Sets a register of a motor that may not answer writes."""
        cells = list(value.to_bytes(register.size, "little", signed=register.signed))
        what = f"writing {value} to {register}"
        self._talk(what, self._packets.writeTxOnly, self.device, register.address, register.size, cells)

    @property
    def _who(self) -> str:
        return f"motor {self.device} on {self.name}"

    def _talk(self, what: str, call: Any, *details: Any) -> Any:
        self._port.is_using = False  # an exchange that was cut short leaves it set
        try:
            return call(self._port, *details)
        except self._lost() as error:
            raise MotorError(
                f"serial port {self.name} was lost while {what} ({_reason(error)}); "
                f"is the cable still in? Without packets the motor's watchdog stops it"
            ) from error
        except IndexError:  # the library stumbles over some damaged answers
            raise NoAnswerError(f"{self._who}: {what} got a damaged answer") from None

    def _check(self, what: str, result: int, error: int) -> None:
        if result == self._sdk.COMM_RX_CORRUPT:
            raise NoAnswerError(f"{self._who}: {what} got a damaged answer; check cable, ground and baud rate")
        if result != self._sdk.COMM_SUCCESS:
            raise NoAnswerError(
                f"{self._who} didn't answer {what} at {self.baud} baud; "
                f"check power, cable, id and baud rate (Dynamixel Wizard finds them)"
            )
        number = error & ~ct.ALERT
        if number == ct.CRC_ERROR:  # it was damaged on the way there, so the next one may not be
            raise NoAnswerError(f"{self._who} refused {what}: {_ERRORS[number]}")
        if number:
            raise MotorError(f"{self._who} refused {what}: {_ERRORS.get(number, f'unknown error {number}')}")
        if error & ct.ALERT:
            raise HardwareAlertError(f"{self._who} reports a hardware error")

    def _lost(self) -> tuple[type[BaseException], ...]:
        """What is raised when a port goes away: pyserial's are OSErrors, termios has its own."""
        try:
            import termios
        except ModuleNotFoundError:  # Windows
            return (OSError,)
        return (OSError, termios.error)


def _several(action: Any, tries: int = _TRIES) -> Any:
    """What it gives, at the latest of so many tries; only a missing answer is tried again."""
    for left in reversed(range(tries)):
        try:
            return action()
        except NoAnswerError:
            if not left:
                raise
    raise ValueError(f"{tries} tries")


def _reason(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else str(error) or type(error).__name__
