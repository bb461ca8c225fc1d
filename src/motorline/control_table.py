"""The control table of Dynamixel X motors: models, addresses, units, error bits, and the errors that are raised.

Source: ROBOTIS e-Manual, the page of each model (emanual.robotis.com/docs/en/dxl/x/xw540-t140) and Protocol 2.0
(emanual.robotis.com/docs/en/dxl/protocol2). The registers used here have the same addresses and units in all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from swimbase.errors import ArgumentError, Swim2RealError

VELOCITY_UNIT = 0.229 * 2 * math.pi / 60  # rad/s; 0.229 rev/min
ACCELERATION_UNIT = 214.577 * 2 * math.pi / 3600  # rad/s²; 214.577 rev/min²
POSITION_UNIT = 2 * math.pi / 4096  # rad
VOLTAGE_UNIT = 0.1  # V
WATCHDOG_UNIT = 0.02  # s
BAUDS = (57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)  # those that 50 commands a second can use

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


@dataclass(frozen=True)
class Model:
    """A model of motor as it is sold.

    Attributes:
        name: Name in the manual.
        number: Model number (0), with which it answers a ping.
        velocity_limit: Velocity Limit (44) [0.229 rev/min].
    """

    name: str
    number: int
    velocity_limit: int

    @property
    def speed(self) -> float:
        """The Velocity Limit [rad/s]."""
        return self.velocity_limit * VELOCITY_UNIT


# e-Manual, docs/en/dxl/x/{xw540-t140, xl430-w250, xm430-w210, xm430-w350, xm540-w150, xm540-w270}: "Control Table of
# EEPROM Area"
XW540 = Model("XW540-T140-R", 1180, 304)
_OTHERS = (
    Model("XL430-W250", 1060, 265),
    Model("XM430-W210", 1030, 330),
    Model("XM430-W350", 1020, 200),
    Model("XM540-W150", 1130, 230),
    Model("XM540-W270", 1120, 128),
)
MODELS = {model.name: model for model in (XW540, *_OTHERS)}


class MotorError(Swim2RealError):
    """The motor can't be reached, refuses a command or reports an error."""


class NoAnswerError(MotorError):
    """No answer came, or none that can be read. The next exchange may succeed."""


class HardwareAlertError(MotorError):
    """The motor reports a hardware error with its answer."""


@dataclass(frozen=True)
class Register:
    """One entry of the control table.

    Attributes:
        name: Name in the manual.
        address: First byte.
        size: Number of bytes.
        signed: Whether its values may be below 0.
        unit: What one stands for in a goal [rad/s or rad].
    """

    name: str
    address: int
    size: int
    signed: bool = False
    unit: float = 1.0

    def __str__(self) -> str:
        return f"{self.name} ({self.address})"


MODEL_REGISTER = Register("Model Number", 0, 2)
FIRMWARE = Register("Firmware Version", 6, 1)
DRIVE_MODE = Register("Drive Mode", 10, 1)
OPERATING_MODE = Register("Operating Mode", 11, 1)
HOMING_OFFSET = Register("Homing Offset", 20, 4, signed=True)
TEMPERATURE_LIMIT = Register("Temperature Limit", 31, 1)
VELOCITY_LIMIT = Register("Velocity Limit", 44, 4)
MAX_POSITION = Register("Max Position Limit", 48, 4)
MIN_POSITION = Register("Min Position Limit", 52, 4)
SHUTDOWN = Register("Shutdown", 63, 1)
TORQUE_ENABLE = Register("Torque Enable", 64, 1)
STATUS_RETURN_LEVEL = Register("Status Return Level", 68, 1)
HARDWARE_ERROR = Register("Hardware Error Status", 70, 1)
BUS_WATCHDOG = Register("Bus Watchdog", 98, 1)
GOAL_VELOCITY = Register("Goal Velocity", 104, 4, signed=True, unit=VELOCITY_UNIT)
PROFILE_ACCELERATION = Register("Profile Acceleration", 108, 4)
PROFILE_VELOCITY = Register("Profile Velocity", 112, 4)
GOAL_POSITION = Register("Goal Position", 116, 4, signed=True, unit=POSITION_UNIT)
PRESENT_VELOCITY = Register("Present Velocity", 128, 4, signed=True)
PRESENT_POSITION = Register("Present Position", 132, 4, signed=True)
PRESENT_VOLTAGE = Register("Present Input Voltage", 144, 2)
PRESENT_TEMPERATURE = Register("Present Temperature", 146, 1)

REGISTERS = tuple(entry for entry in list(globals().values()) if isinstance(entry, Register))


def check_baud(baud: int) -> None:
    """Refuses a baud rate that can't be used.

    Raises:
        ArgumentError: It is too low, or a motor doesn't have it.
    """
    if baud not in BAUDS:
        usable = ", ".join(map(str, BAUDS))
        raise ArgumentError(f"{baud} baud can't be used for 50 commands a second; one of {usable} can")


def hardware_errors(status: int) -> str:
    """The meaning of the bits of the hardware error status, in words."""
    known = [text for bit, text in HARDWARE_ERRORS.items() if status & bit]
    unknown = status & ~sum(HARDWARE_ERRORS)
    return ", ".join([*known, *([f"unknown bits 0x{unknown:02x}"] if unknown else [])]) or "none"
