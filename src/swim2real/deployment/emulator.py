"""A serial port with emulated motors behind it, on a pseudo-terminal.

`python -m swim2real.deployment.emulator [BAUD [ID[:MODEL] ...]]` serves motors until its standard input ends; without
an id it is one, with id 1, and without a model an XW540-T140-R. Tests and `deploy --dry-run` use it. Faults are
scripted: which answers are damaged, and how.
"""

from __future__ import annotations

import contextlib
import math
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

from swim2real.deployment.control_table import (
    ID,
    MODELS,
    RETURN_DELAY,
    RETURN_DELAY_UNIT,
    TEMPERATURE_LIMIT,
    XW540,
    model_named,
)
from swim2real.deployment.emulated_motor import STATUS, EmulatedMotor, Packet, PacketParser, build_packet
from swim2real.deployment.schedule import real_time_priority

_FRAME = 10  # bytes of an instruction besides its parameters
_BITS = 10  # on the wire for a byte

_OTHER = 200  # id of a motor that talks unasked
_FLOOD = bytes(range(256))
_CHATTER = build_packet(_OTHER, STATUS, bytes(5))

Kind = Literal[
    "silent", "bad-crc", "garbage", "noise-before", "slow", "overheated", "unplugged", "echo", "half", "flood",
    "chatter",
]  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong.

    Attributes:
        kind: `silent`: no answer. `bad-crc`: a bit of the answer is flipped. `garbage`: other bytes in its place.
            `noise-before`: bytes in front of it. `slow`: it comes late. `overheated`: the motor gets too hot.
            `unplugged`: the port goes away. `echo`: the question comes back in its place. `half`: its first half.
            `flood`: bytes without end. `chatter`: answers of a motor that wasn't asked, without end.
        first: First packet that is concerned; packets on the bus count from 0.
        count: Number of packets concerned.
        delay: Delay of a slow answer [s].
        device: Id of the motor that is concerned; None for all.
    """

    kind: Kind
    first: int = 0
    count: float = float("inf")
    delay: float = 0.05
    device: int | None = None

    def hits(self, packet: int, device: int) -> bool:
        return self.first <= packet < self.first + self.count and self.device in (None, device)


class Emulator:
    """Motors on a port of their own, served by a thread while the context is open.

    Attributes:
        motors: The emulated motors.
        port: Name of the port to open.
        packets: Packets that were received, each with its time [s of time.monotonic].
    """

    def __init__(self, *motors: EmulatedMotor, faults: Sequence[Fault] = (), baud: int | None = None) -> None:
        """Opens the port.

        Args:
            motors: Motors to serve; without any it is one as it is sold.
            faults: What goes wrong.
            baud: Answers take the time that question and answer need at this rate, and the motor's return delay; None
                for answers at once.
        """
        self._baud = baud
        self.motors = motors or (EmulatedMotor(),)
        self.packets: list[tuple[float, Packet]] = []
        self._faults = tuple(faults)
        self._lock = threading.Lock()
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self._unasked = b""  # what is sent for as long as there is room
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

    @property
    def motor(self) -> EmulatedMotor:
        """The first motor."""
        return self.motors[0]

    def velocity(self) -> float:
        """Present speed of the fastest motor, either way [rad/s]."""
        with self._lock:
            return max((motor.velocity for motor in self.motors), key=abs)

    def _serve(self) -> None:
        parser = PacketParser()
        try:
            while True:
                ready, room, _ = select.select([self._ours, self._wake], [self._ours] if self._unasked else [], [])
                if self._wake in ready:
                    return
                if room:
                    self._write(self._unasked)
                if self._ours in ready:
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
        answer, active = None, dict[Kind, Fault]()
        with self._lock:
            self.packets.append((time.monotonic(), packet))
            for motor in self.motors:
                device = motor.get(ID)
                faults: dict[Kind, Fault] = {f.kind: f for f in self._faults if f.hits(number, device)}
                if "unplugged" in faults:
                    return False
                if "overheated" in faults:
                    motor.temperature = motor.get(TEMPERATURE_LIMIT) + 1
                if (answered := motor.answer(packet)) is not None:
                    answer, active, delay = answered, faults, motor.get(RETURN_DELAY) * RETURN_DELAY_UNIT
                    break
            else:
                delay = 0.0
        self._unasked = _FLOOD if "flood" in active else _CHATTER if "chatter" in active else b""
        if answer is not None and ("silent" in active or self._unasked):
            return True
        if self._baud:
            size = _FRAME + len(packet.parameters) + len(answer or b"")
            time.sleep(size * _BITS / self._baud + delay)
        if answer is None:
            return True
        if "slow" in active:
            time.sleep(active["slow"].delay)
        self._write(build_packet(packet.id, packet.instruction, packet.parameters) if "echo" in active
                    else _damaged(answer, active))  # fmt: skip
        return True

    def _write(self, content: bytes) -> None:
        """Sends bytes; those for which there is no room are lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._ours, content)


def _damaged(answer: bytes, active: dict[Kind, Fault]) -> bytes:
    if "bad-crc" in active:
        answer = answer[:-1] + bytes([answer[-1] ^ 0x10])
    if "garbage" in active:
        answer = bytes(byte ^ 0x5A for byte in answer)
    if "half" in active:
        answer = answer[: len(answer) // 2]
    if "noise-before" in active:
        answer = b"\x00\xff\xff\xfd\x13\xff" + answer
    return answer


def main() -> None:
    """Serves motors and writes the name of their port."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C concerns the program that uses the motors
    baud = int(sys.argv[1]) if len(sys.argv) > 1 else None
    motors = [_motor(word) for word in sys.argv[2:] or ("1",)]
    # a real motor doesn't wait for a busy machine
    with real_time_priority(), Emulator(*motors, baud=baud) as emulator:
        sys.stdout.write(emulator.port + "\n")
        sys.stdout.flush()
        sys.stdin.buffer.read()


def _motor(word: str) -> EmulatedMotor:
    """The motor that `ID` or `ID:MODEL` stands for, in the middle of its turn."""
    device, _, name = word.partition(":")
    model = model_named(name or XW540.name)
    if model is None:
        sys.exit(f"the model '{name}' isn't known; known are {', '.join(m.name for m in MODELS)}")
    return EmulatedMotor(int(device), model, angle=math.pi)


if __name__ == "__main__":
    main()
