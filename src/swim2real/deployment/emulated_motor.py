"""An emulated Dynamixel XW540-T140-R: its control table, the rules of writing to it, and how it turns.

What it leaves out: position, current and PWM modes (they are accepted, but nothing turns), indirect addresses, reg
write, action, sync and bulk packets (answered with an instruction error), load. It accelerates as fast as it is told,
but no faster than `STEEPEST`, and reaches no speed beyond the data sheet's no load speed at 12 V.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from swim2real.deployment import control_table as ct
from swim2real.deployment.control_table import Register
from swim2real.deployment.packets import PING, READ, REBOOT, STATUS, WRITE, Packet, build

STEEPEST = 300.0  # rad/s², what it can do at most
COASTING = 60.0  # rad/s², how it slows down without torque
NO_LOAD_SPEED = 72 * 2 * math.pi / 60  # rad/s at 12.0 V, e-Manual
_SIZE = 662  # bytes of the control table
_GOALS = range(100, 120)  # read-only once the watchdog has tripped


class EmulatedMotor:
    """Answers packets as the motor would, and turns. `clock` gives seconds."""

    def __init__(
        self, device: int = 1, model_number: int = ct.MODEL_NUMBER, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._table = bytearray(_SIZE)
        self._clock = clock
        self._now = clock()
        self._last_packet = self._now
        self._speed = 0.0
        self._angle = 0.0
        self.temperature = ct.PRESENT_TEMPERATURE.default
        for register in ct.REGISTERS:
            self._set(register, register.default)
        self._set(ct.ID, device)
        self._set(ct.MODEL_REGISTER, model_number)

    def get(self, register: Register) -> int:
        """What a register holds now; reading it this way isn't a packet."""
        self._advance()
        return self._get(register)

    def set(self, register: Register, value: int) -> None:
        """Sets a register, past all rules: how the motor was left by somebody else."""
        self._advance()
        self._set(register, value)

    @property
    def velocity(self) -> float:
        """How fast it turns now [rad/s]."""
        self._advance()
        return self._speed

    @property
    def angle(self) -> float:
        """How far it has turned [rad]."""
        self._advance()
        return self._angle

    @property
    def watchdog_tripped(self) -> bool:
        return self.get(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED

    def answer(self, packet: Packet) -> bytes | None:
        """The bytes of the status packet; None where the motor keeps silent."""
        if packet.id != self._get(ct.ID):
            return None
        self._advance()
        self._last_packet = self._now
        error, data = self._act(packet)
        if not self._answers(packet.instruction):
            return None
        if self._get(ct.HARDWARE_ERROR):
            error |= ct.ALERT
        return build(packet.id, STATUS, bytes([error]) + data)

    def _act(self, packet: Packet) -> tuple[int, bytes]:
        if not packet.intact:
            return ct.CRC_ERROR, b""
        if packet.instruction == PING:
            return 0, bytes(self._table[0:2] + self._table[6:7])
        if packet.instruction == READ:
            return self._read(packet.parameters)
        if packet.instruction == WRITE:
            return self._write(packet.parameters), b""
        if packet.instruction == REBOOT:
            self._reboot()
            return 0, b""
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
        changes: list[tuple[Register, int]] = []
        while data:
            register = _BY_ADDRESS.get(address)
            if register is None or not register.writable:
                return ct.ACCESS_ERROR
            if len(data) < register.size:
                return ct.LENGTH_ERROR
            value = int.from_bytes(data[: register.size], "little", signed=register.signed)
            if error := self._refusal(register, value):
                return error
            changes.append((register, value))
            address, data = address + register.size, data[register.size :]
        for register, value in changes:
            self._apply(register, value)
        return 0

    def _refusal(self, register: Register, value: int) -> int:
        if register.in_eeprom and self._get(ct.TORQUE_ENABLE):
            return ct.ACCESS_ERROR
        if register.address in _GOALS and self._get(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED:
            return ct.RANGE_ERROR
        low, high = register.low, register.high
        if (low is not None and value < low) or (high is not None and value > high):
            return ct.RANGE_ERROR
        if register is ct.GOAL_VELOCITY and abs(value) > self._get(ct.VELOCITY_LIMIT):
            return ct.LIMIT_ERROR
        if register is ct.TORQUE_ENABLE and value and self._get(ct.HARDWARE_ERROR) & self._get(ct.SHUTDOWN):
            return ct.RESULT_FAIL  # only a reboot helps
        return 0

    def _apply(self, register: Register, value: int) -> None:
        self._set(register, value)
        if register is ct.OPERATING_MODE:
            self._set(ct.PROFILE_ACCELERATION, 0)

    def _reboot(self) -> None:
        for register in ct.REGISTERS:
            if not register.in_eeprom:
                self._set(register, register.default)

    def _advance(self) -> None:
        """Lets it turn until now; the watchdog may trip on the way."""
        until = self._clock()
        period = self._get(ct.BUS_WATCHDOG)
        if self._get(ct.TORQUE_ENABLE) and 0 < period < ct.WATCHDOG_TRIPPED:
            trip = self._last_packet + period * ct.WATCHDOG_UNIT
            if until > trip:
                self._turn(max(trip, self._now))
                self._set(ct.BUS_WATCHDOG, ct.WATCHDOG_TRIPPED)
                self._set(ct.PROFILE_ACCELERATION, 0)
        self._turn(until)
        self._warm()
        self._set(ct.PRESENT_VELOCITY, round(self._speed / ct.VELOCITY_UNIT))
        angle = math.floor(self._angle / ct.POSITION_UNIT)
        self._set(ct.PRESENT_POSITION, (angle + 2**31) % 2**32 - 2**31)
        self._set(ct.PRESENT_TEMPERATURE, self.temperature)

    def _warm(self) -> None:
        if self.temperature > self._get(ct.TEMPERATURE_LIMIT):
            self._set(ct.HARDWARE_ERROR, self._get(ct.HARDWARE_ERROR) | ct.OVERHEATING)
        if self._get(ct.HARDWARE_ERROR) & self._get(ct.SHUTDOWN):
            self._set(ct.TORQUE_ENABLE, 0)

    def _turn(self, until: float) -> None:
        seconds = until - self._now
        self._now = until
        torque = self._get(ct.TORQUE_ENABLE)
        turning = torque and self._get(ct.OPERATING_MODE) == ct.VELOCITY_MODE
        stopped = self._get(ct.BUS_WATCHDOG) == ct.WATCHDOG_TRIPPED
        goal = self._get(ct.GOAL_VELOCITY) * ct.VELOCITY_UNIT if turning and not stopped else 0.0
        goal = min(max(goal, -NO_LOAD_SPEED), NO_LOAD_SPEED)
        profile = self._get(ct.PROFILE_ACCELERATION) * ct.ACCELERATION_UNIT
        steepness = min(profile or STEEPEST, STEEPEST) if torque else COASTING
        ramp = min(abs(goal - self._speed) / steepness, seconds)
        reached = self._speed + math.copysign(steepness * ramp, goal - self._speed)
        if ramp < seconds:
            reached = goal
        self._angle += (self._speed + reached) / 2 * ramp + reached * (seconds - ramp)
        self._speed = reached

    def _get(self, register: Register) -> int:
        cells = self._table[register.address : register.address + register.size]
        return int.from_bytes(cells, "little", signed=register.signed)

    def _set(self, register: Register, value: int) -> None:
        cells = value.to_bytes(register.size, "little", signed=register.signed)
        self._table[register.address : register.address + register.size] = cells


_BY_ADDRESS = {register.address: register for register in ct.REGISTERS}
