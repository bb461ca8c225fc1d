"""What a task is to an environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from swim2real.rl.observation import Reading

Array = NDArray[np.float64]

PLACES, RATES = 100.0, 1000.0  # greatest distances [m] and speeds [m/s or rad/s] that can be believed


class Task(Protocol):
    """Observations, rewards, starts and ends; one object an environment, since it keeps an episode's goal.

    Attributes:
        OBSERVATION_NAMES: Where in an observation each part of it is.
        bounds: Greatest magnitude of each number that can be believed; beyond it the simulation has diverged.
        needs_markers: Whether the observation has markers in it.
    """

    OBSERVATION_NAMES: ClassVar[Mapping[str, slice]]
    bounds: ClassVar[Array]
    needs_markers: ClassVar[bool]

    @property
    def seconds(self) -> float:
        """Length of an episode [s]."""
        ...

    def begin(self, rng: np.random.Generator, options: Mapping[str, Any]) -> None:
        """Begins an episode, with what is to be drawn."""
        ...

    def observe(self, reading: Reading, action: float, out: Array) -> None:
        """Writes the observation, with the last action."""
        ...

    def judge(self, reading: Reading, action: float) -> tuple[float, bool]:
        """Reward of a step, and whether the task is done, from the true state after it."""
        ...

    def facts(self, reading: Reading) -> dict[str, Any]:
        """What the info tells of the task besides what all tells."""
        ...


def layout(parts: Mapping[str, tuple[int, float]]) -> tuple[dict[str, slice], Array]:
    """Slices and bounds of an observation, from the length and the bound of each part of it."""
    names: dict[str, slice] = {}
    bounds: list[float] = []
    for name, (length, bound) in parts.items():
        names[name] = slice(len(bounds), len(bounds) + length)
        bounds += [bound] * length
    return names, np.array(bounds)
