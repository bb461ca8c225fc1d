"""Episodes of several environments side by side, steered by a policy: all that happened in them, and their figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.rl.conditions import CONTROL_INTERVAL
from swim2real.rl.environment import SwimEnv
from swim2real.rl.policies import Policy
from swim2real.store import write_arrays

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        seed: Seed of its start.
        rate: Steps a second [Hz].
        actions: Actions. Shape (T,).
        commands: Commanded speed of the motor in each step [rad/s]. Shape (T,).
        rewards: Rewards. Shape (T,).
        heads: Positions of the head, the start first [m]. Shape (T + 1, 2).
        markers: Positions of the markers after each step [m]. Shape (T, K, 2).
        goal: Goal [m]; None in a task without one. Shape (2,).
        distance: Distance swum forward [m].
        success: Whether the goal was reached.
        failure: Why the simulation diverged, in words; empty where it didn't.
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
    failure: str

    @property
    def episode_return(self) -> float:
        """Sum of the rewards."""
        return float(self.rewards.sum())

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self.actions) / self.rate

    @property
    def goal_distance(self) -> float | None:
        """Distance from the head to the goal at the end [m]; None in a task without a goal."""
        return None if self.goal is None else float(np.linalg.norm(self.heads[-1] - self.goal))


@dataclass(frozen=True)
class EpisodeStatistics:
    """Figures of several episodes.

    Attributes:
        episodes: Number of episodes.
        episode_return: Mean return.
        episode_return_std: Its standard deviation.
        distance: Mean distance swum forward [m].
        distance_std: Its standard deviation [m].
        success: Share of episodes that reached their goal.
        time_to_target: Mean duration of those [s]; None where none did.
        median_time_to_target: Median duration of those [s]; None where none did.
        goal_distance: Mean distance left at the end [m]; None in a task without a goal.
        action_size: Mean magnitude of the actions.
        diverged: Number of episodes whose simulation diverged.
    """

    episodes: int
    episode_return: float
    episode_return_std: float
    distance: float
    distance_std: float
    success: float
    time_to_target: float | None
    median_time_to_target: float | None
    goal_distance: float | None
    action_size: float
    diverged: int

    @staticmethod
    def of(episodes: Sequence[Episode]) -> EpisodeStatistics:
        """Figures of these episodes."""
        returns = np.array([episode.episode_return for episode in episodes])
        distances = np.array([episode.distance for episode in episodes])
        times = [episode.duration for episode in episodes if episode.success]
        left = [episode.goal_distance for episode in episodes if episode.goal_distance is not None]
        return EpisodeStatistics(
            episodes=len(episodes),
            episode_return=float(returns.mean()),
            episode_return_std=float(returns.std()),
            distance=float(distances.mean()),
            distance_std=float(distances.std()),
            success=float(np.mean([episode.success for episode in episodes])),
            time_to_target=float(np.mean(times)) if times else None,
            median_time_to_target=float(np.median(times)) if times else None,
            goal_distance=float(np.mean(left)) if left else None,
            action_size=float(np.mean([np.abs(episode.actions).mean() for episode in episodes])),
            diverged=sum(bool(episode.failure) for episode in episodes),
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON."""
        return asdict(self)


def run_episodes(
    environments: Sequence[SwimEnv], policy: Policy, seeds: Sequence[int],
    options: Sequence[dict[str, Any]] | None = None,
) -> list[Episode]:  # fmt: skip
    """Swims one episode in each environment, side by side.

    Args:
        environments: N environments.
        policy: Policy that steers all.
        seeds: Seeds of their starts.
        options: Options of their starts, as `SwimEnv.reset` takes them.

    Returns:
        N episodes.
    """
    recorders = [_Recorder(env, seed) for env, seed in zip(environments, seeds, strict=True)]
    observations = np.stack([
        recorder.begin(None if options is None else options[i]) for i, recorder in enumerate(recorders)
    ])  # fmt: skip
    step = 0
    while not all(recorder.over for recorder in recorders):
        commands = np.array([recorder.env.command for recorder in recorders])
        actions = policy.actions(observations, commands, step)
        for i, recorder in enumerate(recorders):
            if not recorder.over:
                observations[i] = recorder.step(actions[i])
        step += 1
    return [recorder.episode() for recorder in recorders]


def save_episodes(path: str | Path, episodes: Sequence[Episode]) -> None:
    """Writes episodes as arrays, each filled up with NaN to the longest: times, actions, commands, heads, markers."""
    lengths = np.array([len(episode.actions) for episode in episodes])
    longest = lengths.max()

    def stacked(name: str, extra: int = 0) -> Array:
        shape = getattr(episodes[0], name).shape[1:]
        out = np.full((len(episodes), longest + extra, *shape), np.nan)
        for i, episode in enumerate(episodes):
            out[i, : lengths[i] + extra] = getattr(episode, name)
        return out

    no_goal = np.full(2, np.nan)
    write_arrays(path, {
        "times": np.arange(longest + 1) / episodes[0].rate, "lengths": lengths,
        "seeds": np.array([episode.seed for episode in episodes]), "actions": stacked("actions"),
        "commands": stacked("commands"), "rewards": stacked("rewards"), "heads": stacked("heads", 1),
        "markers": stacked("markers"),
        "goals": np.array([no_goal if episode.goal is None else episode.goal for episode in episodes]),
        "distances": np.array([episode.distance for episode in episodes]),
        "successes": np.array([episode.success for episode in episodes]),
    })  # fmt: skip


class _Recorder:
    """Steps one environment and records what happens in it."""

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
