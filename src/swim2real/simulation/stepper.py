"""One robot in the water: where swims are stepped, by the fast step or by the engine's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.robots.robot import Robot
from swim2real.simulation.rolling import physics_state, roll

if TYPE_CHECKING:
    from swim2real.simulation.fast_step import FastStep

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Chunk:
    """What a stretch of simulation gave.

    Where the simulation failed, the fast step ends the arrays and the engine repeats its last state.

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
        self, model: mujoco.MjModel, robot: Robot, speed: float, motor_speed: float, motor_angle: float,
        fast: FastStep | None = None,
    ) -> None:  # fmt: skip
        """Everything at rest but the motor and the forward speed.

        Args:
            model: Compiled robot.
            robot: Whose model it is.
            speed: Forward speed at the start [m/s].
            motor_speed: [rad/s].
            motor_angle: At the start [rad].
            fast: Fast step of the model, which its swims share; without one the engine steps.
        """
        self._model, self._fast = model, fast
        self._data = mujoco.MjData(model)
        self._markers = len(robot.marker_names)
        self._surge = [int(model.joint(name).dofadr[0]) for name in robot.swims.surge_joints]
        motor = model.joint(robot.swims.motor_joint)
        self._motor = int(motor.qposadr[0])
        self._motor_speed = motor_speed
        self._data.qpos[self._motor] = motor_angle
        self._data.qvel[motor.dofadr[0]] = motor_speed
        self._data.qvel[self._surge[0]] = -speed  # the robot points its head toward -x
        self.timestep = float(model.opt.timestep)

    @property
    def state(self) -> Array:
        """Where the last chunk ended, as `physics_state` has it."""
        return physics_state(self._model, self._data)

    def push(self, velocity: Array) -> None:
        """Adds to the velocity of the whole robot in the plane [m/s]. Shape (2,)."""
        self._data.qvel[self._surge] += velocity

    def run(self, steps: int) -> Chunk:
        """Steps on from where the last chunk ended."""
        if self._fast is None:
            return self._run_engine(steps)
        made = self._fast.run(self._data, np.array([self._motor_speed]), steps)
        return self._chunk(made.sensors, made.qvel, made.qpos, float(self._data.time) if made.failed else None)

    def _run_engine(self, steps: int) -> Chunk:
        made = roll(self._model, self._data, np.full((steps, 1), self._motor_speed))
        return self._chunk(made.sensors, made.qvel, made.qpos, made.failed_at)

    def _chunk(self, sensors: Array, velocities: Array, positions: Array, failed_at: float | None) -> Chunk:
        markers = sensors.reshape(len(sensors), self._markers, 3)[:, :, :2]
        turns = positions[:, self._motor] / (2 * np.pi)
        return Chunk(markers, velocities[:, self._surge], turns, failed_at)
