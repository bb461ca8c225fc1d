"""The forward model: parameter values and swims in, simulated trials out."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from fluidstep.step import FastStep, disagreement
from markertrack import frames
from markertrack.track import MarkerTrack
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.forward_model import Engine, all_of, model_of, thread_count
from swim2real.simulation.stepper import Chunk, Stepper
from swim2real.trials import Actuation, Trial, TrialSet
from swimbase.arrays import Array
from swimbase.errors import EngineError

SimulationStep = Literal["auto", "fast", "engine"]
_AGREEMENT = 1e-10  # of one step's velocities with the engine's own, relative

_SETTLING, _FROM_REST = 3.0, 12.0  # s of a swim at full length, and beats at least, before it counts as steady
_SPEED_TOLERANCE = 2e-4  # m/s, of the mean speed still to come
_SPEED_SHARE = 2e-3  # or this share of the speed
_SHAPE_TOLERANCE = 1e-3  # m, mean over markers, from one cycle to the next
_MAX_CYCLES = 12
_SETTLING_TIME = 0.4  # s at least, and half a cycle, before a cycle may count
_SLOW = 0.45  # push when a speed change shrinks by no more than this over a cycle
_CAUTIOUS = 0.8  # the same, for a first decision that it has settled
_PUSH_SHAPE = 5e-3  # m, push only a robot whose shape has nearly settled
_MARGIN_STEPS = 3
_MOTOR_TRIES = 4  # a loaded motor that needs more chunks than that is stuck
_MIN_SAMPLES = 64
_SAMPLE_INTERVAL = 0.01  # s
_UNROLLED_SAMPLE = 1.0  # s, a diverged simulation still has a track of this length
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Swim:
    """A request to the simulator: one swim.

    Attributes:
        name: Name of the simulated trial.
        actuation: With a start speed the swim is a steady cycle, repeated; without one it starts from rest.
        duration: Duration from motor angle `actuation.phase` on [s].
        turn_rate: Turn of the real course [rad/s]. A symmetric robot that turns by itself may turn either way, by how
            it starts: where its cycle turns the other way, it is simulated from the opposite motor angle as well.
    """

    name: str
    actuation: Actuation
    duration: float
    turn_rate: float = 0.0


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
        self, robot: Robot, threads: int | None = None, sample_interval: float = 0.01, step: SimulationStep = "auto",
        full_length: bool = False,
    ) -> None:  # fmt: skip
        """Makes a simulator.

        Args:
            robot: The robot that is simulated.
            threads: Swims simulated at a time; by default the number of cores.
            sample_interval: Longest time between samples of a simulated trial [s].
            step: `fast`: the fast step, or an error. `engine`: the engine's own. `auto`: the fast step where it
                applies and agrees with the engine's own, which is checked on the published robot.
            full_length: Simulate steady swims for as long as they are asked for, after `settling_turns`, instead of
                finding and repeating their cycle: several times slower, to check the cycle by. So is a robot with a
                slow mode always simulated: it may not repeat after a beat, and where its cycle is found depends on
                thresholds, so that the loss jumps by up to a millimeter as parameters change.

        Raises:
            EngineError: An argument is outside what is allowed, or the fast step is asked for and doesn't apply.
        """
        self._threads = thread_count(threads)
        if step not in get_args(SimulationStep):
            raise EngineError(f"step is '{step}'; there are {', '.join(get_args(SimulationStep))}")
        self.robot = robot
        self.engine = Engine.of(robot)
        self._sample_interval = sample_interval
        self._required, self._full_length = step == "fast", full_length or robot.swims.slow_mode
        self.step: Literal["fast", "engine"] = "fast"
        if step == "engine" or self._planned(robot.model, check=True) is None:
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

        A simulation that diverges, and a model that can't be made of a candidate's values, is a trial with a
        `divergence` that says why; it never raises.

        Returns:
            One set a candidate. World frame [m]; the head starts at the origin and points to -x.
        """
        models = [model_of(self.robot, values) for values in candidates]
        fast = self.step == "fast"
        steps = [self._planned(model) if fast and not isinstance(model, str) else None for model in models]
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
            if gap <= _AGREEMENT:
                return fast
            why = f"it differs from the engine's own by {gap:.2g}, relative, after one step"
        except EngineError as error:
            why = str(error)
        if self._required:
            raise EngineError(f"the fast step can't simulate robot '{self.robot.name}': {why}; use step 'engine'")
        _log.warning("robot '%s' is simulated with the engine's own step, which is slower: %s", self.robot.name, why)
        return None

    def _swim(self, model: mujoco.MjModel | str, fast: FastStep | None, swim: Swim) -> Trial:
        actuation = swim.actuation
        speed = 2 * np.pi * actuation.frequency
        step = "engine's own" if fast is None else "fast"
        first_beats = None
        try:
            if isinstance(model, str):
                raise _DivergedError(model)
            if actuation.start_speed is None:
                track = self._from_rest(model, fast, swim, speed)
                note = "from rest"
            else:
                begin = partial(Stepper, model, self.robot, actuation.start_speed, speed, fast=fast)
                if self._full_length:
                    track, first_beats = self._at_length(begin(motor_angle=0.0), swim)
                    note = "at full length"
                else:
                    track, first_beats, note = self._steady_cycle(begin, swim)
                if actuation.start_speed:
                    first_beats = None
        except _DivergedError as error:
            rest = np.zeros((2, len(self.robot.marker_names), 2)) + self.robot.rest_markers
            track = MarkerTrack([0.0, _UNROLLED_SAMPLE], rest)
            return Trial(swim.name, track, actuation.frequency, provenance="diverged", divergence=str(error))
        provenance = f"{self.engine.name}, {step} step, {note}"
        return Trial(swim.name, track, actuation.frequency, provenance=provenance, first_beats=first_beats)

    def _steady_cycle(self, begin: Callable[..., Stepper], swim: Swim) -> tuple[MarkerTrack, float, str]:
        period = swim.actuation.period
        cycle = steady_cycle(begin(motor_angle=0.0), period)
        length = float(np.ptp(self.robot.rest_markers, axis=0).max())
        if cycle.turn * swim.turn_rate < 0 and length * abs(cycle.turn) > _SHAPE_TOLERANCE:
            other = steady_cycle(begin(motor_angle=np.pi), period)
            cycle = min(cycle, other, key=lambda one: abs(one.turn - swim.turn_rate * period))
        note = f"steady cycle after {cycle.cycles:.2f} periods"
        lead = swim.actuation.phase / (2 * np.pi) % 1.0 * period
        times, markers = cycle.unroll(int(np.ceil((lead + swim.duration) / period)))
        samples = self._samples(swim.duration)
        track = MarkerTrack(samples, CubicSpline(times, markers, axis=0)(lead + samples))
        return track, cycle.first_beats, note

    def _at_length(self, stepper: Stepper, swim: Swim) -> tuple[MarkerTrack, float]:
        """The swim from the first motor angle of its phase on, once it has settled, and its first beats' speed."""
        actuation = swim.actuation
        start = settling_turns(actuation.frequency, actuation.start_speed) + actuation.phase / (2 * np.pi) % 1.0
        chunk = _run_to(None, stepper, actuation.period, start + swim.duration / actuation.period)
        times = np.arange(len(chunk.turns)) * stepper.timestep
        samples = self._samples(swim.duration)
        begin = float(np.interp(start, chunk.turns, times))
        track = MarkerTrack(samples, CubicSpline(times, chunk.markers, axis=0)(begin + samples))
        return track, _first_beats(chunk, actuation.period)

    def _samples(self, duration: float) -> np.ndarray:
        return np.linspace(0.0, duration, int(np.ceil(duration / self._sample_interval - 1e-9)) + 1)

    def _from_rest(self, model: mujoco.MjModel, fast: FastStep | None, swim: Swim, speed: float) -> MarkerTrack:
        stepper = Stepper(model, self.robot, 0.0, speed, swim.actuation.phase, fast)
        chunk = stepper.run(int(np.ceil(swim.duration / stepper.timestep - 1e-9)) + 1)
        if chunk.failed_at is not None:
            raise _DivergedError(f"the simulation diverged {chunk.failed_at:.3f} s after its start")
        times = np.arange(len(chunk.markers)) * stepper.timestep
        samples = self._samples(swim.duration)
        return MarkerTrack(samples, CubicSpline(times, chunk.markers, axis=0)(samples))


