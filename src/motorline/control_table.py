"""The control table of Dynamixel X motors: models, addresses, units, error bits, and the errors that are raised.

Source: ROBOTIS e-Manual, the page of each model (emanual.robotis.com/docs/en/dxl/x/xw540-t140) and Protocol 2.0
(emanual.robotis.com/docs/en/dxl/protocol2). The registers used here have the same addresses and units in all of them.
The defaults are those of the XW540-T140-R, the fish's motor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from swimbase.errors import Swim2RealError

VELOCITY_UNIT = 0.229 * 2 * math.pi / 60  # rad/s; 0.229 rev/min
ACCELERATION_UNIT = 214.577 * 2 * math.pi / 3600  # rad/s²; 214.577 rev/min²
POSITION_UNIT = 2 * math.pi / 4096  # rad
VOLTAGE_UNIT = 0.1  # V
WATCHDOG_UNIT = 0.02  # s
RETURN_DELAY_UNIT = 2e-6  # s

VELOCITY_MODE = 1
POSITION_MODE = 3
TIME_BASED_PROFILE = 0x04  # bit of the drive mode
REVERSE = 0x01  # bit of the drive mode
WATCHDOG_TRIPPED = 255  # -1 in the manual
WATCHDOG_FIRMWARE = 38  # the first that has a bus watchdog

ALERT = 0x80  # bit of a status packet's error: look at the hardware error status
RESULT_FAIL, INSTRUCTION_ERROR, CRC_ERROR, RANGE_ERROR, LENGTH_ERROR, LIMIT_ERROR, ACCESS_ERROR = range(1, 8)

HARDWARE_ERRORS = {
    0x01: "input voltage outside its limits",
    0x04: "overheating",
    0x08: "motor encoder failure",
    0x10: "electrical shock or too little power",
    0x20: "overload",
}
OVERHEATING = 0x04


@dataclass(frozen=True)
class Model:
    """A model of motor as it is sold.

    Attributes:
        name: Name in the manual.
        number: Model number (0), with which it answers a ping.
        velocity_limit: Velocity Limit (44) [0.229 rev/min].
        temperature_limit: Temperature Limit (31) [°C].
        voltages: Min and Max Voltage Limit (34, 32) [0.1 V].
        no_load: Speed without load at 12.0 V [rev/min].
    """

    name: str
    number: int
    velocity_limit: int
    temperature_limit: int
    voltages: tuple[int, int]
    no_load: int

    @property
    def speed(self) -> float:
        """The Velocity Limit [rad/s]."""
        return self.velocity_limit * VELOCITY_UNIT


# e-Manual, docs/en/dxl/x/{xw540-t140, xl430-w250, xm430-w210, xm430-w350, xm540-w150, xm540-w270}: "Control Table of
# EEPROM Area" and "Specifications"
_MODELS = (
    Model("XW540-T140-R", 1180, 304, 80, (95, 160), 72),
    Model("XL430-W250", 1060, 265, 72, (60, 140), 61),
    Model("XM430-W210", 1030, 330, 80, (95, 160), 77),
    Model("XM430-W350", 1020, 200, 80, (95, 160), 46),
    Model("XM540-W150", 1130, 230, 80, (95, 160), 53),
    Model("XM540-W270", 1120, 128, 80, (95, 160), 30),
)
MODELS = {model.name: model for model in _MODELS}
XW540 = _MODELS[0]


class MotorError(Swim2RealError):
    """The motor can't be reached, refuses a command or reports an error."""


class NoAnswerError(MotorError):
    """No answer came, or none that can be read. The next exchange may succeed."""


class HardwareAlertError(MotorError):
    """The motor reports a hardware error with its answer."""


@dataclass(frozen=True)
class Register:
    """One entry of the control table. Values are unsigned unless `low` is below 0.

    Attributes:
        name: Name in the manual.
        address: First byte.
        size: Number of bytes.
        low: Lowest value that can be written; None for any.
        high: Highest value that can be written; None for any.
        writable: Whether it can be written at all.
        default: Value of a motor as it is sold.
    """

    name: str
    address: int
    size: int
    low: int | None = None
    high: int | None = None
    writable: bool = True
    default: int = 0

    @property
    def signed(self) -> bool:
        return self.low is not None and self.low < 0

    @property
    def in_eeprom(self) -> bool:
        """Whether it is kept without power, and locked while torque is on."""
        return self.address < TORQUE_ENABLE.address

    def __str__(self) -> str:
        return f"{self.name} ({self.address})"


_ANY = (-(2**31), 2**31 - 1)

MODEL_REGISTER = Register("Model Number", 0, 2, writable=False, default=XW540.number)
FIRMWARE = Register("Firmware Version", 6, 1, writable=False, default=45)
ID = Register("ID", 7, 1, 0, 252, default=1)
BAUD_RATE = Register("Baud Rate", 8, 1, 0, 7, default=1)
RETURN_DELAY = Register("Return Delay Time", 9, 1, 0, 254, default=250)
DRIVE_MODE = Register("Drive Mode", 10, 1, 0, 13)
OPERATING_MODE = Register("Operating Mode", 11, 1, 0, 16, default=3)
HOMING_OFFSET = Register("Homing Offset", 20, 4, -1_044_479, 1_044_479)
TEMPERATURE_LIMIT = Register("Temperature Limit", 31, 1, 0, 100, default=XW540.temperature_limit)
MAX_VOLTAGE = Register("Max Voltage Limit", 32, 2, 95, 160, default=160)
MIN_VOLTAGE = Register("Min Voltage Limit", 34, 2, 95, 160, default=95)
VELOCITY_LIMIT = Register("Velocity Limit", 44, 4, 0, 1023, default=XW540.velocity_limit)
MAX_POSITION = Register("Max Position Limit", 48, 4, 0, 4095, default=4095)
MIN_POSITION = Register("Min Position Limit", 52, 4, 0, 4095)
SHUTDOWN = Register("Shutdown", 63, 1, 0, 63, default=52)
TORQUE_ENABLE = Register("Torque Enable", 64, 1, 0, 1)
STATUS_RETURN_LEVEL = Register("Status Return Level", 68, 1, 0, 2, default=2)
HARDWARE_ERROR = Register("Hardware Error Status", 70, 1, writable=False)
BUS_WATCHDOG = Register("Bus Watchdog", 98, 1, 0, 127)
GOAL_VELOCITY = Register("Goal Velocity", 104, 4, *_ANY)
PROFILE_ACCELERATION = Register("Profile Acceleration", 108, 4, 0, 32_767)
PROFILE_VELOCITY = Register("Profile Velocity", 112, 4, 0, 32_767)
GOAL_POSITION = Register("Goal Position", 116, 4, *_ANY)
PRESENT_VELOCITY = Register("Present Velocity", 128, 4, *_ANY, writable=False)
PRESENT_POSITION = Register("Present Position", 132, 4, *_ANY, writable=False)
PRESENT_VOLTAGE = Register("Present Input Voltage", 144, 2, writable=False, default=120)
PRESENT_TEMPERATURE = Register("Present Temperature", 146, 1, writable=False, default=30)

REGISTERS = tuple(entry for entry in list(globals().values()) if isinstance(entry, Register))


def hardware_errors(status: int) -> str:
    """The meaning of the bits of the hardware error status, in words."""
    known = [text for bit, text in HARDWARE_ERRORS.items() if status & bit]
    unknown = status & ~sum(HARDWARE_ERRORS)
    return ", ".join([*known, *([f"unknown bits 0x{unknown:02x}"] if unknown else [])]) or "none"
