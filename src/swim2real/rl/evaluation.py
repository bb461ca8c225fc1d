"""How well a driver swims: figures of episodes, and the best constant frequency to compare them with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.parameters import Values
from swim2real.rl.disturbances import UNDISTURBED, Disturbances
from swim2real.rl.motor import CONTROL_INTERVAL, REAL_MOTOR, Motor
from swim2real.rl.policy import ConstantSpeed
from swim2real.rl.rollout import Episode, roll, some_environments
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]

SCANNED = 20  # constant speeds, of each sign


@dataclass(frozen=True)
class Scan:
    """Constant motor speeds and what each reaches, from the same starts as a policy.

    Attributes:
        speeds: [rad/s]. Shape (S,).
        distances: Mean over the starts [m]. Shape (S,).
        returns: Mean episode returns. Shape (S,).
    """

    speeds: Array
    distances: Array
    returns: Array

    @property
    def farthest(self) -> int:
        """Index of the speed that swims farthest."""
        return int(np.argmax(self.distances))

    @property
    def highest(self) -> int:
        """Index of the speed with the highest return."""
        return int(np.argmax(self.returns))

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON."""
        return {
            "speeds": self.speeds.tolist(), "distances": self.distances.tolist(), "returns": self.returns.tolist(),
            "best_distance": float(self.distances[self.farthest]),
            "best_distance_frequency": float(self.speeds[self.farthest] / (2 * np.pi)),
            "best_return": float(self.returns[self.highest]),
            "best_return_frequency": float(self.speeds[self.highest] / (2 * np.pi)),
        }  # fmt: skip


def figures(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Means and spreads over episodes: return, distance [m], success share, seconds to the goal, distance left [m]."""
    returns = np.array([one.episode_return for one in episodes])
    distances = np.array([one.distance for one in episodes])
    times = [one.duration for one in episodes if one.success]
    left = [one.goal_distance for one in episodes if one.goal_distance is not None]
    return {
        "episodes": len(episodes),
        "episode_return": float(returns.mean()), "episode_return_std": float(returns.std()),
        "distance": float(distances.mean()), "distance_std": float(distances.std()),
        "success": float(np.mean([one.success for one in episodes])),
        "time_to_target": float(np.mean(times)) if times else None,
        "median_time_to_target": float(np.median(times)) if times else None,
        "goal_distance": float(np.mean(left)) if left else None,
        "action_size": float(np.mean([np.abs(one.actions).mean() for one in episodes])),
        "diverged": sum(bool(one.ended) for one in episodes),
    }  # fmt: skip


def scan_constant_speeds(
    parameters: Values, robot: Robot, phases: Sequence[float], seconds: float, *,
    disturbances: Disturbances = UNDISTURBED, motor: Motor = REAL_MOTOR, count: int = SCANNED,
) -> Scan:  # fmt: skip
    """Swims forward at constant motor speeds, both ways round, up to the motor's limit.

    Args:
        parameters: Of the simulator.
        robot: Whose they are.
        phases: Motor angles at the start [rad]; each speed swims from each.
        seconds: Of each swim [s].
        disturbances: Of the simulator.
        motor: Whose limits and acceleration hold here as for a policy.
        count: Speeds of each sign.
    """
    one_way = motor.speed * np.arange(1, count + 1) / count
    speeds = np.concatenate([-one_way[::-1], one_way])
    environments = some_environments(
        "forward", [parameters], len(speeds), robot=robot, seconds=seconds, motor=motor, disturbances=disturbances
    )
    driver = ConstantSpeed(speeds, motor.acceleration * CONTROL_INTERVAL)
    distances, returns = np.zeros(len(speeds)), np.zeros(len(speeds))
    for phase in phases:
        episodes = roll(environments, driver, range(len(speeds)), [{"phase": phase}] * len(speeds))
        distances += [one.distance for one in episodes]
        returns += [one.episode_return for one in episodes]
    return Scan(speeds, distances / len(phases), returns / len(phases))
