"""The serial port as the maker's library wants it, with changes that keep the 50 Hz.

Imported only where a motor is spoken to: it needs the extra `deploy`.
"""

from __future__ import annotations

import contextlib
import time
from typing import Any

from dynamixel_sdk import PortHandler
from serial import SerialTimeoutException

WRITE_TIMEOUT = 0.1  # s
_ONE_READ = 0.001  # s that one look for bytes waits
_LOW_LATENCY = 8.0  # ms that an answer may take beyond its bytes when the adapter passes bytes on at once
_ADAPTER_LATENCY = 34.0  # ms when it may gather them for 16 ms, as the library allows for


class Port(PortHandler):  # pyright: ignore[reportUntypedBaseClass]
    """Waits in the operating system instead of spinning, on a clock that nobody sets, and not for longer than needed.

    `written_at` is when the last packet had been handed to the operating system [s of time.monotonic].
    """

    def __init__(self, name: str, baud: int) -> None:
        super().__init__(name)
        self.baudrate = baud
        self.written_at = 0.0
        self._latency = _ADAPTER_LATENCY

    def open(self) -> None:
        """Opens the port for us alone, and asks the adapter to pass bytes on at once."""
        self.setBaudRate(self.baudrate)
        line: Any = self.ser
        line.exclusive = True
        line.timeout = _ONE_READ
        line.write_timeout = WRITE_TIMEOUT
        with contextlib.suppress(ValueError, NotImplementedError, OSError):  # a pseudo-terminal has no such thing
            line.set_low_latency_mode(True)
            self._latency = _LOW_LATENCY

    def writePort(self, packet: list[int]) -> int:  # noqa: N802 - the library's name
        """Sends a packet. Returns how many bytes, 0 when time ran out: the line is full, or the program was halted."""
        try:
            written = int(super().writePort(packet) or 0)
        except SerialTimeoutException:
            written = 0
        self.written_at = time.monotonic()
        return written

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Starts to wait for an answer of so many bytes."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + self._latency)

    def getCurrentTime(self) -> float:  # noqa: N802
        """Milliseconds of a clock that only goes forward."""
        return 1e3 * time.monotonic()
