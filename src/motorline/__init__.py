"""motorline: tables of speeds and angles at 50 Hz, sent to Dynamixel motors on time.

It imports the standard library only, and the motor maker's library where `Bus` is used: it runs on the computer in the
robot, without NumPy and MuJoCo.
"""

from typing import TYPE_CHECKING, Any

from motorline.commands import FISH, RATE, XW540_T140, CommandTable, MotorLimits, read_table, write_table
from motorline.control_table import MotorError
from motorline.motors import Motors
from motorline.motors_file import MotorSettings, fish_motor, read_motors
from motorline.sending import SendingResult, send

if TYPE_CHECKING:
    from motorline.bus import Bus

__all__ = [
    "FISH", "RATE", "XW540_T140", "Bus", "CommandTable", "MotorError", "MotorLimits", "MotorSettings", "Motors",
    "SendingResult", "fish_motor", "read_motors", "read_table", "send", "write_table",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name == "Bus":
        from motorline.bus import Bus

        return Bus
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
