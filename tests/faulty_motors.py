"""Emulated motors whose answers are damaged, late or missing, as a script says."""

import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from emulator import ID, STATUS, Emulator, build_packet
from motorline import control_table as ct

OVERLOAD = 0x20
UNASKED = {"flood": bytes(range(256)), "chatter": build_packet(200, STATUS, bytes(5))}


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong with some packets (on the bus they count from 0), with one motor's or with all."""

    kind: Literal[
        "silent", "bad-crc", "garbage", "noise-before", "slow", "overheated", "overloaded", "unplugged", "echo", "half",
        "flood",  # bytes without end
        "chatter",  # answers of a motor that wasn't asked, without end
    ]  # fmt: skip
    first: int = 0
    count: float = float("inf")
    delay: float = 0.05  # s, of a slow answer
    device: int | None = None


class FaultyEmulator(Emulator):
    """An emulator with faults."""

    def __init__(self, *motors, faults=(), baud=None):
        super().__init__(*motors, baud=baud)
        self._faults, self._unasked, self._closed = faults, None, threading.Event()

    def __exit__(self, *error):
        self._closed.set()
        super().__exit__(*error)

    def stopped(self):
        """Whether no motor turns any more, 30 s from now at the latest: without torque they coast."""
        deadline = time.monotonic() + 30
        while self.velocity() and time.monotonic() < deadline:
            time.sleep(0.02)
        return self.velocity() == 0

    def handle(self, packet):
        number, active = len(self.packets), {}
        for fault in self._faults:
            if fault.first <= number < fault.first + fault.count and fault.device in (None, packet.id):
                active[fault.kind] = fault
        if "unplugged" in active:
            raise OSError
        if "overheated" in active:
            for motor in self.motors:
                if active["overheated"].device in (None, motor.get(ID)):
                    motor.temperature = motor.get(ct.TEMPERATURE_LIMIT) + 1
        if "overloaded" in active:  # as a motor says that is held fast
            for motor in self.motors:
                motor.set(ct.HARDWARE_ERROR, OVERLOAD)
        answer = super().handle(packet)
        if answer is None or "silent" in active:
            return None
        self._unasked = next((UNASKED[kind] for kind in active if kind in UNASKED), None)
        if self._unasked:
            threading.Thread(target=self._talk, daemon=True).start()
            return None
        if "slow" in active:
            time.sleep(active["slow"].delay)
        if "echo" in active:
            return build_packet(packet.id, packet.instruction, packet.parameters)
        if "bad-crc" in active:
            answer = answer[:-1] + bytes([answer[-1] ^ 0x10])
        if "garbage" in active:
            answer = bytes(byte ^ 0x5A for byte in answer)
        if "half" in active:
            answer = answer[: len(answer) // 2]
        return b"\x00\xff\xff\xfd\x13\xff" + answer if "noise-before" in active else answer

    def _talk(self):
        with suppress(OSError):
            while self._unasked and not self._closed.is_set():
                self.send(self._unasked)
                time.sleep(1e-4)
