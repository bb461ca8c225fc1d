"""Episodes of several environments side by side, steered by a driver, with everything that happened in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.rl.environment import SwimEnv
from swim2real.rl.motor import CONTROL_INTERVAL
from swim2real.rl.policy import Driver

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        seed: Of its start.
        rate: Steps a second [Hz].
        actions: Shape (T,).
        commands: Motor speeds asked for in each step [rad/s]. Shape (T,).
        rewards: Shape (T,).
        heads: Positions of the head, the start first [m]. Shape (T + 1, 2).
        markers: Positions of the markers after each step [m]. Shape (T, K, 2).
        goal: [m]; None in a task without one. Shape (2,).
        distance: Swum forward [m].
        success: Whether the goal was reached.
        ended: Why it ended early, in words; empty when it went to its end or reached the goal.
    """

    seed: int
    rate: float
    actions: Array
    commands: Array
    rewards: Array
    heads: Array
    markers: Array
    goal: Array | None
    distance: float
    success: bool
    ended: str

    @property
    def episode_return(self) -> float:
        """Sum of the rewards."""
        return float(self.rewards.sum())

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.actions) / self.rate

    @property
    def goal_distance(self) -> float | None:
        """From the head to the goal at the end [m]."""
        return None if self.goal is None else float(np.linalg.norm(self.heads[-1] - self.goal))


def some_environments(task: str, parameters: Sequence[Any], count: int, **more: Any) -> list[SwimEnv]:
    """Environments that share compiled robots. Arguments as for `make_vector_env`."""
    from swim2real.rl.vector import make_vector_env

    return make_vector_env(task, parameters, count, **more).envs  # pyright: ignore[reportArgumentType]


def roll(
    environments: Sequence[SwimEnv], driver: Driver, seeds: Sequence[int],
    options: Sequence[dict[str, Any]] | None = None,
) -> list[Episode]:  # fmt: skip
    """One episode in each environment, side by side.

    Args:
        environments: N of them.
        driver: Steers all.
        seeds: Of their starts.
        options: Of their starts.

    Returns:
        N episodes.
    """
    logs = [_Log(env, seed) for env, seed in zip(environments, seeds, strict=True)]
    observations = np.stack([
        log.begin(None if options is None else options[i]) for i, log in enumerate(logs)
    ])  # fmt: skip
    step = 0
    while not all(log.over for log in logs):
        commands = np.array([log.env.command for log in logs])
        actions = driver.actions(observations, commands, step)
        for i, log in enumerate(logs):
            if not log.over:
                observations[i] = log.step(actions[i])
        step += 1
    return [log.episode() for log in logs]


class _Log:
    """What happens in one environment."""

    def __init__(self, env: SwimEnv, seed: int) -> None:
        self.env, self.seed, self.over = env, seed, False
        self._rows: list[tuple[float, float, float]] = []
        self._markers: list[Array] = []
        self._info: dict[str, Any] = {}

    def begin(self, options: dict[str, Any] | None) -> NDArray[np.float32]:
        observation, self._info = self.env.reset(seed=self.seed, options=options)
        self._heads = [np.array(self._info["position"])]
        return observation

    def step(self, action: Array) -> NDArray[np.float32]:
        observation, reward, ended, cut, self._info = self.env.step(np.asarray(action))
        self._rows.append((float(np.clip(action[0], -1, 1)), self._info["command"], float(reward)))
        self._heads.append(np.array(self._info["position"]))
        self._markers.append(self.env.swimmer.read(markers=True).markers.copy())
        self.over = ended or cut
        return observation

    def episode(self) -> Episode:
        rows, goal = np.array(self._rows), self._info.get("goal")
        return Episode(
            self.seed, 1 / CONTROL_INTERVAL, rows[:, 0], rows[:, 1], rows[:, 2], np.array(self._heads),
            np.array(self._markers), None if goal is None else np.array(goal), float(self._info["distance"]),
            bool(self._info["success"]), str(self._info.get("diverged", "")),
        )  # fmt: skip
