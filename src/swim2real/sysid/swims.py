"""Steady swims as trajectories: the toolbox neither finds a steady cycle nor aligns, so both are done once, here."""

from __future__ import annotations

import mujoco
import numpy as np

from swim2real.calibration import Problem
from swim2real.errors import ArgumentError, EngineError
from swim2real.objective import ComparedTrial
from swim2real.parameters import Values
from swim2real.simulation.playback import sampled
from swim2real.simulation.simulator import SETTLING, Swim
from swim2real.simulation.steady import DivergedError, run_to
from swim2real.simulation.stepper import Stepper
from swim2real.sysid.trajectory import Array, Trajectory, marker_readings, placed
from swim2real.trials import MarkerTrack, frames


def swim_trajectories(problem: Problem, values: Values) -> list[Trajectory]:
    """Each trial from the steady swim of given values on, at its phase.

    The track is registered as these values register it, and placed such that its first beat meets the simulated one.

    Args:
        problem: Real trials, aligned.
        values: Whose swims begin the trajectories; others begin with a transient of their own.

    Raises:
        ArgumentError: The problem's protocol aligns nothing.
        EngineError: A swim of these values diverges.
        TrialError: Nothing tells where a trial begins.
    """
    if problem.protocol.name != "aligned":
        raise ArgumentError(f"protocol is '{problem.protocol.name}'; swims for the toolbox need 'aligned'")
    comparison = problem.evaluate(values)
    if comparison.divergence:
        raise EngineError(f"{comparison.divergence}; export other values")
    model = problem.robot.build(values).compile()
    return [
        _trajectory(problem, model, prepared.request, prepared.trial.cut(problem.horizon).track, compared)
        for prepared, compared in zip(problem.prepared, comparison.trials, strict=True)
    ]


def _trajectory(
    problem: Problem, model: mujoco.MjModel, swim: Swim, track: MarkerTrack, compared: ComparedTrial
) -> Trajectory:
    period, speed = swim.actuation.period, 2 * np.pi * swim.actuation.frequency
    stepper = Stepper(model, problem.robot, swim.actuation.start_speed or 0.0, speed, 0.0)
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
    real = placed(swim.name, positions, simulated)
    steps = int(np.ceil(times[-1] / stepper.timestep - 1e-9)) + 1
    controls = np.full((steps, model.nu), speed)
    return Trajectory(swim.name, state, controls, times, marker_readings(problem.robot, model, real))


def _registered(track: MarkerTrack, registration: Array) -> Array:
    """Positions without their static offsets in the body frame [m]. Shape (T, M, 2)."""
    axes = frames.body_axes(track.positions)[:, None]
    left = np.stack([-axes[..., 1], axes[..., 0]], axis=-1)
    return track.positions - registration[:, :1] * axes - registration[:, 1:] * left
