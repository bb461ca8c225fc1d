"""Real trials as the toolbox takes them: a state to begin in, controls of every step, and what was measured.

The toolbox neither looks for a start, nor finds a steady cycle, nor aligns, so all of this is done once, here, with
given parameter values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import Problem
from swim2real.errors import ArgumentError, EngineError, TrialError
from swim2real.objective import ComparedTrial, Target
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation import Rollout, Swim
from swim2real.simulation.playback import sampled, sensor_address
from swim2real.simulation.simulator import SETTLING
from swim2real.simulation.start import WINDOW
from swim2real.simulation.steady import DivergedError, run_to
from swim2real.simulation.stepper import Stepper, physics_state, roll
from swim2real.trials import MarkerTrack, frames

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """A trial: the state that it begins in, what drives it, and what was measured.

    Attributes:
        name: Name of the trial.
        state: State of the engine at time 0, as `physics_state` has it. Shape (S,).
        controls: Controls of every physics step. Shape (N, nu).
        times: Times of the readings, since that state [s]. Shape (T,).
        readings: Readings as the model's sensors give them, NaN where nothing was measured. Shape (T, nsensordata).
    """

    name: str
    state: Array
    controls: Array
    times: Array
    readings: Array


@dataclass(frozen=True)
class _Beginning:
    """Where a trial begins and how its markers move from there on.

    Attributes:
        state: State of the engine at time 0. Shape (S,).
        controls: Controls of every physics step. Shape (N, nu).
        times: Times of the frames, since that state [s]. Shape (T,).
        positions: Real markers, NaN where they don't count [m]. Shape (T, M, 2).
        simulated: Simulated markers at the first frames, which the real ones are moved and turned to meet [m]; None
            where both are in one world. Shape (K, M, 2).
    """

    state: Array
    controls: Array
    times: Array
    positions: Array
    simulated: Array | None


def trajectories(problem: Problem, values: Values) -> list[Trajectory]:
    """The trials of a problem, begun with given values.

    A recording begins at its start. Where it is compared in a frame on the robot, its track is placed such that its
    first tenth of a second meets the simulated one. A steady swim begins in the steady state of these values, at the
    trial's phase; other values begin with a transient of their own. Its track is registered as these values register
    it, and placed such that its first beat meets the simulated one.

    Args:
        problem: Real trials, by protocol `aligned` or `playback`.
        values: Parameter values whose simulations begin the trajectories.

    Raises:
        ArgumentError: The problem's protocol aligns nothing.
        EngineError: A simulation of these values diverges.
        TrialError: Nothing tells where a trial begins.
    """
    robot, model = problem.robot, problem.robot.build(values).compile()
    made: list[Trajectory] = []
    for prepared, begin in zip(problem.prepared, _beginnings(problem, model, values), strict=True):
        name, track = prepared.trial.name, prepared.trial.track
        positions = begin.positions if begin.simulated is None else _placed(name, begin.positions, begin.simulated)
        times, readings = begin.times, _marker_readings(robot, model, positions)
        late = robot.delays_of(values)
        for sensor in prepared.target.sensors:
            column = np.full((len(sensor.times), model.nsensordata), np.nan)
            column[:, sensor_address(model, sensor.name)] = sensor.readings
            read = sensor.times - track.times[0] - late.sensor(sensor.name, name)
            times, readings = _merged(times, readings, read[read >= 0], column[read >= 0])
        made.append(Trajectory(name, begin.state, begin.controls, times, readings))
    return made


def _beginnings(problem: Problem, model: mujoco.MjModel, values: Values) -> Sequence[_Beginning]:
    match problem.protocol.name:
        case "playback":
            return [_of_recording(problem, model, values, one.request, one.target) for one in problem.prepared]
        case "motion" | "aligned":
            comparison = problem.evaluate(values)
            if comparison.divergence:
                raise EngineError(f"{comparison.divergence}; export other values")
            pairs = zip(problem.prepared, comparison.trials, strict=True)
            return [
                _of_swim(problem.robot, model, prepared.request, prepared.trial.cut(problem.horizon).track, compared)
                for prepared, compared in pairs
            ]
        case other:
            raise ArgumentError(f"protocol is '{other}'; swims for the toolbox need 'motion' or 'aligned'")


def _of_recording(
    problem: Problem, model: mujoco.MjModel, values: Values, rollout: Rollout, target: Target
) -> _Beginning:
    robot, track = problem.robot, rollout.trial.track
    simulator: Any = problem.simulator
    data, controls = simulator.begin(model, rollout, values)
    data.time = 0.0
    state = physics_state(model, data)
    rolled = roll(model, data, controls)
    if rolled.failed_at is not None:
        raise EngineError(
            f"trial '{rollout.trial.name}': the simulation diverged {rolled.failed_at:.3f} s after its start; "
            f"export other values"
        )
    times = track.times - track.times[0]
    positions = np.where(target.weights[:, :, None] > 0, track.positions, np.nan)
    if target.frame is None:
        return _Beginning(state, controls, times, positions, None)
    first = sampled(rolled.sensors, model.opt.timestep, times[times <= WINDOW])
    markers = first[:, -3 * len(robot.marker_names) :].reshape(len(first), -1, 3)
    return _Beginning(state, controls, times, positions, markers[:, :, list(robot.plane)])


def _of_swim(
    robot: Robot, model: mujoco.MjModel, swim: Swim, track: MarkerTrack, compared: ComparedTrial
) -> _Beginning:
    period, speed = swim.actuation.period, 2 * np.pi * swim.actuation.frequency
    stepper = Stepper(model, robot, swim.actuation.start_speed or 0.0, speed, 0.0)
    turns = np.ceil(SETTLING / period) + (compared.phase or 0.0) / (2 * np.pi)
    try:
        settled = run_to(None, stepper, period, turns)
    except DivergedError as error:
        raise EngineError(f"trial '{swim.name}': {error}; export other values") from error
    state = stepper.state
    state[0] = 0.0
    late = (settled.turns[-1] - turns) * period + stepper.timestep  # s after the first frame, a few steps
    times = track.times - track.times[0] - late
    positions = np.where(compared.weights[:, :, None] > 0, _registered(track, compared.registration), np.nan)
    positions, times = positions[times >= 0], times[times >= 0]
    beat = times[times <= period]
    begun = stepper.run(int(np.ceil(period / stepper.timestep)) + 1).markers
    simulated = sampled(begun.reshape(len(begun), -1), stepper.timestep, beat).reshape(len(beat), -1, 2)
    steps = int(np.ceil(times[-1] / stepper.timestep - 1e-9)) + 1
    return _Beginning(state, np.full((steps, model.nu), speed), times, positions, simulated)


def _registered(track: MarkerTrack, registration: Array) -> Array:
    """Positions without their static offsets in the body frame [m]. Shape (T, M, 2)."""
    axes = frames.body_axes(track.positions)[:, None]
    left = np.stack([-axes[..., 1], axes[..., 0]], axis=-1)
    return track.positions - registration[:, :1] * axes - registration[:, 1:] * left


def _marker_readings(robot: Robot, model: mujoco.MjModel, positions: Array) -> Array:
    """Readings of a video: the markers' coordinates in the plane of the camera, nothing else.

    Args:
        robot: Robot whose last sensors are its markers'.
        model: Compiled model of the robot.
        positions: Positions in the world, NaN where lost [m]. Shape (T, M, 2).

    Returns:
        Shape (T, nsensordata).
    """
    readings = np.full((len(positions), model.nsensordata), np.nan)
    count = len(robot.marker_names)
    markers = np.full((len(positions), count, 3), np.nan)
    markers[:, :, list(robot.plane)] = positions
    readings[:, model.nsensordata - 3 * count :] = markers.reshape(len(positions), 3 * count)
    return readings


def _placed(name: str, positions: Array, begun: Array) -> Array:
    """A track moved and turned as a whole, such that its first frames meet simulated ones.

    Args:
        name: Name of the trial.
        positions: Positions in the world of the camera, NaN where lost [m]. Shape (T, M, 2).
        begun: Simulated positions at the first K frames [m]. Shape (K, M, 2).

    Returns:
        Positions in the world of the simulation [m]. Shape (T, M, 2).

    Raises:
        TrialError: Too few markers are seen in these frames.
    """
    real, simulated = positions @ [1, 1j], begun @ [1, 1j]
    first = real[: len(simulated)]
    seen = np.isfinite(first)
    here, there = first[seen], simulated[seen]
    if len(here) < 2:
        raise TrialError(
            f"trial '{name}': fewer than two markers are seen in its first {len(simulated)} frames, so nothing tells "
            f"where it begins; cut the video"
        )
    turn = np.vdot(here - here.mean(), there - there.mean())
    moved = (real - here.mean()) * (turn / abs(turn)) + there.mean()
    return np.stack([moved.real, moved.imag], axis=-1)


def _merged(times: Array, readings: Array, more_times: Array, more: Array) -> tuple[Array, Array]:
    """Readings of two tables at the time stamps of both."""
    stamps = np.union1d(times, more_times)
    merged = np.full((len(stamps), readings.shape[1]), np.nan)
    for at, table in ((times, readings), (more_times, more)):
        rows = np.searchsorted(stamps, at)
        merged[rows] = np.where(np.isfinite(table), table, merged[rows])
    return stamps, merged
