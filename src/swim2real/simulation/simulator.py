"""The forward model: parameter values and swims in, simulated trials out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from swim2real.errors import EngineError
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.engine import Engine
from swim2real.simulation.steady import DivergedError, steady_cycle
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation, MarkerTrack, Trial, TrialSet

_UNROLLED_SAMPLE = 1.0  # s, a diverged simulation still has a track of this length


@dataclass(frozen=True)
class Swim:
    """What is asked of the simulator: one swim.

    Attributes:
        name: Of the simulated trial.
        actuation: With a start speed the swim is a steady cycle, repeated; without one it starts from rest.
        duration: From motor angle `actuation.phase` on [s].
    """

    name: str
    actuation: Actuation
    duration: float


class Simulator:
    """Simulates swims of a robot for one or many candidates at once.

    Every swim is simulated by itself, so results don't depend on the number of threads or on what else is in the
    batch. The threads run the engine without Python's lock.
    """

    def __init__(self, robot: Robot, threads: int | None = None, sample_interval: float = 0.01) -> None:
        """Makes a simulator.

        Args:
            robot: What is simulated.
            threads: Swims simulated at a time; by default the number of cores.
            sample_interval: Longest time between samples of a simulated trial [s].
        """
        if threads is not None and threads < 1:
            raise EngineError(f"threads is {threads}; it must be at least 1")
        self.robot = robot
        self.engine = Engine.of(robot)
        self._threads = threads or os.cpu_count() or 1
        self._sample_interval = sample_interval

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
        jobs = [(model, swim) for model in models for swim in swims]
        # the longest first, so that no thread is left with it at the end
        order = sorted(range(len(jobs)), key=lambda i: -jobs[i][1].actuation.period)
        with ThreadPoolExecutor(self._threads) as pool:
            done = dict(zip(order, pool.map(lambda i: self._swim(*jobs[i]), order), strict=True))
        count = len(swims)
        return [
            TrialSet(tuple(done[c * count + s] for s in range(count)), self.robot.marker_names)
            for c in range(len(candidates))
        ]

    def _swim(self, model: mujoco.MjModel, swim: Swim) -> Trial:
        actuation = swim.actuation
        speed = 2 * np.pi * actuation.frequency
        try:
            if actuation.start_speed is None:
                track = self._from_rest(model, swim, speed)
                note = "from rest"
            else:
                stepper = Stepper(model, self.robot, actuation.start_speed, speed, 0.0)
                cycle = steady_cycle(stepper, actuation.period)
                note = f"steady cycle after {cycle.cycles:.2f} periods" + (
                    "" if cycle.settled else f", not settled: {1e3 * cycle.speed_to_come:.2f} mm/s still to come"
                )
                lead = (actuation.phase / (2 * np.pi)) % 1.0 * actuation.period
                times, markers = cycle.unroll(int(np.ceil((lead + swim.duration) / actuation.period)))
                samples = self._samples(swim.duration)
                track = MarkerTrack(samples, CubicSpline(times, markers, axis=0)(lead + samples))
        except DivergedError as error:
            rest = np.zeros((2, len(self.robot.marker_names), 2)) + self.robot.rest_markers
            track = MarkerTrack([0.0, _UNROLLED_SAMPLE], rest)
            return Trial(swim.name, track, actuation.frequency, provenance="diverged", divergence=str(error))
        return Trial(swim.name, track, actuation.frequency, provenance=f"{self.engine.name}, {note}")

    def _samples(self, duration: float) -> np.ndarray:
        return np.linspace(0.0, duration, int(np.ceil(duration / self._sample_interval - 1e-9)) + 1)

    def _from_rest(self, model: mujoco.MjModel, swim: Swim, speed: float) -> MarkerTrack:
        stepper = Stepper(model, self.robot, 0.0, speed, swim.actuation.phase)
        chunk = stepper.run(int(np.ceil(swim.duration / stepper.timestep - 1e-9)) + 1)
        if chunk.failed_at is not None:
            raise DivergedError(f"the simulation diverged {chunk.failed_at:.3f} s after its start")
        times = np.arange(len(chunk.markers)) * stepper.timestep
        samples = self._samples(swim.duration)
        return MarkerTrack(samples, CubicSpline(times, chunk.markers, axis=0)(samples))
