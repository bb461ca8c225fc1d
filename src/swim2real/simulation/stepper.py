"""One robot in the water, stepped by the engine: the only place that calls it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from swim2real.robots.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Chunk:
    """What a stretch of simulation gave.

    Attributes:
        markers: Positions before each step [m]. Shape (steps, M, 2).
        velocity: Root velocity in the plane before each step [m/s]. Shape (steps, 2).
        turns: Turns of the motor before each step. Shape (steps,).
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
    """A compiled robot whose motor turns at a constant speed."""

    def __init__(
        self, model: mujoco.MjModel, robot: Robot, speed: float, motor_speed: float, motor_angle: float
    ) -> None:
        """Everything at rest but the motor and the forward speed.

        Args:
            model: Compiled robot.
            robot: Whose model it is.
            speed: Forward speed at the start [m/s].
            motor_speed: [rad/s].
            motor_angle: At the start [rad].
        """
        self._model = model
        self._data = mujoco.MjData(model)
        self._markers = len(robot.marker_names)
        self._surge = [int(model.joint(name).dofadr[0]) for name in robot.surge_joints]
        motor = model.joint(robot.motor_joint)
        self._data.qpos[motor.qposadr[0]] = motor_angle
        self._data.qvel[motor.dofadr[0]] = motor_speed
        self._data.qvel[self._surge[0]] = -speed  # the robot points its head toward -x
        self._state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, self._data, self._state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._motor_speed = motor_speed
        self._velocity_columns = [1 + model.nq + dof for dof in self._surge]
        self._motor_column = 1 + int(motor.qposadr[0])
        self.timestep = float(model.opt.timestep)

    def push(self, velocity: Array) -> None:
        """Adds to the velocity of the whole robot in the plane [m/s]. Shape (2,)."""
        self._state[self._velocity_columns] += velocity

    def run(self, steps: int) -> Chunk:
        """Steps on from where the last chunk ended."""
        control = np.full((1, steps, 1), self._motor_speed)
        states, sensors = rollout.rollout(self._model, self._data, self._state[None], control, nstep=steps)
        states, sensors = states[0], sensors[0].reshape(steps, self._markers, 3)
        times = np.concatenate([self._state[:1], states[:, 0]])
        stalled = np.flatnonzero(np.diff(times) <= 0)  # after a warning the engine repeats its last state
        broken = np.flatnonzero(~np.isfinite(sensors).all(axis=(1, 2)))
        first_bad = min([*stalled[:1], *broken[:1]], default=None)
        before = np.concatenate([self._state[None], states[:-1]])
        failed_at = None if first_bad is None else float(times[first_bad])
        self._state = states[-1].copy()
        turns = before[:, self._motor_column] / (2 * np.pi)
        return Chunk(sensors[:, :, :2], before[:, self._velocity_columns], turns, failed_at)
