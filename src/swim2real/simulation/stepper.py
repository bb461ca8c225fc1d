"""Stretches of simulation: any model with the engine's own steps, and a swimmer with the fast step or the engine's."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from fluidstep.engine import log_warnings
from fluidstep.step import FastStep
from swim2real.robots.robot import Robot
from swimbase.arrays import Array

PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
"""Time, positions, velocities and all else that the engine remembers."""


@dataclass(frozen=True)
class Rolled:
    """States and sensors before each of N steps; where the simulation failed the engine repeats its last state.

    Attributes:
        qpos: Shape (N, nq).
        qvel: Shape (N, nv).
        sensors: Shape (N, nsensordata).
        failed_at: Time since the first step at which the engine gave up [s]; None when it didn't.
    """

    qpos: Array
    qvel: Array
    sensors: Array
    failed_at: float | None


def physics_state(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Time, positions, velocities, activations and the like in a row, as the engine rolls out from. Shape (n,)."""
    state = np.empty(mujoco.mj_stateSize(model, PHYSICS))
    mujoco.mj_getState(model, data, state, PHYSICS)
    return state


def roll(model: mujoco.MjModel, data: mujoco.MjData, controls: Array) -> Rolled:
    """Steps without Python's lock; the data is left where the last step ended.

    Args:
        model: Compiled.
        data: Where to begin.
        controls: Controls of every step. Shape (N, nu).
    """
    log_warnings()
    state = physics_state(model, data)
    states, sensors = rollout.rollout(model, data, state[None], controls[None], nstep=len(controls))
    states, sensors = states[0], sensors[0]
    mujoco.mj_setState(model, data, states[-1], PHYSICS)
    before = np.concatenate([state[None], states[:-1]])
    stalled = np.flatnonzero(states[:, 0] <= before[:, 0])  # after a warning the engine repeats its last state
    broken = np.flatnonzero(~np.isfinite(sensors).all(axis=1))
    first_bad = min([*stalled[:1], *broken[:1]], default=None)
    failed_at = None if first_bad is None else float(before[first_bad, 0] - state[0])
    qpos = before[:, 1 : 1 + model.nq]
    return Rolled(qpos, before[:, 1 + model.nq : 1 + model.nq + model.nv], sensors, failed_at)


def roll_each(model: mujoco.MjModel, starts: Array, controls: Array) -> list[Array | None]:
    """Sensors before each step, from several states under the same controls; None where the simulation failed.

    Args:
        model: Compiled.
        starts: States, as `physics_state` has them. Shape (K, n).
        controls: Controls of every step. Shape (N, nu).

    Returns:
        K arrays of shape (N, nsensordata).
    """
    log_warnings()
    data = mujoco.MjData(model)
    states, sensors = rollout.rollout(model, data, starts, controls[None], nstep=len(controls))
    before = np.concatenate([starts[:, :1], states[:, :-1, 0]], axis=1)
    stepped = states[:, :, 0] > before
    return [one if stepped[i].all() and np.isfinite(one).all() else None for i, one in enumerate(sensors)]


@dataclass(frozen=True)
class Chunk:
    """Results of a stretch of simulation.

    Where the simulation failed, the fast step ends the arrays and the engine repeats its last state.

    Attributes:
        markers: Positions before each step [m]. Shape (steps, M, 2).
        velocity: Root velocity in the plane before each step [m/s]. Shape (steps, 2).
        turns: Turns of the motor, or beats of the servo, before each step. Shape (steps,).
        failed_at: Time since the start at which the engine gave up [s]; None when it didn't.
    """

    markers: Array
    velocity: Array
    turns: Array
    failed_at: float | None

    def then(self, later: Chunk) -> Chunk:
        """This stretch and the one that follows it."""
        return Chunk(
            np.concatenate([self.markers, later.markers]),
            np.concatenate([self.velocity, later.velocity]),
            np.concatenate([self.turns, later.turns]),
            later.failed_at if self.failed_at is None else self.failed_at,
        )


class Stepper:
    """A compiled robot whose motor turns at a constant speed, or whose servo swings at one frequency."""

    def __init__(
        self, model: mujoco.MjModel, robot: Robot, speed: float, motor_speed: float, motor_angle: float,
        fast: FastStep | None = None,
    ) -> None:  # fmt: skip
        """Everything at rest but the motor and the forward speed.

        Args:
            model: Compiled model of the robot.
            robot: The robot, whose trials are steady swims.
            speed: Forward speed at the start [m/s].
            motor_speed: Speed of the motor, or 2 pi times the frequency of the servo [rad/s].
            motor_angle: Angle of the motor, or phase of the servo, at the start [rad].
            fast: Fast step of the model, which its swims share; without one the engine steps.
        """
        self._model, self._fast = model, fast
        self._data = mujoco.MjData(model)
        self._markers = len(robot.marker_names)
        self._surge = [int(model.joint(name).dofadr[0]) for name in robot.swims.surge_joints]
        (self._drive,) = robot.trials.controls.values()
        self._speed, self._angle, self._motor = motor_speed, motor_angle, None
        if robot.swims.motor_joint is not None:
            motor = model.joint(robot.swims.motor_joint)
            self._motor = int(motor.qposadr[0])
            self._data.qpos[self._motor] = motor_angle
            self._data.qvel[motor.dofadr[0]] = motor_speed
        self._data.qvel[self._surge[0]] = -speed  # the robot points its head toward -x
        self.timestep = float(model.opt.timestep)

    @property
    def turns_begun(self) -> float:
        """Turns of the motor, or beats of the servo, with which it began."""
        return self._angle / (2 * np.pi)

    @property
    def state(self) -> Array:
        """State at the end of the last chunk, as `physics_state` has it."""
        return physics_state(self._model, self._data)

    def push(self, velocity: Array) -> None:
        """Adds to the velocity of the whole robot in the plane [m/s]. Shape (2,)."""
        self._data.qvel[self._surge] += velocity

    def controls(self, steps: int) -> Array:
        """Controls of the next steps. Shape (steps, 1)."""
        if self._motor is not None:
            return np.full((steps, 1), self._speed)
        times = float(self._data.time) + self.timestep * np.arange(steps, dtype=np.float64)
        return self._drive.commands(times, self._speed / (2 * np.pi), self._angle)[:, None]

    def turns(self, positions: Array, begun: float = 0.0) -> Array:
        """Turns of the motor, or beats of the servo, before steps from a time on [s]. Shape (N, nq) to (N,)."""
        if self._motor is not None:
            return positions[:, self._motor] / (2 * np.pi)
        return (self._speed * (begun + self.timestep * np.arange(len(positions), dtype=np.float64)) + self._angle) / (
            2 * np.pi
        )

    def run(self, steps: int) -> Chunk:
        """Steps on from where the last chunk ended."""
        controls, begun = self.controls(steps), float(self._data.time)
        if self._fast is None:
            made = roll(self._model, self._data, controls)
            failed_at = None if made.failed_at is None else begun + made.failed_at
        else:
            made = self._fast.run(self._data, controls, steps)
            failed_at = float(self._data.time) if made.failed else None
        markers = made.sensors.reshape(len(made.sensors), self._markers, 3)[:, :, :2]
        return Chunk(markers, made.qvel[:, self._surge], self.turns(made.qpos, begun), failed_at)
