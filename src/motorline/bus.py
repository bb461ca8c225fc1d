"""Reading and writing motors' registers through the maker's library, whose errors become sentences.

The serial port is the maker's, changed so that commands keep the 50 Hz.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from motorline import control_table as ct
from motorline.control_table import HardwareAlertError, MotorError, NoAnswerError, Register
from swimbase.errors import MissingExtraError

try:
    import dynamixel_sdk
    from serial import SerialTimeoutException
except ModuleNotFoundError as error:
    raise MissingExtraError("the motor needs dynamixel-sdk; install it with: pip install dynamixel-sdk") from error

if sys.platform == "win32":
    _PORT_ERRORS = (OSError,)  # pyserial's errors are OSErrors
else:
    import termios

    _PORT_ERRORS = (OSError, termios.error)

Answer = TypeVar("Answer")

_WRITE_TIMEOUT = 0.1  # s
_PING_ATTEMPTS = 30  # about a second
_ATTEMPTS = 10  # at exchanges that aren't bound to a time; a busy computer misses some answers
_READ_TIMEOUT = 0.001  # s that one look for bytes waits
_MOST_NOISE = 64  # bytes besides the answer that are passed over when its time is over
_LOW_LATENCY = 8.0  # ms that an answer may take beyond its bytes when the adapter passes bytes on at once
_ADAPTER_LATENCY = 34.0  # ms when the adapter may gather bytes for 16 ms, as the library allows for

_ERRORS = {
    ct.RESULT_FAIL: "it failed to do so",
    ct.INSTRUCTION_ERROR: "it doesn't know the instruction",
    ct.CRC_ERROR: "the packet arrived damaged: check cable and ground",
    ct.RANGE_ERROR: "the value is outside the register's range",
    ct.LENGTH_ERROR: "the value has the wrong number of bytes",
    ct.LIMIT_ERROR: "the value is beyond the motor's own limit",
    ct.ACCESS_ERROR: "the register can't be written now (read-only, or locked while torque is on)",
}


class Bus:
    """A serial port with motors, each of which has an id. A context manager, which closes the port.

    Attributes:
        name: Name of the port.
        baud: Baud rate.
    """

    def __init__(self, port: str, baud: int = 57_600) -> None:
        """Opens the port.

        Args:
            port: Name of the port, such as /dev/ttyUSB0.
            baud: Baud rate.

        Raises:
            ArgumentError: The baud rate can't be used.
            MotorError: The port can't be opened.
        """
        ct.check_baud(baud)
        self.name, self.baud = port, baud
        self._packets: Any = dynamixel_sdk.PacketHandler(2.0)
        self._port = _Port(port, baud)
        try:
            self._port.open()
        except _PORT_ERRORS as error:
            self.close()
            raise MotorError(
                f"serial port {port} can't be opened ({_reason(error)}); is the U2D2 plugged in, the name right "
                f"(ls /dev/ttyUSB*), nobody else using it, and are you in the group dialout?"
            ) from error

    def __enter__(self) -> Bus:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the port, whatever state it is in."""
        with contextlib.suppress(Exception):
            self._port.closePort()

    @property
    def written_at(self) -> float:
        """Time at which the last packet had been handed to the operating system [s of time.monotonic]."""
        return self._port.written_at

    def ping(self, device: int) -> int:
        """The model number of the motor with this id."""

        def exchange() -> int:
            number, result, error = self._call(device, "a ping", self._packets.ping, device)
            self._check(device, "a ping", result, error)
            return int(number)

        return _repeat(exchange, _PING_ATTEMPTS)

    def read(self, device: int, register: Register, ignore_alert: bool = False) -> int:
        """The value of a register.

        Args:
            device: Id of the motor.
            register: Register to read.
            ignore_alert: Whether to read it although the motor reports a hardware error.
        """
        return self.read_block(device, register, register, ignore_alert=ignore_alert)[register]

    def read_block(
        self, device: int, first: Register, last: Register, attempts: int = _ATTEMPTS, ignore_alert: bool = False
    ) -> dict[Register, int]:
        """The values of all registers from `first` to `last`, in one packet."""
        size = last.address + last.size - first.address
        what = f"reading {first}"

        def exchange() -> dict[Register, int]:
            data, result, error = self._call(device, what, self._packets.readTxRx, device, first.address, size)
            self._check(device, what, result, error & ~ct.ALERT if ignore_alert else error)
            if len(data) != size:  # a late answer to another question
                raise NoAnswerError(f"{self._motor(device)}: {what} got {len(data)} bytes instead of {size}")
            cells = bytes(data)
            return {
                r: int.from_bytes(cells[r.address - first.address :][: r.size], "little", signed=r.signed)
                for r in ct.REGISTERS
                if first.address <= r.address <= last.address
            }

        return _repeat(exchange, attempts)

    def write(self, device: int, register: Register, value: int, attempts: int = _ATTEMPTS) -> None:
        """Sets a register and waits until the motor confirms it."""
        what = f"writing {value} to {register}"

        def exchange() -> None:
            result, error = self._call(
                device, what, self._packets.writeTxRx, device, register.address, register.size, _cells(register, value)
            )
            self._check(device, what, result, error)

        _repeat(exchange, attempts)

    def write_together(self, register: Register, values: Mapping[int, int]) -> None:
        """Sets a register of several motors in one packet (Sync Write), which none of them answers.

        Args:
            register: Register to set.
            values: Value by id.

        Raises:
            NoAnswerError: The packet couldn't be sent in time.
        """
        what = f"writing to {register} of motors {', '.join(map(str, values))}"
        cells = [cell for device, value in values.items() for cell in (device, *_cells(register, value))]
        packet = self._packets.syncWriteTxOnly
        result = self._call(None, what, packet, register.address, register.size, cells, len(cells))
        if result != dynamixel_sdk.COMM_SUCCESS:
            raise NoAnswerError(
                f"{what} on {self.name} failed: the port didn't take the packet in {_WRITE_TIMEOUT:g} s"
            )

    def _motor(self, device: int | None) -> str:
        return f"the motors on {self.name}" if device is None else f"motor {device} on {self.name}"

    def _call(self, device: int | None, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Calls a function of the library, whose exceptions become sentences."""
        self._port.is_using = False  # an exchange that was cut short leaves it set
        try:
            return function(self._port, *arguments)
        except _PORT_ERRORS as error:
            raise MotorError(
                f"serial port {self.name} was lost while {what} ({_reason(error)}); "
                f"is the cable still in? Without packets a motor's watchdog stops it"
            ) from error
        except _EndlessError:
            raise NoAnswerError(
                f"{self._motor(device)}: {what} got bytes without end that aren't the answer; is another program or "
                f"device talking on {self.name}?"
            ) from None
        except IndexError:  # the library stumbles over some damaged answers
            raise NoAnswerError(f"{self._motor(device)}: {what} got a damaged answer") from None

    def _check(self, device: int, what: str, result: int, error: int) -> None:
        """Raises what the result of the library and the error of a status packet say."""
        motor = self._motor(device)
        if result == dynamixel_sdk.COMM_RX_CORRUPT:
            raise NoAnswerError(f"{motor}: {what} got a damaged answer; check cable, ground and baud rate")
        if result != dynamixel_sdk.COMM_SUCCESS:
            raise NoAnswerError(
                f"{motor} didn't answer {what} at {self.baud} baud; "
                f"check power, cable, id and baud rate (Dynamixel Wizard finds them)"
            )
        number = error & ~ct.ALERT
        if number == ct.CRC_ERROR:  # it was damaged on the way there, so the next exchange may succeed
            raise NoAnswerError(f"{motor} refused {what}: {_ERRORS[number]}")
        if number:
            raise MotorError(f"{motor} refused {what}: {_ERRORS.get(number, f'unknown error {number}')}")
        if error & ct.ALERT:
            raise HardwareAlertError(f"{motor} reports a hardware error")


class _EndlessError(Exception):
    """Bytes keep coming when the time of an answer is over, and more of them than it has."""


class _Port(dynamixel_sdk.PortHandler):  # pyright: ignore[reportUntypedBaseClass]
    """The library's port, but it waits in the operating system instead of spinning, and no longer than needed.

    Its clock is one that nobody sets.

    Attributes:
        written_at: Time at which the last packet had been handed to the operating system [s of time.monotonic].
    """

    def __init__(self, name: str, baud: int) -> None:
        super().__init__(name)
        self.baudrate = baud
        self.written_at = 0.0
        self._latency = _ADAPTER_LATENCY
        self._line_free_at = 0.0  # when the bytes that were written have left
        self._expected = self._received = 0  # bytes of the answer, and bytes that came since the question

    def open(self) -> None:
        """Opens the port for this program alone, and asks the adapter to pass bytes on at once."""
        self.setBaudRate(self.baudrate)
        line: Any = self.ser
        line.exclusive = True
        line.timeout = _READ_TIMEOUT
        line.write_timeout = _WRITE_TIMEOUT
        with contextlib.suppress(ValueError, NotImplementedError, OSError):  # a pseudo-terminal has no such mode
            line.set_low_latency_mode(True)
            self._latency = _LOW_LATENCY

    def writePort(self, packet: list[int]) -> int:  # noqa: N802 - the library's name
        """Sends a packet and returns how many bytes were sent.

        They are 0 when time ran out: the line is full, or the program was halted.
        """
        try:
            written = int(super().writePort(packet) or 0)
        except SerialTimeoutException:
            written = 0
        self.written_at = time.monotonic()
        self._line_free_at = max(self.written_at, self._line_free_at) + 1e-3 * self.tx_time_per_byte * written
        return written

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Reads at most so many bytes.

        The library looks at the clock only when bytes are missing; so this ends what never ends.
        """
        if self._received > self._expected + _MOST_NOISE and self.getTimeSinceStart() > self.packet_timeout:
            raise _EndlessError
        content = bytes(super().readPort(length))
        self._received += len(content)
        return content

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Starts to wait for an answer of this many bytes, which comes after those that are still on their way out."""
        self._expected, self._received = packet_length, 0
        leaving = 1e3 * max(0.0, self._line_free_at - time.monotonic())
        self.setPacketTimeoutMillis(leaving + self.tx_time_per_byte * packet_length + self._latency)

    def getCurrentTime(self) -> float:  # noqa: N802
        """Milliseconds of a clock that only goes forward."""
        return 1e3 * time.monotonic()


def _cells(register: Register, value: int) -> list[int]:
    """The bytes of a value."""
    return list(value.to_bytes(register.size, "little", signed=register.signed))


def _repeat(exchange: Callable[[], Answer], attempts: int) -> Answer:
    """The result of an exchange; only a missing answer leads to another attempt."""
    for left in reversed(range(attempts)):
        try:
            return exchange()
        except NoAnswerError:
            if not left:
                raise
    raise ValueError(f"{attempts} attempts")


def _reason(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else str(error) or type(error).__name__
