"""Many environments that step in one call, as Stable-Baselines3 wants them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs

from swim2real.errors import ArgumentError
from swim2real.parameters import Values
from swim2real.rl.environment import EnvironmentOptions, Observation, SwimEnv, TaskName, make_environments


class SwimVecEnv(VecEnv):
    """Environments shared out among threads; the physics of each runs without Python's lock.

    What an environment does depends on its own seed and actions alone, not on the others or on the threads. One that
    has ended begins anew within the step, as Stable-Baselines3 expects: its info has `terminal_observation` and
    `TimeLimit.truncated`.

    Attributes:
        envs: The environments.
        step_seconds: Time that all steps took so far [s].
    """

    def __init__(self, envs: Sequence[SwimEnv], threads: int = 1) -> None:
        """Takes over the environments.

        Args:
            envs: At least one environment.
            threads: Number of threads; with 1 all is done in the caller's.

        Raises:
            ArgumentError: There is no environment or no thread.
        """
        if not envs:
            raise ArgumentError("a vector of 0 environments is asked for; it needs at least 1")
        if threads < 1:
            raise ArgumentError(f"threads is {threads}; it must be at least 1")
        self.envs = list(envs)
        count = len(self.envs)
        super().__init__(count, self.envs[0].observation_space, self.envs[0].action_space)
        shares = min(threads, count)
        self._shares = [range(count * i // shares, count * (i + 1) // shares) for i in range(shares)]
        self._pool = ThreadPoolExecutor(shares) if shares > 1 else None
        self._observations = np.zeros((count, *(self.envs[0].observation_space.shape or ())), np.float32)
        self._rewards = np.zeros(count, np.float32)
        self._ended = np.zeros(count, np.bool_)
        self._infos: list[dict[str, Any]] = [{} for _ in range(count)]
        self._actions: NDArray[Any] = np.zeros((count, 1), np.float32)
        self.step_seconds = 0.0

    def reset(self) -> VecEnvObs:
        self._all(self._begin)
        self._reset_seeds()
        self._reset_options()
        return self._observations.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Observation, Observation, NDArray[np.bool_], list[dict[str, Any]]]:
        begun = time.perf_counter()
        self._all(self._step)
        self.step_seconds += time.perf_counter() - begun
        return self._observations.copy(), self._rewards.copy(), self._ended.copy(), list(self._infos)

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        return [getattr(self.envs[i], attr_name) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        for i in self._get_indices(indices):
            setattr(self.envs[i], attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        return [getattr(self.envs[i], method_name)(*method_args, **method_kwargs) for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]

    def _all(self, action: Callable[[int], None]) -> None:
        """Does something with the index of each environment."""
        if self._pool is None:
            for i in range(self.num_envs):
                action(i)
            return

        def share(indices: range) -> None:
            for i in indices:
                action(i)

        list(self._pool.map(share, self._shares))

    def _begin(self, i: int) -> None:
        self._observations[i], self.reset_infos[i] = self.envs[i].reset(seed=self._seeds[i], options=self._options[i])

    def _step(self, i: int) -> None:
        env = self.envs[i]
        observation, reward, terminated, truncated, info = env.step(self._actions[i])
        self._rewards[i] = float(reward)
        self._ended[i] = ended = terminated or truncated
        self._infos[i] = info
        info["TimeLimit.truncated"] = truncated and not terminated
        if ended:
            info["terminal_observation"] = observation
            observation, self.reset_infos[i] = env.reset()
        self._observations[i] = observation


def make_vector_env(
    task: TaskName, parameters: Values | Sequence[Values] | None = None, count: int = 1, *, threads: int = 1,
    **options: Unpack[EnvironmentOptions],
) -> SwimVecEnv:  # fmt: skip
    """Environments that step in one call.

    Args:
        task: `forward` or `target`.
        parameters: Parameters of the robot, as for `make_environments`.
        count: Number of environments.
        threads: Number of threads that step them; more than 1 where cores are free.
        options: See `EnvironmentOptions`.

    Raises:
        ArgumentError: There is no such task, stage or length, or nothing to step.
        ParameterError: A value isn't allowed.
    """
    return SwimVecEnv(make_environments(task, parameters, count, **options), threads)
