"""What every simulator of a robot offers to those who compare its trials with real ones."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Protocol, TypeVar

from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.engine import Engine
from swim2real.trials import Trial, TrialSet

Request_contra = TypeVar("Request_contra", contravariant=True)


class ForwardModel(Protocol[Request_contra]):
    """Parameter values and requests in, simulated trials out.

    `Simulator` and `PlaybackSimulator` are forward models. Each has a method `request` that makes a request of a real
    trial: a `Swim` or a `Rollout`.

    Attributes:
        robot: The robot that is simulated.
        engine: The physics engine that it is simulated with.
    """

    robot: Robot
    engine: Engine

    def simulate(self, values: Values, requests: Sequence[Request_contra], /) -> TrialSet:
        """Simulated trials for one candidate, in the order of the requests."""
        ...

    def simulate_many(self, candidates: Sequence[Values], requests: Sequence[Request_contra], /) -> list[TrialSet]:
        """Simulated trials for several candidates, in one batch."""
        ...

    def simulate_each(self, values: Values, requests: Sequence[Request_contra], /) -> Generator[Trial]:
        """Simulated trials for one candidate, each as soon as it and those before it are done.

        Closing the generator gives up the rest.
        """
        ...
