"""The conditions of an episode beside the calibrated robot: disturbances, and a tracker's view."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swimbase.errors import ArgumentError

CONTROL_INTERVAL = 0.02  # s, 50 Hz, as commands are sent to the robot


@dataclass(frozen=True)
class StateEstimate:
    """Camera's estimate of the robot's state. Motors report their own angles and speeds, without noise or delay.

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
    """Disturbances that a real swim has and the calibrated simulator hasn't; nothing by default.

    The real robot swims an arc to the left, by friction of its tendons in their routing holes, as the paper suspects.
    A tendon that rubs pulls the tail with less than its tension, so the left one loses a share of its stiffness. With
    the published parameters at full speed a share of 0.5 turns the robot 15 degrees to the left in 12 s, and 0.8 27.

    Attributes:
        start_phase: Range that the angle of the motor at the start is drawn from, of a robot with a motor_joint [rad].
        current: Velocity of the water along world x and y [m/s]. The robot starts at rest in the world.
        tendon_friction: Share of the rubbing tendon's tension that friction takes, from 0 below 1.
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
