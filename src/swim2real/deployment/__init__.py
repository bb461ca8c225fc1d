"""Motor commands and the motor: a table of speeds at 50 Hz, sent to a Dynamixel on time.

Everything here imports the standard library only, and `bus` the motor maker's library: this room runs on the computer
in the fish, without NumPy and MuJoCo.
"""

from swim2real.deployment.commands import (
    RATE,
    XW540_T140,
    CommandTable,
    Limits,
    read_table,
    write_table,
)
from swim2real.deployment.control_table import MotorError

__all__ = ["RATE", "XW540_T140", "CommandTable", "Limits", "MotorError", "read_table", "write_table"]
