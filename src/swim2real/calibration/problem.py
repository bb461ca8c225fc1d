"""A calibration problem: real trials, and a simulator whose trials are compared with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from swim2real.calibration.from_rest import FromRest, backward_at_first, settled, swims_from_rest
from swim2real.calibration.protocols import Protocol, protocol_for
from swim2real.objective import Comparison
from swim2real.objective.comparison import UnfilmedSwim, rounded
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON, EvaluationSettings, ProtocolName, Start
from swim2real.simulation import Engine, ForwardModel
from swim2real.simulation.forward_model import thread_count
from swim2real.trials import Trial, TrialSet
from swimbase.errors import TrialError

_LONG = 2.0  # s, of a swim that no trial shows: about what a trial counts for
_ENOUGH = 0.5  # share of the speed that trials show at its frequency; below theirs, of one that grows with it from 0
_STEEP = 10.0  # times the way backward in the second beat of one, that a search keeps away from turning


class Problem:
    """Evaluates parameter values against real trials.

    Attributes:
        robot: The robot that is calibrated.
        protocol: How trials are compared.
        horizon: Seconds of each trial that are compared, None for all.
        simulator: What simulates the robot's trials.
        prepared: The real trials, in order, with all that doesn't depend on a candidate.
    """

    def __init__(
        self, robot: Robot, reference: TrialSet, protocol: ProtocolName | Protocol[Any] = "motion",
        horizon: float | None = HORIZON, *, start: Start | None = None, pieces: float | None = None,
        threads: int | None = None,
        simulator: ForwardModel[Any] | None = None,
    ) -> None:  # fmt: skip
        """Poses the problem of calibrating a robot against a reference.

        Args:
            robot: The robot that is calibrated.
            reference: The real trials.
            protocol: How trials are compared, by name or itself.
            horizon: Seconds of each trial that are compared, None for all.
            start: Start of steady swims under the protocols `motion` and `aligned`; None for the protocol's own.
            pieces: Length of the pieces into which recordings are cut, each with a fitted start of its own [s]; None
                doesn't cut them.
            threads: Trials simulated at a time, None for all cores.
            simulator: What simulates the robot's trials; None makes the protocol's own.

        Raises:
            ArgumentError: The robot's trials can't be compared like that.
            TrialError: The reference isn't the robot's, or a trial lacks what it takes.
        """
        if horizon is not None and not horizon > 0:
            raise TrialError(f"horizon is {horizon} s; it must be above 0")
        self.robot, self.horizon, self._threads = robot, horizon, thread_count(threads)
        self.protocol: Protocol[Any] = (
            protocol_for(robot, protocol, start, pieces) if isinstance(protocol, str) else protocol
        )
        self.simulator: Any = simulator or self.protocol.simulator(robot, threads)
        self.prepared = self.protocol.prepare(reference, robot, self.simulator, horizon)
        self._head_first = self.protocol.known_head_first(robot)
        shown = {0.0: 0.0} | {
            one.request.actuation.frequency: one.target.velocity or 0.0 for one in self.prepared if self._head_first
        }
        filmed = sorted(shown)
        self._enough = [_ENOUGH * np.interp(f, filmed, [shown[g] for g in filmed]) for f in self._head_first.values()]

    @classmethod
    def with_settings(cls, robot: Robot, reference: TrialSet, settings: EvaluationSettings) -> Problem:
        """The problem that the settings of an evaluation, or of a calibration, pose.

        Args:
            robot: The robot that is calibrated.
            reference: The real trials.
            settings: How trials are compared.
        """
        return cls(
            robot, reference, settings.protocol, settings.horizon, start=settings.start, pieces=settings.pieces,
            threads=settings.threads,
        )  # fmt: skip

    def of(self, reference: TrialSet) -> Problem:
        """The same problem with other trials."""
        return Problem(
            self.robot, reference, self.protocol, self.horizon, threads=self._threads, simulator=self.simulator
        )

    @property
    def trials(self) -> tuple[Trial, ...]:
        """The real trials."""
        return tuple(prepared.trial for prepared in self.prepared)

    @property
    def engine(self) -> Engine:
        """Which physics the losses are made with."""
        return self.simulator.engine

    def evaluate(self, values: Values) -> Comparison:
        """Simulates all trials with a candidate's parameter values and compares them with the real ones."""
        return self._compared(self.simulator.simulate(values, self._requests))

    def evaluate_many(self, candidates: Sequence[Values]) -> list[Comparison]:
        """The same for several candidates in one batch."""
        return list(self.evaluate_each(candidates))

    def evaluate_each(self, candidates: Sequence[Values]) -> Iterator[Comparison]:
        """The same for several candidates in their order, each as soon as it is there, some at a time."""
        if len(candidates) == 1:
            yield self.evaluate(candidates[0])
            return
        with ThreadPoolExecutor(self._threads) as pool:
            yield from pool.map(self.evaluate, candidates)

    def blocks(self) -> list[tuple[int, int]]:
        """Rows, in time, and columns of each block of numbers that a comparison's residual vector consists of."""
        blocks: list[tuple[int, int]] = []
        for prepared in self.prepared:
            frames, markers = prepared.target.weights.shape
            blocks.append((frames, 2 * markers))
            blocks += [(len(sensor.times), 1) for sensor in prepared.target.sensors]
        return blocks

    def examinations(self) -> dict[str, dict[str, Any]]:
        """Findings in each real trial, ready for JSON."""
        return {prepared.trial.name: dict(prepared.examination) for prepared in self.prepared}

    def check_fit(self, values: Values) -> dict[str, FromRest]:
        """Swims from rest that a fit is tried on when a run ends, by name; none for a robot without a beat."""
        return self.protocol.check_fit(self.simulator, values, self.prepared)

    def speeds_from_rest(self, values: Values) -> dict[str, tuple[float | None, float | None]]:
        """Forward speeds of swims from rest, by trial [m/s]: once settled, and over the first two beats.

        None where one diverged. Empty for a robot whose trials have no beat.
        """
        return {name: (rounded(swim.speed), rounded(swim.first_beats)) for name, swim in self.check_fit(values).items()}

    @property
    def _requests(self) -> list[Any]:
        return [*(prepared.request for prepared in self.prepared), *swims_from_rest(self._head_first)]

    def _compared(self, simulated: TrialSet) -> Comparison:
        pairs = zip(self.prepared, simulated.trials[: len(self.prepared)], strict=True)
        trials = tuple(self.protocol.compare(prepared.target, trial) for prepared, trial in pairs)
        others = zip(simulated.trials[len(self.prepared) :], self._head_first.values(), self._enough, strict=True)
        return Comparison(trials, self.protocol.name, self.horizon, tuple(_unfilmed(*other) for other in others))


def _unfilmed(trial: Trial, frequency: float, enough: float) -> UnfilmedSwim:
    speed = settled(trial, frequency).speed or 0.0
    near = _STEEP * backward_at_first(trial, frequency)
    return UnfilmedSwim(_LONG * max(enough - speed, 0.0), near, speed < 0)
