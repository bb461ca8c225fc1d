"""What can steer the fish: a learned policy, a constant speed of the motor, recorded actions."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import SAC

from swim2real.errors import RunError
from swim2real.rl.training_run import BEST, LAST, TrainingRun

Array = NDArray[np.float64]
Which = Literal["best", "last"]


class Policy(Protocol):
    """Gives an action to each of N environments, step after step."""

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """Actions within -1 and 1.

        Args:
            observations: Observations of the environments. Shape (N, n).
            commands: Present commands of the motors' speeds [rad/s]. Shape (N,).
            step: Number of steps since the episodes began.

        Returns:
            Shape (N, 1).
        """
        ...


class LearnedPolicy:
    """A policy of Stable-Baselines3. It is deterministic: it takes the mean of its actions."""

    def __init__(self, model: SAC) -> None:
        """Takes a model of Stable-Baselines3, which may still be learning."""
        self._model = model

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Policy`."""
        return self._model.predict(observations, deterministic=True)[0]


class ConstantSpeed:
    """Accelerates the motor as fast as is allowed to a speed and keeps it."""

    def __init__(self, speeds: Sequence[float] | Array, change: float) -> None:
        """Chooses speeds.

        Args:
            speeds: Speed in each environment [rad/s]. Shape (N,).
            change: Change of the speed by an action of 1 [rad/s].
        """
        self._speeds, self._change = np.asarray(speeds, dtype=float), change

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Policy`."""
        return np.clip((self._speeds - commands) / self._change, -1.0, 1.0)[:, None]


class RecordedActions:
    """Actions that were recorded, whatever the fish does: the open loop that the paper transfers."""

    def __init__(self, actions: Sequence[Array]) -> None:
        """Takes the actions of each environment; after its last one the motor keeps its speed. Shapes (T_i,)."""
        self._actions = np.zeros((max(len(series) for series in actions), len(actions)))
        for i, series in enumerate(actions):
            self._actions[: len(series), i] = series

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Policy`."""
        if step >= len(self._actions):
            return np.zeros((len(observations), 1))
        return self._actions[step][:, None]


def load_policy(run: TrainingRun, which: Which = "best") -> LearnedPolicy:
    """Loads a policy from a training run.

    A policy is a file of Stable-Baselines3, in part a pickle: load only what you trust.

    Args:
        run: The training run.
        which: `best` in the evaluations while it learned, or `last`.

    Raises:
        RunError: The policy isn't there or is damaged.
    """
    path = run.folder / (BEST if which == "best" else LAST)
    if not path.is_file():
        raise RunError(f"'{run.folder}' has no {path.name} yet; wait for its first checkpoint")
    try:
        return LearnedPolicy(SAC.load(path, device="cpu"))
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise RunError(f"policy '{path}' is damaged: {error}") from error
