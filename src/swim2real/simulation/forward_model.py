"""What the simulators of a robot have in common: their methods, and simulations on several threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, TypeVar

from swim2real.errors import EngineError
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.engine import Engine
from swim2real.trials import TrialSet

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


T = TypeVar("T")


def thread_count(threads: int | None) -> int:
    """How many to use; the number of cores for None.

    Raises:
        EngineError: Fewer than one.
    """
    if threads is not None and threads < 1:
        raise EngineError(f"threads is {threads}; it must be at least 1")
    return threads or os.cpu_count() or 1


def all_of(work: Sequence[Callable[[], T]], costs: Sequence[float], threads: int) -> list[T]:
    """Results in the order of the work, the costliest begun first, so that no thread is left with it at the end."""
    order = sorted(range(len(work)), key=lambda i: -costs[i])
    with ThreadPoolExecutor(threads) as pool:
        done = dict(zip(order, pool.map(lambda i: work[i](), order), strict=True))
    return [done[i] for i in range(len(work))]
