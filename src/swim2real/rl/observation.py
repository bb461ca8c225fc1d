"""What a policy can observe of a robot: parts by name, put together in the order that a robot file or a task gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rl.state import State, wrapped

Array = NDArray[np.float64]

MOST_PLACE, MOST_RATE = 100.0, 1000.0  # greatest distances [m] and speeds [m/s or rad/s] that can be believed
ANYTHING = 1e6  # of readings and commands, whose unit is the robot's own


@dataclass(frozen=True)
class Part:
    """A part of an observation.

    Attributes:
        read: Its numbers. State to shape (N, k).
        bound: Greatest magnitude that can be believed; beyond it the simulation has diverged.
    """

    read: Callable[[State], Array]
    bound: float


PARTS: Mapping[str, Part] = {
    "markers": Part(lambda s: s.markers.reshape(len(s.markers), -1), MOST_PLACE),
    "marker_velocities": Part(lambda s: s.marker_velocities.reshape(len(s.markers), -1), MOST_RATE),
    "position": Part(lambda s: s.position, MOST_PLACE),
    "heading": Part(lambda s: s.heading[:, None], MOST_PLACE),
    "heading_direction": Part(lambda s: np.column_stack([np.cos(s.heading), np.sin(s.heading)]), 1.0),
    "velocity": Part(lambda s: s.velocity, MOST_RATE),
    "heading_rate": Part(lambda s: s.heading_rate[:, None], MOST_RATE),
    "turning": Part(lambda s: s.turning, MOST_RATE),
    "motor_angles": Part(lambda s: wrapped(s.motor_angles), np.pi),
    "motor_directions": Part(lambda s: np.concatenate([np.cos(s.motor_angles), np.sin(s.motor_angles)], axis=1), 1.0),
    "motor_speeds": Part(lambda s: s.motor_speeds, MOST_RATE),
    "joint_angles": Part(lambda s: s.joint_angles, MOST_PLACE),
    "joint_rates": Part(lambda s: s.joint_rates, MOST_RATE),
    "sensors": Part(lambda s: s.sensors, ANYTHING),
    "commands": Part(lambda s: s.commands, ANYTHING),
    "previous_actions": Part(lambda s: s.previous_actions, 1.0),
}
"""Parts by name, in SI units; what they hold is said at `State`. `motor_angles` are between -π and π, and
`motor_directions` are their cosines, then their sines. Without motors that part has no numbers.
"""


def find_parts(names: Sequence[str], where: str) -> tuple[Part, ...]:
    """Parts by name.

    Raises:
        ArgumentError: There is no such part; the message names those that there are.
    """
    for name in names:
        if name not in PARTS:
            raise ArgumentError(f"{where} observes '{name}'; it must be one of {', '.join(PARTS)}")
    return tuple(PARTS[name] for name in names)


def observation_layout(parts: Mapping[str, tuple[int, float]]) -> tuple[dict[str, slice], Array]:
    """Where each part of an observation is, and the bounds of its numbers, from the length and bound of each part."""
    slices: dict[str, slice] = {}
    bounds: list[float] = []
    for name, (length, bound) in parts.items():
        slices[name] = slice(len(bounds), len(bounds) + length)
        bounds += [bound] * length
    return slices, np.array(bounds)
