"""What can command a robot: a learned policy, constant commands, recorded actions, a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import RunError
from swim2real.rl.actor import Actor
from swim2real.rl.body import Actuators
from swim2real.rl.conditions import CONTROL_INTERVAL
from swim2real.rl.training_run import BEST, LAST, TrainingRun

Array = NDArray[np.float64]
Which = Literal["best", "last"]


class Policy(Protocol):
    """Gives actions to each of N environments, step after step."""

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """Actions within -1 and 1.

        Args:
            observations: Observations of the environments. Shape (N, n).
            commands: Present commands [unit]. Shape (N, A).
            step: Number of steps since the episodes began.

        Returns:
            Shape (N, A).
        """
        ...


class LearnedPolicy:
    """A trained network. It is deterministic: it takes the mean of its actions."""

    def __init__(self, actor: Actor) -> None:
        """Takes the network."""
        self.actor = actor

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Policy`."""
        del commands, step
        return self.actor.best(observations)


class Followed:
    """Commands that are followed as fast as the actuators' rates allow: constant ones, or rows after one another."""

    def __init__(self, commands: Array, actuators: Actuators) -> None:
        """Takes the commands.

        Args:
            commands: Commands of each environment [unit]. Shape (N, A), or (T, N, A) with a row a step, of which the
                last holds.
            actuators: The actuators.
        """
        self._commands = commands if commands.ndim == 3 else commands[None]
        self._change = actuators.rate * CONTROL_INTERVAL

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Policy`."""
        del observations
        wanted = self._commands[min(step, len(self._commands) - 1)]
        return np.clip((wanted - commands) / self._change, -1.0, 1.0)


class RecordedActions:
    """Actions that were recorded, whatever the robot does: the open loop that the paper transfers."""

    def __init__(self, actions: Sequence[Array]) -> None:
        """Takes the actions of each environment; after its last one the commands stay. Shapes (T_i, A)."""
        longest = max(len(series) for series in actions)
        self._actions = np.zeros((longest, len(actions), actions[0].shape[1]))
        for i, series in enumerate(actions):
            self._actions[: len(series), i] = series

    def actions(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """See `Policy`."""
        del observations
        return self._actions[step] if step < len(self._actions) else np.zeros_like(commands)


def load_policy(run: TrainingRun, which: Which = "best") -> LearnedPolicy:
    """Loads a policy from a training run.

    Args:
        run: The training run.
        which: `best` in the evaluations while it learned, or `last`.

    Raises:
        RunError: The policy isn't there or is damaged.
    """
    path = run.folder / (BEST if which == "best" else LAST)
    if not path.is_file():
        raise RunError(f"'{run.folder}' has no {path.name} yet; wait for its first evaluation")
    return LearnedPolicy(Actor.load(path))
