"""The arguments of `deploy`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Deploy:
    """Send motor commands to the fish's motor, a Dynamixel XW540-T140-R, at 50 Hz.

    Reads a table with the header time_s,velocity_rad_s and 50 rows a second from 0 s on; writes a log. Checks table and
    motor first, ramps from and to rest, and asks nothing: the motor turns at once. Takes as long as the table. Ctrl-C,
    an error or the end of this program stop the motor (without the program its watchdog does, after 0.2 s). Exits with
    1 when not all commands were sent.
    """

    commands: tyro.conf.Positional[Path]
    """Table of commands."""
    port: str | None = None
    """Serial port of the U2D2, as /dev/ttyUSB0."""
    id: int = 1
    """The motor's id."""
    baud: int = 57600
    """The motor's baud rate; 57600 as it is sold."""
    dry_run: bool = False
    """Send to an emulated motor instead of a real one."""
    log: Path | None = None
    """CSV file to write: what was sent when, what was read back when."""
    repeat: int = 1
    """Times to send the table, one after the other."""
    ramp: float = 20.0
    """Acceleration of the ramps from and to rest [rad/s²]; they add rows only where the table doesn't rest."""
    max_speed: float | None = None
    """Refuse faster commands [rad/s]; by default 7.29, the motor's own limit as it is sold."""
    max_acceleration: float | None = None
    """Refuse steeper changes from one command to the next [rad/s²]; by default 100."""
    clip: bool = False
    """Cut commands off at the limits instead of refusing them."""
    json: bool = False
    """Print what was done as JSON."""
    quiet: bool = False
    """Print nothing but errors."""