class _DivergedError(Exception):
    """There is no simulation; the message says why."""


@dataclass(frozen=True)
class Cycle:
    """One period of steady swimming.

    Attributes:
        period: Duration of a period [s].
        markers: Positions at equally spaced phases from motor angle 0 to one full turn, both included [m].
            Shape (P + 1, M, 2).
        cycles: Simulated periods that it took.
        first_beats: Forward speed over the first two of them, or fewer where it took fewer [m/s].
    """

    period: float
    markers: Array
    cycles: float
    first_beats: float = 0.0

    @property
    def turn(self) -> float:
        """Angle by which it turns from its start to its end [rad]."""
        first, last = frames.body_axes(self.markers[[0, -1]])
        return float(np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last))

    def unroll(self, count: int) -> tuple[Array, Array]:
        """The swim that repeats this cycle, each one starting where and how the last one ended.

        Args:
            count: Number of cycles.

        Returns:
            Times [s], shape (count P + 1,), and positions [m], shape (count P + 1, M, 2), heading along -x at first.
        """
        samples, heads, turn = len(self.markers) - 1, frames.heads(self.markers), self.turn
        step = heads[-1] - heads[0]
        local = self.markers[:-1] - heads[0]
        pieces: list[Array] = []
        origin = np.zeros(2)
        for k in range(count + 1):
            c, s = np.cos(k * turn), np.sin(k * turn)
            rotation = np.array([[c, s], [-s, c]])  # for row vectors
            pieces.append((local if k < count else local[:1]) @ rotation + origin)
            origin = origin + step @ rotation
        return np.arange(count * samples + 1, dtype=np.float64) * (self.period / samples), np.concatenate(pieces)


