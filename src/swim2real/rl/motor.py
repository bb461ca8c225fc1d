"""The motor between a policy and the tail: an action is an acceleration, which becomes a command of speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swim2real.errors import ArgumentError

CONTROL_INTERVAL = 0.02  # s, 50 Hz, as commands are sent to the robot


@dataclass(frozen=True)
class Motor:
    """What a motor is asked for at most.

    A command is a speed that holds for one control interval, as the rows of a command table do. The next one is
    reckoned from the last command, not from the measured speed, so that a recorded table repeats what a policy did.

    Attributes:
        speed: Greatest speed, either way [rad/s].
        acceleration: What an action of 1 stands for [rad/s²].
    """

    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        for name, value in (("speed", self.speed), ("acceleration", self.acceleration)):
            if not (math.isfinite(value) and value > 0):
                raise ArgumentError(f"the motor's {name} is {value:g}; it must be finite and above 0")

    def next_command(self, command: float, action: float) -> float:
        """The command that follows one [rad/s], for an action from -1 to 1."""
        wanted = command + action * self.acceleration * CONTROL_INTERVAL
        return min(max(wanted, -self.speed), self.speed)


REAL_MOTOR = Motor(304 * 0.229 * 2 * math.pi / 60, 100.0)
"""The Dynamixel XW540-T140-R as it is sold, which is what a policy's commands are checked against before they are sent.

Speed: its Velocity Limit, 304 of 0.229 rev/min, 7.29 rad/s or 1.16 beats a second (e-Manual, XW540-T140). Acceleration:
a choice, 2 rad/s from one command to the next; the manual gives none.
"""

PUBLISHED_MOTOR = Motor(10 * math.pi, 400.0)
"""What the published simulator allows: its control range, and the action scale of the prior work's training.

Up to 5 beats a second, which the real motor can't follow.
"""
