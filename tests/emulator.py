"""Emulated Dynamixel X motors: their packets, control table, the rules of writing to it, how they turn, and their port.

The packets are those of Dynamixel's protocol 2.0, with byte stuffing and CRC-16 (ROBOTIS e-Manual, Protocol 2.0 and CRC
calculation). The program itself speaks through the maker's library, so each side checks the other.

Not emulated: extended position, current and PWM modes (they are accepted, but nothing turns), indirect addresses, reg
write, action, reboot, sync read and bulk packets (answered with an instruction error), homing offset, reverse mode,
load. The motor accelerates as its profile says, but no faster than `STEEPEST`, and reaches no speed beyond the data
sheet's no load speed at 12 V. In position mode it takes the quickest way to its goal that the profile allows.

`python tests/emulator.py [BAUD [ID[:MODEL] ...]]` serves motors on a pseudo-terminal until its standard input ends;
without an id it is one, with id 1, and without a model an XW540-T140-R.
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
from collections.abc import Callable
from dataclasses import dataclass

from motorline import control_table as ct
from motorline.control_table import Model, Register
from motorline.schedule import real_time_priority

HEADER = b"\xff\xff\xfd\x00"
PING, READ, WRITE, STATUS, SYNC_WRITE = 0x01, 0x02, 0x03, 0x55, 0x83
BROADCAST = 254  # id that all motors listen to and none answers
_LONGEST = 1024  # bytes after the header's length field; longer ones are noise
STEEPEST = 300.0  # rad/s², what it can do at most
COASTING = 60.0  # rad/s², how it slows down without torque
_SIZE = 662  # bytes of the control table
_GOALS = range(100, 120)  # read-only once the watchdog has tripped
_TURN = 2 * math.pi  # rad
_RPM = _TURN / 60  # rad/s
_FRAME = 10  # bytes of an instruction besides its parameters
_BITS = 10  # on the wire for a byte
_RAM = ct.TORQUE_ENABLE.address  # registers below are kept without power, and locked while torque is on
OVERHEATING = 0x04  # bit of the hardware error status
_RETURN_DELAY_UNIT = 2e-6  # s
ID, RETURN_DELAY = Register("ID", 7, 1), Register("Return Delay Time", 9, 1)  # which the program doesn't use
_BY_ADDRESS = {register.address: register for register in (*ct.REGISTERS, ID, RETURN_DELAY)}
# e-Manual, the page of each model: its speed without load at 12.0 V [rev/min] and its Temperature Limit (31) [°C]
SOLD = {
    "XW540-T140-R": (72, 80), "XL430-W250": (61, 72), "XM430-W210": (77, 80), "XM430-W350": (46, 80),
    "XM540-W150": (53, 80), "XM540-W270": (30, 80),
}  # fmt: skip
_ANY = (-(2**31), 2**31 - 1)
_RANGES = {  # of the registers that can be written
    ID: (0, 252), RETURN_DELAY: (0, 254), ct.DRIVE_MODE: (0, 13), ct.OPERATING_MODE: (0, 16),
    ct.HOMING_OFFSET: (-1_044_479, 1_044_479), ct.TEMPERATURE_LIMIT: (0, 100), ct.VELOCITY_LIMIT: (0, 1023),
    ct.MAX_POSITION: (0, 4095), ct.MIN_POSITION: (0, 4095), ct.SHUTDOWN: (0, 63), ct.TORQUE_ENABLE: (0, 1),
    ct.STATUS_RETURN_LEVEL: (0, 2), ct.BUS_WATCHDOG: (0, 127), ct.GOAL_VELOCITY: _ANY,
    ct.PROFILE_ACCELERATION: (0, 32_767), ct.PROFILE_VELOCITY: (0, 32_767), ct.GOAL_POSITION: _ANY,
}  # fmt: skip
_DEFAULTS = {  # what isn't 0 in a motor as it is sold
    ct.FIRMWARE: 45, RETURN_DELAY: 250, ct.OPERATING_MODE: ct.POSITION_MODE, ct.MAX_POSITION: 4095, ct.SHUTDOWN: 52,
    ct.STATUS_RETURN_LEVEL: 2, ct.PRESENT_VOLTAGE: 120, ct.PRESENT_TEMPERATURE: 30,
}  # fmt: skip


@dataclass(frozen=True)
class Packet:
    """An instruction as it was received."""

    id: int  # of the motor that it is for
    instruction: int  # `PING`, `READ`, `WRITE`, `STATUS`, `SYNC_WRITE`, or one that isn't emulated
    parameters: bytes  # without byte stuffing
    intact: bool = True  # by its CRC


def crc16(data: bytes) -> int:
    """CRC-16/BUYPASS: polynomial 0x8005, start 0, no reflection."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