def steady_cycle(stepper: Stepper, period: float) -> Cycle:
    """Simulates until the cycle repeats, or for `_MAX_CYCLES`, whose last one is taken.

    Cycles are counted by the motor's angle, not by time: under load the motor turns a little slower than it should.

    Args:
        stepper: Fresh.
        period: Period of the motor [s].

    Raises:
        DivergedError: The engine gave up.
    """
    end = stepper.turns_begun + max(0.5, np.ceil(2 * _SETTLING_TIME / period) / 2) + 1.0  # turns
    swim, change_before, first_beats = _run_to(None, stepper, period, end), None, None
    while True:
        first, last = _instant(swim, end - 1), _instant(swim, end)
        shape_change = float(np.linalg.norm(last.body - first.body, axis=1).mean())
        change = last.speed - first.speed
        ratio = _CAUTIOUS if change_before is None else _ratio(change, change_before)
        # the change decays geometrically, so this is missing from the mean speed of the cycle
        to_come = change * np.sqrt(ratio) / (1 - ratio)
        tolerance = max(_SPEED_TOLERANCE, _SPEED_SHARE * float(np.linalg.norm(last.head - first.head)) / period)
        if end >= _MAX_CYCLES or (abs(to_come) < tolerance and shape_change < _SHAPE_TOLERANCE):
            speed = _first_beats(swim, period) if first_beats is None else first_beats
            return Cycle(period, _one_turn(swim, end, period), float(end), speed)
        if change_before is not None and ratio > _SLOW and shape_change < _PUSH_SHAPE:
            first_beats = _first_beats(swim, period) if first_beats is None else first_beats  # unpushed
            stepper.push(change * ratio / (1 - ratio) * last.forward)
            change_before, end = None, float(swim.turns[-1]) + 1.25
        else:
            change_before, end = change, end + 0.5
        swim = _run_to(swim, stepper, period, end)


