"""Soft actor-critic of Stable-Baselines3 with its time taken, and environments that are watched."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from swim2real.settings import BLOCK, TrainingSettings


class TimedSAC(SAC):
    """SAC that knows how long it learned."""

    learner_seconds = 0.0

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Makes gradient steps."""
        begun = time.perf_counter()
        super().train(gradient_steps, batch_size)
        self.learner_seconds += time.perf_counter() - begun


class Watched(VecEnvWrapper):
    """Environments whose steps are timed and whose ended episodes are told.

    Attributes:
        simulator_seconds: Spent in steps.
    """

    def __init__(self, venv: VecEnv, on_episode: Callable[[dict[str, Any]], None], reward_scale: float = 1.0) -> None:
        """Watches environments.

        Args:
            venv: What is stepped.
            on_episode: Told of every episode that ended: its return, length, and the last step's info.
            reward_scale: By which the learner sees rewards multiplied.
        """
        super().__init__(venv)
        self._told, self._scale = on_episode, reward_scale
        self.simulator_seconds = 0.0
        self.returns = np.zeros(venv.num_envs)
        self.lengths = np.zeros(venv.num_envs, dtype=int)

    def reset(self) -> Any:
        """Begins all episodes anew."""
        self.returns[:], self.lengths[:] = 0.0, 0
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions."""
        begun = time.perf_counter()
        self.venv.step_async(actions)
        self.simulator_seconds += time.perf_counter() - begun

    def step_wait(self) -> Any:
        """Makes the step."""
        begun = time.perf_counter()
        observations, rewards, dones, infos = self.venv.step_wait()
        self.simulator_seconds += time.perf_counter() - begun
        self.returns += rewards
        self.lengths += 1
        for i in np.flatnonzero(dones):
            self._told({"episode_return": float(self.returns[i]), "length": int(self.lengths[i]), **infos[i]})
            self.returns[i], self.lengths[i] = 0.0, 0
        return observations, self._scale * rewards, dones, infos


def make_learner(settings: TrainingSettings, environments: VecEnv) -> TimedSAC:
    """A learner that has seen nothing yet."""
    return TimedSAC(
        "MlpPolicy", environments, learning_rate=settings.learning_rate, buffer_size=settings.replay,
        learning_starts=settings.exploration_steps, batch_size=settings.batch, tau=settings.target_rate,
        gamma=settings.discount, train_freq=BLOCK // settings.environments, gradient_steps=settings.updates_a_block,
        policy_kwargs={"net_arch": list(settings.layers)}, seed=settings.seed, device="cpu",
    )  # fmt: skip


def load_learner(path: Path, environments: VecEnv) -> TimedSAC:
    """A learner from a checkpoint, that goes on in the episodes that were running."""
    return TimedSAC.load(path, environments, device="cpu", force_reset=False)


def log_to(learner: TimedSAC, folder: Path) -> None:
    """Logs to TensorBoard where it is installed, and to nothing else."""
    try:
        import tensorboard  # noqa: F401  # pyright: ignore[reportMissingImports, reportUnusedImport]
    except ImportError:
        learner.set_logger(configure(str(folder), []))
        return
    learner.set_logger(configure(str(folder), ["tensorboard"]))


def use_threads(count: int) -> None:
    """Threads of torch: the networks are small, and more than one gain little."""
    torch.set_num_threads(count)
