"""A calibration problem, whatever a trial is: real trials, and a simulator to compare with them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from contextlib import closing
from typing import Any

from swim2real.calibration.run_folder import RunFolder
from swim2real.errors import TrialError
from swim2real.objective import ComparedTrial, Comparison, Protocol
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation import Engine
from swim2real.trials import Trial, TrialSet

_ROUNDING = 1e-9  # an early stop must not hang on the order of a sum


class Problem(ABC):
    """Evaluates parameter values against real trials.

    Attributes:
        robot: What is calibrated.
        trials: Real, in order.
        protocol: How they are compared.
        horizon: Seconds of each trial that are compared, None for all.
    """

    def __init__(self, robot: Robot, trials: Sequence[Trial], protocol: Protocol, horizon: float | None) -> None:
        if horizon is not None and not horizon > 0:
            raise TrialError(f"horizon is {horizon} s; it must be above 0")
        self.robot, self.trials = robot, tuple(trials)
        self.protocol: Protocol = protocol
        self.horizon = horizon

    def evaluate(self, values: Values, stop_above: float | None = None) -> Comparison:
        """Simulates all trials and compares them with the real ones.

        Args:
            values: Of the candidate.
            stop_above: Stop as soon as the loss is certain to exceed this [m]. A trial's error can't be negative, so
                the sum over the trials so far bounds the loss from below. The trials are taken from the cheapest to
                the costliest; how many it takes doesn't depend on threads.
        """
        if stop_above is None:
            return self.evaluate_many([values])[0]
        order = sorted(range(len(self.trials)), key=self._cost)
        limit = stop_above * len(order) * (1 + _ROUNDING)
        found: dict[int, ComparedTrial] = {}
        with closing(self._simulate_each(values, order)) as simulated:
            for i, trial in zip(order, simulated, strict=True):
                found[i] = self._compared(i, trial)
                if trial.divergence or sum(one.loss(self.protocol) for one in found.values()) > limit:
                    break
        compared = tuple(found[i] for i in sorted(found))
        return Comparison(compared, self.protocol, self.horizon, len(order) - len(found))

    def evaluate_many(self, candidates: Sequence[Values]) -> list[Comparison]:
        """The same for several candidates in one batch."""
        return [
            Comparison(tuple(self._compared(i, trial) for i, trial in enumerate(trials)), self.protocol, self.horizon)
            for trials in self._simulate_many(candidates)
        ]

    @property
    @abstractmethod
    def engine(self) -> Engine:
        """Which physics the losses are made with."""

    @abstractmethod
    def of(self, reference: TrialSet) -> Problem:
        """The same problem with other trials."""

    @abstractmethod
    def blocks(self) -> list[tuple[int, int]]:
        """Rows, in time, and columns of each block of numbers that a comparison's residual vector consists of."""

    @abstractmethod
    def examined(self) -> dict[str, dict[str, Any]]:
        """What was found in each real trial, ready for JSON: quality (`usable`, `findings`, …) and what drove it."""

    @abstractmethod
    def tried(self, values: Values) -> dict[str, Any]:
        """What else a fit is tried on when a run ends, ready for JSON: entries of the outcome."""

    @abstractmethod
    def save(self, folder: RunFolder, fit: Comparison, held_out: Comparison | None) -> None:
        """Keeps the real and simulated trials of comparisons with a run."""

    @abstractmethod
    def _cost(self, index: int) -> float:
        """Of simulating a trial, to sort by."""

    @abstractmethod
    def _simulate_each(self, values: Values, order: Sequence[int]) -> Generator[Trial]: ...

    @abstractmethod
    def _simulate_many(self, candidates: Sequence[Values]) -> list[TrialSet]: ...

    @abstractmethod
    def _compared(self, index: int, simulated: Trial) -> ComparedTrial: ...