def _first_beats(swim: Chunk, period: float) -> float:
    """Forward speed over the first two turns of the motor, or fewer where there are fewer [m/s]."""
    begun = float(swim.turns[0])
    turns = min(2.0, float(swim.turns[-1]) - begun)
    way = np.interp([begun, begun + turns], swim.turns, swim.markers[:, :, 0].mean(axis=1))  # the head points to -x
    return float(way[0] - way[1]) / (turns * period)


def settling_turns(frequency: float, start_speed: float | None = None) -> float:
    """Turns of the motor before a swim at full length counts as steady: from rest a heavy hull gathers speed slowly."""
    return float(np.ceil((_SETTLING if start_speed else _FROM_REST) * max(frequency, 1.0)))


def _run_to(swim: Chunk | None, stepper: Stepper, period: float, turns: float) -> Chunk:
    """Simulates until the motor has made so many turns, and a few steps more."""
    wanted = turns + _MARGIN_STEPS * stepper.timestep / period
    made = stepper.turns_begun
    for _ in range(_MOTOR_TRIES):
        if swim is not None:
            made = float(swim.turns[-1])
            if made >= wanted:
                return swim
        chunk = stepper.run(int(np.ceil((wanted - made) * period / stepper.timestep)) + 1)
        swim = chunk if swim is None else swim.then(chunk)
        if swim.failed_at is not None:
            raise _DivergedError(f"the simulation diverged {swim.failed_at:.3f} s after its start")
    raise _DivergedError(f"the motor is stuck: {made:.2f} turns where {turns:.2f} were due")


@dataclass(frozen=True)
class _Instant:
    """The swimmer at one instant: body shape [m], head [m], forward direction, and forward speed up to then [m/s]."""

    body: Array
    head: Array
    forward: Array
    speed: float


def _instant(swim: Chunk, turns: float) -> _Instant:
    step = float(np.interp(turns, swim.turns, np.arange(len(swim.turns))))
    k, share = int(step), step - int(step)
    markers = (1 - share) * swim.markers[k : k + 1] + share * swim.markers[k + 1 : k + 2]
    # over a quarter of a cycle, since the speed at an instant also holds the tail's fast wobble
    lately = slice(int(np.searchsorted(swim.turns, turns - 0.25)), k + 1)
    forward = -frames.body_axes(swim.markers[lately])
    speed = float((swim.velocity[lately] * forward).sum(axis=1).mean())
    return _Instant(frames.to_body(markers)[0], frames.heads(markers)[0], forward[-1], speed)


def _ratio(change: float, before: float) -> float:
    """By how much a change shrinks over a cycle, from two that lie half a cycle apart."""
    return float(np.clip((change / before) ** 2, 0.01, 0.8)) if before else _CAUTIOUS


def _one_turn(swim: Chunk, end: float, period: float) -> Array:
    """The last cycle, resampled to start at motor angle 0. Shape (P + 1, M, 2)."""
    samples = max(_MIN_SAMPLES, int(np.ceil(period / _SAMPLE_INTERVAL)))
    start = end - 1
    first = max(int(np.searchsorted(swim.turns, start)) - 3, 0)
    spline = CubicSpline(swim.turns[first:], swim.markers[first:], axis=0)
    cycle = Cycle(period, spline(start + np.arange(samples + 1) / samples), 0.0)
    _, twice = cycle.unroll(2)
    lead = (np.ceil(start) - start) * samples  # to the next angle 0
    return CubicSpline(np.arange(len(twice)), twice, axis=0)(lead + np.arange(samples + 1))
