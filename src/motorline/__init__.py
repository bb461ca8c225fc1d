"""Commands and motors: a table of speeds and angles at 50 Hz, sent to Dynamixel motors on time.

Everything here imports the standard library only, and `bus` the motor maker's library: this room runs on the computer
in the robot, without NumPy and MuJoCo.
"""

from motorline.commands import FISH, RATE, XW540_T140, CommandTable, MotorLimits, read_table, write_table
from motorline.control_table import MotorError
from motorline.motors_file import MotorSettings, fish_motor, read_motors

__all__ = [
    "FISH", "RATE", "XW540_T140", "CommandTable", "MotorError", "MotorLimits", "MotorSettings", "fish_motor",
    "read_motors", "read_table", "write_table",
]  # fmt: skip
