"""What can steer the fish: a trained policy, a constant frequency, recorded actions."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import RunError
from swim2real.rl.extras import require_learning
from swim2real.rl.run_files import BEST, POLICY, SETTINGS, read_json

Array = NDArray[np.float64]
Which = Literal["best", "last"]


class Driver(Protocol):
    """Gives an action to each of N environments, step after step."""

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """Actions within -1 and 1.

        Args:
            observations: Shape (N, n).
            commands: Motor speeds that are asked for now [rad/s]. Shape (N,).
            step: Since the episodes began.

        Returns:
            Shape (N, 1).
        """
        ...


class Trained:
    """A policy from a training run; deterministic, it takes the mean of its actions."""

    def __init__(self, run: str | Path, which: Which = "best") -> None:
        """Loads a policy.

        A policy is a file of Stable-Baselines3, in part a pickle: load only what you trust.

        Args:
            run: Folder of a training run.
            which: `best` in the evaluations while it learned, or `last`.

        Raises:
            RunError: There is none, or it is damaged.
            MissingExtraError: torch or Stable-Baselines3 isn't installed.
        """
        require_learning()
        from stable_baselines3 import SAC

        self.folder = Path(run)
        self.task: str = read_json(self.folder / SETTINGS)["task"]
        path = self.folder / (BEST if which == "best" else POLICY)
        if not path.is_file():
            raise RunError(f"'{self.folder}' has no {path.name} yet; wait for its first checkpoint")
        try:
            self._model = SAC.load(path, device="cpu")
        except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise RunError(f"policy '{path}' is damaged: {error}") from error

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Driver`."""
        return self._model.predict(observations, deterministic=True)[0]


class ConstantSpeed:
    """Accelerates the motor as fast as is allowed to a speed and keeps it."""

    def __init__(self, speeds: Sequence[float] | Array, change: float) -> None:
        """Chooses speeds.

        Args:
            speeds: Of each environment [rad/s]. Shape (N,).
            change: Of the speed by an action of 1 [rad/s].
        """
        self._speeds, self._change = np.asarray(speeds, dtype=float), change

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Driver`."""
        return np.clip((self._speeds - commands) / self._change, -1.0, 1.0)[:, None]


class Recorded:
    """Actions that were recorded, whatever the fish does: the open loop that the paper transfers."""

    def __init__(self, actions: Array) -> None:
        """Takes actions; after the last ones the motor keeps its speed. Shape (T, N)."""
        self._actions = actions

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Driver`."""
        if step >= len(self._actions):
            return np.zeros((len(observations), 1))
        return self._actions[step][:, None]
