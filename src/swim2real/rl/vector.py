"""Environments as Stable-Baselines3 wants them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import MissingExtraError
from swim2real.parameters import Values
from swim2real.rl.environment import EnvironmentOptions, Environments, Observation, make_environments, make_spaces

try:
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs
except ModuleNotFoundError as error:
    raise MissingExtraError(f"training needs {error.name}; install it with: pip install 'swim2real[rl]'") from error


class RobotVecEnv(VecEnv):
    """Environments that step in one call.

    One that has ended begins anew within the step, as Stable-Baselines3 expects: its info has
    `terminal_observation` and `TimeLimit.truncated`.

    Attributes:
        environments: The environments.
    """

    def __init__(self, environments: Environments) -> None:
        """Takes over the environments."""
        self.environments = environments
        super().__init__(environments.count, *make_spaces(environments))
        self._actions: NDArray[Any] = np.zeros((environments.count, 1))

    def reset(self) -> VecEnvObs:
        if seeds := [seed for seed in self._seeds if seed is not None]:  # all or none are given
            self.environments.seed(seeds)
        self.environments.begin(np.arange(self.num_envs), self._options)
        self._reset_seeds()
        self._reset_options()
        return self.environments.observations.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Observation, Observation, NDArray[np.bool_], list[dict[str, Any]]]:
        environments = self.environments
        stepped = environments.step(self._actions)
        ended = np.flatnonzero(stepped.ended)
        infos = [environments.info(i) for i in range(self.num_envs)]
        for i in ended:
            infos[i]["terminal_observation"] = environments.observations[i].copy()
            infos[i]["success"] = bool(stepped.success[i])
            infos[i]["TimeLimit.truncated"] = bool(stepped.truncated[i])
        if len(ended):
            environments.begin(ended)
        return environments.observations.copy(), stepped.rewards.astype(np.float32), stepped.ended, infos

    def close(self) -> None:
        self.environments.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        value = None if attr_name == "render_mode" else getattr(self.environments, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        del indices
        setattr(self.environments, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        result = getattr(self.environments, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        del wrapper_class
        return [False for _ in self._get_indices(indices)]


def make_vector_env(
    task: str, parameters: Values | Sequence[Values] | None = None, count: int = 1,
    **options: Unpack[EnvironmentOptions],
) -> RobotVecEnv:  # fmt: skip
    """Environments that step in one call; the arguments are those of `make_environments`."""
    return RobotVecEnv(make_environments(task, parameters, count, **options))
