"""A serial port with an emulated motor behind it, on a pseudo-terminal.

`python -m swim2real.deployment.emulator [BAUD [ID]]` serves a motor until its standard input ends. Tests and
`deploy --dry-run` use it. Faults are scripted: which answers are damaged, and how.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
import time
import tty
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Literal

from swim2real.deployment.control_table import RETURN_DELAY, RETURN_DELAY_UNIT, TEMPERATURE_LIMIT
from swim2real.deployment.emulated_motor import EmulatedMotor, Packet, PacketParser
from swim2real.deployment.schedule import real_time_priority

_FRAME = 10  # bytes of an instruction besides its parameters
_BITS = 10  # on the wire for a byte

Kind = Literal["silent", "bad-crc", "garbage", "noise-before", "slow", "overheated", "unplugged"]


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong.

    Attributes:
        kind: `silent`: no answer. `bad-crc`: a bit of the answer is flipped. `garbage`: other bytes in its place.
            `noise-before`: bytes in front of it. `slow`: it comes late. `overheated`: the motor gets too hot.
            `unplugged`: the port goes away.
        first: First packet that is concerned; packets to the motor count from 0.
        count: Number of packets concerned.
        delay: Delay of a slow answer [s].
    """

    kind: Kind
    first: int = 0
    count: float = float("inf")
    delay: float = 0.05

    def hits(self, packet: int) -> bool:
        return self.first <= packet < self.first + self.count


class Emulator:
    """A motor on a port of its own, served by a thread while the context is open.

    Attributes:
        motor: The emulated motor.
        port: Name of the port to open.
        packets: Packets that were received, each with its time [s of time.monotonic].
    """

    def __init__(
        self, motor: EmulatedMotor | None = None, faults: Sequence[Fault] = (), baud: int | None = None
    ) -> None:
        """Opens the port.

        Args:
            motor: Motor to serve; None for one as it is sold.
            faults: What goes wrong.
            baud: Answers take the time that question and answer need at this rate, and the motor's return delay; None
                for answers at once.
        """
        self._baud = baud
        self.motor = motor or EmulatedMotor()
        self.packets: list[tuple[float, Packet]] = []
        self._faults = tuple(faults)
        self._lock = threading.Lock()
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._wake, self._stop = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="emulated motor", daemon=True)

    def __enter__(self) -> Emulator:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stop)
        self._thread.join()
        os.close(self._wake)

    def velocity(self) -> float:
        """Present speed of the motor [rad/s]."""
        with self._lock:
            return self.motor.velocity

    def _serve(self) -> None:
        parser = PacketParser()
        try:
            while self._wake not in (ready := select.select([self._ours, self._wake], [], [])[0]):
                if ready:
                    for packet in parser.feed(os.read(self._ours, 4096)):
                        if not self._handle(packet):
                            return
        except OSError:  # the other end has gone
            pass
        finally:
            for end in (self._ours, self._theirs):
                with contextlib.suppress(OSError):
                    os.close(end)

    def _handle(self, packet: Packet) -> bool:
        """Answers a packet; returns False when the port has gone."""
        number = len(self.packets)
        active: dict[Kind, Fault] = {fault.kind: fault for fault in self._faults if fault.hits(number)}
        with self._lock:
            self.packets.append((time.monotonic(), packet))
            if "overheated" in active:
                self.motor.temperature = self.motor.get(TEMPERATURE_LIMIT) + 1
            answer = self.motor.answer(packet)
        if "unplugged" in active:
            return False
        if answer is None or "silent" in active:
            return True
        if self._baud:
            size = _FRAME + len(packet.parameters) + len(answer)
            time.sleep(size * _BITS / self._baud + self.motor.get(RETURN_DELAY) * RETURN_DELAY_UNIT)
        if "slow" in active:
            time.sleep(active["slow"].delay)
        os.write(self._ours, _damaged(answer, active))
        return True


def _damaged(answer: bytes, active: dict[Kind, Fault]) -> bytes:
    if "bad-crc" in active:
        answer = answer[:-1] + bytes([answer[-1] ^ 0x10])
    if "garbage" in active:
        answer = bytes(byte ^ 0x5A for byte in answer)
    if "noise-before" in active:
        answer = b"\x00\xff\xff\xfd\x13\xff" + answer
    return answer


def main() -> None:
    """Serves a motor and writes the name of its port."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C concerns the program that uses the motor
    baud = int(sys.argv[1]) if len(sys.argv) > 1 else None
    device = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    # a real motor doesn't wait for a busy machine
    with real_time_priority(), Emulator(EmulatedMotor(device), baud=baud) as emulator:
        sys.stdout.write(emulator.port + "\n")
        sys.stdout.flush()
        sys.stdin.buffer.read()


if __name__ == "__main__":
    main()
