"""The conditions of a swim beside the calibrated robot: the motor's limits, disturbances, and a tracker's view."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swim2real.errors import ArgumentError

CONTROL_INTERVAL = 0.02  # s, 50 Hz, as commands are sent to the robot


@dataclass(frozen=True)
class Motor:
    """The motor between a policy and the tail: an action is an acceleration, which becomes a command of speed.

    A command is a speed that holds for one control interval, as the rows of a command table do. The next command is
    computed from the last command, not from the measured speed, so that a recorded table repeats what a policy did.

    Attributes:
        speed: Greatest speed, either way [rad/s].
        acceleration: Acceleration that an action of 1 stands for [rad/s²].
    """

    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        for name, value in (("speed", self.speed), ("acceleration", self.acceleration)):
            if not (math.isfinite(value) and value > 0):
                raise ArgumentError(f"the motor's {name} is {value:g}; it must be finite and above 0")

    def next_command(self, command: float, action: float) -> float:
        """The command that follows another one [rad/s], for an action from -1 to 1."""
        wanted = command + action * self.acceleration * CONTROL_INTERVAL
        return min(max(wanted, -self.speed), self.speed)


REAL_MOTOR = Motor(304 * 0.229 * 2 * math.pi / 60, 100.0)
"""The Dynamixel XW540-T140-R as it is sold, with the limits that commands are checked against before they are sent.

Speed: its Velocity Limit, 304 of 0.229 rev/min, 7.29 rad/s or 1.16 beats a second (e-Manual, XW540-T140). Acceleration:
a choice, 2 rad/s from one command to the next; the manual gives none.
"""

PUBLISHED_MOTOR = Motor(10 * math.pi, 400.0)
"""What the published simulator allows: its control range, and the action scale of the prior work's training.

Its speeds reach 5 beats a second, which the real motor can't follow.
"""


@dataclass(frozen=True)
class StateEstimate:
    """How a camera above the pool sees the robot. The motor reports its own angle and speed, without noise or delay.

    Attributes:
        noise: Standard deviation of a marker's position, along x and y each [m]. Our tracker is off by 0.2 to 0.5 mm in
            synthetic films at 1080p.
        delay: Age of what a policy sees, in control intervals of 20 ms.
    """

    noise: float = 0.0005
    delay: int = 2

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise) and self.noise >= 0):
            raise ArgumentError(f"the noise of the markers is {self.noise:g} m; it must be finite and 0 or above")
        if self.delay < 0:
            raise ArgumentError(f"the delay is {self.delay} control intervals; it must be 0 or above")


@dataclass(frozen=True)
class Disturbances:
    """What a real swim has and the calibrated simulator hasn't; nothing by default.

    The real robot swims an arc to the left, by friction of its tendons in their routing holes, as the paper suspects.
    A tendon that rubs pulls the tail with less than its tension, so the left one loses a share of its stiffness. With
    the published parameters at full speed a share of 0.5 turns the robot 15 degrees to the left in 12 s, and 0.8 27.

    Attributes:
        start_phase: Range that the motor's angle at the start is drawn from [rad].
        current: Velocity of the water along world x and y [m/s]. The robot starts at rest in the world.
        tendon_friction: Share of the left tendon's tension that friction in its routing holes takes, from 0 below 1.
        estimate: Tracker's view that observations are made from; None for the true state.
    """

    start_phase: tuple[float, float] = (0.0, 0.0)
    current: tuple[float, float] = (0.0, 0.0)
    tendon_friction: float = 0.0
    estimate: StateEstimate | None = None

    def __post_init__(self) -> None:
        low, high = self.start_phase
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise ArgumentError(f"the start phase is {low:g} to {high:g} rad; both must be finite and not fall")
        if not all(math.isfinite(v) and abs(v) <= 1 for v in self.current):
            raise ArgumentError(f"the current is {self.current} m/s; each part must be within -1 and 1")
        if not 0 <= self.tendon_friction < 1:
            raise ArgumentError(f"the tendon friction is {self.tendon_friction:g}; it is a share, from 0 below 1")


UNDISTURBED = Disturbances()
