"""The forward model: parameter values and swims in, simulated trials out."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from swim2real.errors import EngineError
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.engine import Engine
from swim2real.simulation.fast_step import FastStep, disagreement
from swim2real.simulation.forward_model import all_of, thread_count
from swim2real.simulation.steady import DivergedError, run_to, steady_cycle
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation, MarkerTrack, Trial, TrialSet

Step = Literal["auto", "fast", "engine"]
AGREEMENT = 1e-10  # of one step's velocities with the engine's own, relative

SETTLING = 6.0  # s of a swim at full length before it counts as steady
_UNROLLED_SAMPLE = 1.0  # s, a diverged simulation still has a track of this length
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Swim:
    """A request to the simulator: one swim.

    Attributes:
        name: Name of the simulated trial.
        actuation: With a start speed the swim is a steady cycle, repeated; without one it starts from rest.
        duration: Duration from motor angle `actuation.phase` on [s].
    """

    name: str
    actuation: Actuation
    duration: float


class Simulator:
    """Simulates swims of a robot for one or many candidates at once.

    Every swim is simulated by itself, so results don't depend on the number of threads or on what else is in the
    batch. The threads run without Python's lock.

    Attributes:
        robot: The robot that is simulated.
        engine: The physics engine that it is simulated with.
        step: `fast` or `engine`, whichever steps the published robot. The provenance of a trial names its own.
    """

    def __init__(
        self, robot: Robot, threads: int | None = None, sample_interval: float = 0.01, step: Step = "auto",
        full_length: bool = False,
    ) -> None:  # fmt: skip
        """Makes a simulator.

        Args:
            robot: The robot that is simulated.
            threads: Swims simulated at a time; by default the number of cores.
            sample_interval: Longest time between samples of a simulated trial [s].
            step: `fast`: the fast step, or an error. `engine`: the engine's own. `auto`: the fast step where it
                applies and agrees with the engine's own, which is checked on the published robot.
            full_length: Simulate steady swims for as long as they are asked for, after `SETTLING` to become steady,
                instead of finding and repeating their cycle: several times slower, to check the cycle by.

        Raises:
            EngineError: An argument is outside what is allowed, or the fast step is asked for and doesn't apply.
        """
        self._threads = thread_count(threads)
        if step not in get_args(Step):
            raise EngineError(f"step is '{step}'; there are {', '.join(get_args(Step))}")
        self.robot = robot
        self.engine = Engine.of(robot)
        self._sample_interval = sample_interval
        self._required, self._full_length = step == "fast", full_length
        self.step: Literal["fast", "engine"] = "fast"
        if step == "engine" or self._planned(robot.build(robot.space.published).compile(), check=True) is None:
            self.step = "engine"

    def request(self, trial: Trial, actuation: Actuation, lead: float = 0.0) -> Swim:
        """The swim that a real trial is compared with.

        Args:
            trial: Real trial.
            actuation: What drives the swim.
            lead: Time that is simulated beyond the duration of the trial [s].
        """
        return Swim(trial.name, actuation, trial.track.duration + lead)

    def simulate(self, values: Values, swims: Sequence[Swim]) -> TrialSet:
        """Simulated trials for one candidate, in the order of the swims."""
        return self.simulate_many([values], swims)[0]

    def simulate_many(self, candidates: Sequence[Values], swims: Sequence[Swim]) -> list[TrialSet]:
        """Simulated trials for several candidates, in one batch.

        A simulation that diverges is a trial with a `divergence` that says when; it never raises.

        Returns:
            One set a candidate. World frame [m]; the head starts at the origin and points to -x.
        """
        models = [self.robot.build(values).compile() for values in candidates]
        steps = [self._planned(model) if self.step == "fast" else None for model in models]
        jobs = [
            partial(self._swim, model, fast, swim) for model, fast in zip(models, steps, strict=True) for swim in swims
        ]
        periods = [swim.actuation.period for swim in swims] * len(models)  # a swim settles after so many of them
        trials, count = all_of(jobs, periods, self._threads), len(swims)
        sets = [tuple(trials[c * count : (c + 1) * count]) for c in range(len(candidates))]
        return [TrialSet(each, self.robot.marker_names) for each in sets]

    def _planned(self, model: mujoco.MjModel, check: bool = False) -> FastStep | None:
        """The fast step of a model; without one a warning says why."""
        try:
            fast = FastStep(model)
            gap = disagreement(fast) if check else 0.0
            if gap <= AGREEMENT:
                return fast
            why = f"it differs from the engine's own by {gap:.2g}, relative, after one step"
        except EngineError as error:
            why = str(error)
        if self._required:
            raise EngineError(f"the fast step can't simulate robot '{self.robot.name}': {why}; use step 'engine'")
        _log.warning("robot '%s' is simulated with the engine's own step, which is slower: %s", self.robot.name, why)
        return None

    def _swim(self, model: mujoco.MjModel, fast: FastStep | None, swim: Swim) -> Trial:
        actuation = swim.actuation
        speed = 2 * np.pi * actuation.frequency
        step = "engine's own" if fast is None else "fast"
        try:
            if actuation.start_speed is None:
                track = self._from_rest(model, fast, swim, speed)
                note = "from rest"
            else:
                stepper = Stepper(model, self.robot, actuation.start_speed, speed, 0.0, fast)
                steady = self._steady_at_length if self._full_length else self._steady_cycle
                track, note = steady(stepper, swim)
        except DivergedError as error:
            rest = np.zeros((2, len(self.robot.marker_names), 2)) + self.robot.rest_markers
            track = MarkerTrack([0.0, _UNROLLED_SAMPLE], rest)
            return Trial(swim.name, track, actuation.frequency, provenance="diverged", divergence=str(error))
        return Trial(swim.name, track, actuation.frequency, provenance=f"{self.engine.name}, {step} step, {note}")

    def _steady_cycle(self, stepper: Stepper, swim: Swim) -> tuple[MarkerTrack, str]:
        period = swim.actuation.period
        cycle = steady_cycle(stepper, period)
        note = f"steady cycle after {cycle.cycles:.2f} periods" + (
            "" if cycle.settled else f", not settled: {1e3 * cycle.speed_to_come:.2f} mm/s still to come"
        )
        lead = swim.actuation.phase / (2 * np.pi) % 1.0 * period
        times, markers = cycle.unroll(int(np.ceil((lead + swim.duration) / period)))
        samples = self._samples(swim.duration)
        return MarkerTrack(samples, CubicSpline(times, markers, axis=0)(lead + samples)), note

    def _steady_at_length(self, stepper: Stepper, swim: Swim) -> tuple[MarkerTrack, str]:
        period = swim.actuation.period
        start = np.ceil(SETTLING / period) + swim.actuation.phase / (2 * np.pi) % 1.0  # turns
        chunk = run_to(None, stepper, period, start + swim.duration / period)
        times = np.arange(len(chunk.turns)) * stepper.timestep
        samples = self._samples(swim.duration)
        begin = float(np.interp(start, chunk.turns, times))
        return MarkerTrack(samples, CubicSpline(times, chunk.markers, axis=0)(begin + samples)), "at full length"

    def _samples(self, duration: float) -> np.ndarray:
        return np.linspace(0.0, duration, int(np.ceil(duration / self._sample_interval - 1e-9)) + 1)

    def _from_rest(self, model: mujoco.MjModel, fast: FastStep | None, swim: Swim, speed: float) -> MarkerTrack:
        stepper = Stepper(model, self.robot, 0.0, speed, swim.actuation.phase, fast)
        chunk = stepper.run(int(np.ceil(swim.duration / stepper.timestep - 1e-9)) + 1)
        if chunk.failed_at is not None:
            raise DivergedError(f"the simulation diverged {chunk.failed_at:.3f} s after its start")
        times = np.arange(len(chunk.markers)) * stepper.timestep
        samples = self._samples(swim.duration)
        return MarkerTrack(samples, CubicSpline(times, chunk.markers, axis=0)(samples))
