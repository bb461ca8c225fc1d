"""Recordings as trajectories: much the same thing in both worlds."""

from __future__ import annotations

import mujoco
import numpy as np

from swim2real.calibration import Problem
from swim2real.errors import EngineError
from swim2real.objective import Target
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation import Rollout
from swim2real.simulation.playback import sampled, sensor_address
from swim2real.simulation.start import WINDOW
from swim2real.simulation.stepper import physics_state, roll
from swim2real.sysid.trajectory import Array, Trajectory, marker_readings, placed


def recording_trajectories(problem: Problem, values: Values) -> list[Trajectory]:
    """Each recording from its start on, which is found once, with given values.

    Where recordings are compared in a frame on the robot, the track is placed such that its first tenth of a second
    meets the simulated one.

    Args:
        problem: Recordings.
        values: Whose playback is begun.

    Raises:
        EngineError: The playback of these values diverges.
        TrialError: Nothing tells where a recording begins.
    """
    model = problem.robot.build(values).compile()
    return [_trajectory(problem, model, prepared.request, prepared.target) for prepared in problem.prepared]


def _trajectory(problem: Problem, model: mujoco.MjModel, rollout: Rollout, target: Target) -> Trajectory:
    robot, track = problem.robot, rollout.trial.track
    data, controls = problem.simulator.begin(model, rollout)
    data.time = 0.0
    state = physics_state(model, data)
    made = roll(model, data, controls)
    if made.failed_at is not None:
        raise EngineError(
            f"trial '{rollout.trial.name}': the simulation diverged {made.failed_at:.3f} s after its start; "
            f"export other values"
        )
    times = track.times - track.times[0]
    real = np.where(target.weights[:, :, None] > 0, track.positions, np.nan)
    if target.frame is not None:
        first = times[times <= WINDOW]
        real = placed(rollout.trial.name, real, _in_plane(robot, sampled(made.sensors, model.opt.timestep, first)))
    stamps, readings = times, marker_readings(robot, model, real)
    for sensor in target.sensors:
        column = np.full((len(sensor.times), model.nsensordata), np.nan)
        column[:, sensor_address(model, sensor.name)] = sensor.readings
        stamps, readings = _merged(stamps, readings, sensor.times - track.times[0], column)
    return Trajectory(rollout.trial.name, state, controls, stamps, readings)


def _in_plane(robot: Robot, sensors: Array) -> Array:
    """Shape (T, nsensordata) to (T, M, 2)."""
    markers = sensors[:, -3 * len(robot.marker_names) :].reshape(len(sensors), -1, 3)
    return markers[:, :, list(robot.plane)]


def _merged(times: Array, readings: Array, more_times: Array, more: Array) -> tuple[Array, Array]:
    """Readings of two tables at the time stamps of both."""
    stamps = np.union1d(times, more_times)
    merged = np.full((len(stamps), readings.shape[1]), np.nan)
    for at, table in ((times, readings), (more_times, more)):
        rows = np.searchsorted(stamps, at)
        merged[rows] = np.where(np.isfinite(table), table, merged[rows])
    return stamps, merged