def build_packet(device: int, instruction: int, parameters: bytes = b"") -> bytes:
    """The bytes of a packet. A status packet's first parameter is its error."""
    body = bytes([instruction]) + parameters
    stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = HEADER + bytes([device]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return packet + crc16(packet).to_bytes(2, "little")


class PacketParser:
    """Finds packets in a stream of bytes that arrives in pieces; other bytes are skipped."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Adds bytes and returns the packets that are complete now."""
        self._waiting += data
        packets: list[Packet] = []
        while True:
            start = self._waiting.find(HEADER)
            if start < 0:
                del self._waiting[: max(0, len(self._waiting) - len(HEADER) + 1)]
                return packets
            del self._waiting[:start]
            if len(self._waiting) < 7:
                return packets
            length = int.from_bytes(self._waiting[5:7], "little")
            if not 3 <= length <= _LONGEST:
                del self._waiting[:1]
                continue
            if len(self._waiting) < 7 + length:
                return packets
            whole = bytes(self._waiting[: 7 + length])
            del self._waiting[: 7 + length]
            body = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            intact = crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")
            packets.append(Packet(whole[4], body[0], body[1:], intact))


class EmulatedMotor:
    """Answers packets as the motor would, and turns; `temperature` is the present one [°C]."""

    def __init__(
        self, device: int = 1, model: Model = ct.XW540, clock: Callable[[], float] = time.monotonic, angle: float = 0.0
    ) -> None:
        """Makes a motor as it is sold, with an id, by a clock [s], its shaft at an angle [rad]."""
        self._table = bytearray(_SIZE)
        self._clock = clock
        self._now = clock()
        self._last_packet = self._now
        self._speed = 0.0
        self._angle = angle
        no_load, temperature_limit = SOLD[model.name]
        self._no_load = no_load * _RPM
        self.temperature = _DEFAULTS[ct.PRESENT_TEMPERATURE]
        for register, value in _DEFAULTS.items():
            self._set(register, value)
        for register, value in (
            (ID, device), (ct.MODEL_REGISTER, model.number), (ct.VELOCITY_LIMIT, model.velocity_limit),
            (ct.TEMPERATURE_LIMIT, temperature_limit),
        ):  # fmt: skip
            self._set(register, value)

    def get(self, register: Register) -> int:
        """The value of a register now; reading it this way doesn't count as a packet."""
        self._advance()
        return self._get(register)

    def set(self, register: Register, value: int) -> None:
        """Sets a register without any check, as somebody else may have left it."""
        self._advance()
        self._set(register, value)

    @property
    def velocity(self) -> float:
        """Present speed [rad/s]."""
        self._advance()
        return self._speed

    @property
    def angle(self) -> float:
        """Angle of its shaft, with the turns since it was made [rad]."""
        self._advance()
        return self._angle

    @property
    def watchdog_tripped(self) -> bool:
        return self.get(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED

    def answer(self, packet: Packet) -> bytes | None:
        """The bytes of the status packet; None where the motor doesn't answer."""
        if packet.id not in (self._get(ID), BROADCAST):
            return None
        self._advance()
        self._last_packet = self._now
        error, data = self._execute(packet)
        if packet.id == BROADCAST or not self._answers(packet.instruction):
            return None
        if self._get(ct.HARDWARE_ERROR):
            error |= ct.ALERT
        return build_packet(packet.id, STATUS, bytes([error]) + data)

    def _execute(self, packet: Packet) -> tuple[int, bytes]:
        if not packet.intact:
            return ct.CRC_ERROR, b""
        if packet.instruction == PING:
            return 0, bytes(self._table[0:2] + self._table[6:7])
        if packet.instruction == READ:
            return self._read(packet.parameters)
        if packet.instruction == WRITE:
            return self._write(packet.parameters), b""
        if packet.instruction == SYNC_WRITE and packet.id == BROADCAST:
            return self._sync_write(packet.parameters), b""
        return ct.INSTRUCTION_ERROR, b""

    def _answers(self, instruction: int) -> bool:
        level = self._get(ct.STATUS_RETURN_LEVEL)
        return instruction == PING or level == 2 or (level == 1 and instruction == READ)

    def _read(self, parameters: bytes) -> tuple[int, bytes]:
        if len(parameters) != 4:
            return ct.LENGTH_ERROR, b""
        address, size = int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:], "little")
        if size == 0 or address + size > _SIZE:
            return ct.ACCESS_ERROR, b""
        return 0, bytes(self._table[address : address + size])

    def _write(self, parameters: bytes) -> int:
        """Writes one register, or several that follow one another, or nothing at all where one can't be written."""
        address, data = int.from_bytes(parameters[:2], "little"), parameters[2:]
        if not data:
            return ct.LENGTH_ERROR
        changes: dict[Register, int] = {}
        while data:
            register = _BY_ADDRESS.get(address)
            if register is None or register not in _RANGES:
                return ct.ACCESS_ERROR
            if len(data) < register.size:
                return ct.LENGTH_ERROR
            changes[register] = value = int.from_bytes(data[: register.size], "little", signed=register.signed)
            if error := self._write_error(register, value):
                return error
            address, data = address + register.size, data[register.size :]
        for register, value in changes.items():
            self._apply(register, value)
        return 0

    def _sync_write(self, parameters: bytes) -> int:
        """Writes this motor's share of a packet for several: address, size, then id and data of each."""
        size = int.from_bytes(parameters[2:4], "little")
        for start in range(4, len(parameters) - size, size + 1):
            if parameters[start] == self._get(ID):
                return self._write(parameters[:2] + parameters[start + 1 : start + 1 + size])
        return 0

    def _write_error(self, register: Register, value: int) -> int:
        if register.address < _RAM and self._get(ct.TORQUE_ENABLE):
            return ct.ACCESS_ERROR
        if register.address in _GOALS and self._get(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED:
            return ct.RANGE_ERROR
        low, high = _RANGES[register]
        if not low <= value <= high:
            return ct.RANGE_ERROR
        if register in (ct.GOAL_VELOCITY, ct.PROFILE_VELOCITY) and abs(value) > self._get(ct.VELOCITY_LIMIT):
            return ct.LIMIT_ERROR
        in_turn = self._get(ct.MIN_POSITION) <= value <= self._get(ct.MAX_POSITION)
        if register is ct.GOAL_POSITION and self._get(ct.OPERATING_MODE) == ct.POSITION_MODE and not in_turn:
            return ct.LIMIT_ERROR
        if register is ct.TORQUE_ENABLE and value and self._get(ct.HARDWARE_ERROR) & self._get(ct.SHUTDOWN):
            return ct.RESULT_FAIL  # only a reboot helps
        return 0

    def _apply(self, register: Register, value: int) -> None:
        self._set(register, value)
        if register is ct.OPERATING_MODE:
            self._forget_profile()
        if register in (ct.OPERATING_MODE, ct.TORQUE_ENABLE) and self._get(ct.OPERATING_MODE) == ct.POSITION_MODE:
            self._angle %= _TURN  # within one turn from now on

    def _advance(self) -> None:
        """Turns the motor until now; the watchdog may trip on the way."""
        until = self._clock()
        period = self._get(ct.BUS_WATCHDOG)
        if self._get(ct.TORQUE_ENABLE) and 0 < period < ct.WATCHDOG_TRIPPED:
            trip = self._last_packet + period * ct.WATCHDOG_UNIT
            if until > trip:
                self._turn(max(trip, self._now))
                self._set(ct.BUS_WATCHDOG, ct.WATCHDOG_TRIPPED)
                self._forget_profile()
        self._turn(until)
        if self.temperature > self._get(ct.TEMPERATURE_LIMIT):
            self._set(ct.HARDWARE_ERROR, self._get(ct.HARDWARE_ERROR) | OVERHEATING)
        if self._get(ct.HARDWARE_ERROR) & self._get(ct.SHUTDOWN):
            self._set(ct.TORQUE_ENABLE, 0)
        self._set(ct.PRESENT_VELOCITY, round(self._speed / ct.VELOCITY_UNIT))
        angle = math.floor(self._angle / ct.POSITION_UNIT)
        self._set(ct.PRESENT_POSITION, (angle + 2**31) % 2**32 - 2**31)
        self._set(ct.PRESENT_TEMPERATURE, self.temperature)

    def _forget_profile(self) -> None:
        self._set(ct.PROFILE_ACCELERATION, 0)
        self._set(ct.PROFILE_VELOCITY, 0)

    def _turn(self, until: float) -> None:
        seconds = until - self._now
        self._now = until
        torque = self._get(ct.TORQUE_ENABLE)
        mode = self._get(ct.OPERATING_MODE) if torque else None
        stopped = self._get(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED
        profile = self._get(ct.PROFILE_ACCELERATION) * ct.ACCELERATION_UNIT
        steepness = min(profile or STEEPEST, STEEPEST) if torque else COASTING
        if mode == ct.POSITION_MODE and not stopped:
            fastest, goal = self._get(ct.PROFILE_VELOCITY) * ct.VELOCITY_UNIT, self._get(ct.GOAL_POSITION)
            steepness = steepness if fastest else STEEPEST
            self._go_to(goal * ct.POSITION_UNIT, min(fastest or self._no_load, self._no_load), steepness, seconds)
            return
        goal = self._get(ct.GOAL_VELOCITY) * ct.VELOCITY_UNIT if mode == ct.VELOCITY_MODE and not stopped else 0.0
        goal = min(max(goal, -self._no_load), self._no_load)
        ramp = min(abs(goal - self._speed) / steepness, seconds)
        reached = self._speed + math.copysign(steepness * ramp, goal - self._speed)
        if ramp < seconds:
            reached = goal
        self._angle += (self._speed + reached) / 2 * ramp + reached * (seconds - ramp)
        self._speed = reached

    def _go_to(self, goal: float, fastest: float, steepness: float, seconds: float) -> None:
        """Goes towards an angle for some time: speeds up, keeps the speed, slows down, so that it stops at the goal."""
        stop = self._angle + self._speed * abs(self._speed) / (2 * steepness)  # where it stops if it slows down now
        way = math.copysign(1.0, goal - stop)
        left, speed = way * (goal - self._angle), way * self._speed
        peak = min(math.sqrt(max(steepness * left + speed**2 / 2, 0.0)), max(fastest, speed))
        cruise = left - (2 * peak**2 - speed**2) / (2 * steepness)  # rad at the peak
        cruising = max(cruise, 0.0) / peak if peak else 0.0
        up, down = (peak - speed) / steepness, peak / steepness
        for acceleration, lasts in ((steepness, up), (0.0, cruising), (-steepness, down)):
            t = min(lasts, seconds)
            self._angle += way * (speed * t + acceleration * t**2 / 2)
            speed += acceleration * t
            seconds -= t
            if seconds <= 0:
                self._speed = way * speed
                return
        self._angle, self._speed = goal, 0.0

    def _get(self, register: Register) -> int:
        cells = self._table[register.address : register.address + register.size]
        return int.from_bytes(cells, "little", signed=register.signed)

    def _set(self, register: Register, value: int) -> None:
        cells = value.to_bytes(register.size, "little", signed=register.signed)
        self._table[register.address : register.address + register.size] = cells


class Emulator:
    """Motors on a port of their own, served by a thread while the context is open.

    `packets` are those that were received, each with its time [s of time.monotonic].
    """

    def __init__(self, *motors: EmulatedMotor, baud: int | None = None) -> None:
        """Opens the port of motors, by default one as it is sold.

        With a baud rate answers take the time that question and answer need at it, and the motor's return delay.
        """
        self.motors = motors or (EmulatedMotor(),)
        self.packets: list[tuple[float, Packet]] = []
        self._baud, self._lock = baud, threading.Lock()
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.port = os.ttyname(self._theirs)
        self._wake, self._stop = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="emulated motor", daemon=True)

    def __enter__(self) -> Emulator:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
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

    def handle(self, packet: Packet) -> bytes | None:
        """What is sent back for a packet, after the time that it takes; None for nothing."""
        with self._lock:
            self.packets.append((time.monotonic(), packet))
            answers = [(motor, answer) for motor in self.motors if (answer := motor.answer(packet)) is not None]
        answer, delay = None, 0.0
        if answers:
            answer, delay = answers[0][1], answers[0][0].get(RETURN_DELAY) * _RETURN_DELAY_UNIT
        if self._baud:
            time.sleep((_FRAME + len(packet.parameters) + len(answer or b"")) * _BITS / self._baud + delay)
        return answer

    def send(self, content: bytes) -> None:
        """Sends bytes; those for which there is no room are lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._ours, content)

    def _serve(self) -> None:
        parser = PacketParser()
        try:
            while self._wake not in (ready := select.select([self._ours, self._wake], [], [])[0]):
                for packet in parser.feed(os.read(self._ours, 4096)) if ready else ():
                    if answer := self.handle(packet):
                        self.send(answer)
        except OSError:  # the other end has gone
            pass
        finally:
            for end in (self._ours, self._theirs):
                with contextlib.suppress(OSError):
                    os.close(end)


def main() -> None:
    """Serves motors and writes the name of their port."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C concerns the program that uses the motors
    baud = int(sys.argv[1]) if len(sys.argv) > 1 else None
    motors: list[EmulatedMotor] = []
    for word in sys.argv[2:] or ("1",):
        device, _, name = word.partition(":")
        model = ct.MODELS.get(name or ct.XW540.name)
        if model is None:
            sys.exit(f"the model '{name}' isn't known; known are {', '.join(ct.MODELS)}")
        motors.append(EmulatedMotor(int(device), model, angle=math.pi))  # in the middle of its turn
    # a real motor doesn't wait for a busy machine
    with real_time_priority(), Emulator(*motors, baud=baud) as emulator:
        sys.stdout.write(emulator.port + "\n")
        sys.stdout.flush()
        sys.stdin.buffer.read()


if __name__ == "__main__":
    main()
