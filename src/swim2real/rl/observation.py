"""What is known of the robot at one instant, and how a camera's markers tell it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.rl.body import Body

Array = NDArray[np.float64]


@dataclass
class Reading:
    """The state of the robot, in the world frame: x points backward at the start, y to the side.

    The head is the stiff front of the robot. Its place is that of the point that it turns about, near the center of
    mass. The origin is where that was at the start.

    Attributes:
        markers: The nine markers, then the left and the right fin tip [m]. Shape (M, 2).
        marker_velocities: [m/s]. Shape (M, 2).
        position: Of the head [m]. Shape (2,).
        velocity: Of the head [m/s]. Shape (2,).
        heading: Of the head, 0 at the start [rad].
        turning: Rates of the head's roll, pitch and heading [rad/s]. Shape (3,).
        motor_angle: [rad].
        motor_speed: [rad/s].
        tail_angles: Of the five joints [rad]. Shape (5,).
        tail_rates: [rad/s]. Shape (5,).
    """

    markers: Array = field(default_factory=lambda: np.zeros((11, 2)))
    marker_velocities: Array = field(default_factory=lambda: np.zeros((11, 2)))
    position: Array = field(default_factory=lambda: np.zeros(2))
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    turning: Array = field(default_factory=lambda: np.zeros(3))
    motor_angle: float = 0.0
    motor_speed: float = 0.0
    tail_angles: Array = field(default_factory=lambda: np.zeros(5))
    tail_rates: Array = field(default_factory=lambda: np.zeros(5))


class Swimmer:
    """One robot in the water, and the reading of its true state."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.data = mujoco.MjData(body.model)
        self._eyes = mujoco.MjData(body.eyes)
        self.reading = Reading()

    def start(self, angle: float) -> None:
        """At rest in the world, the motor at an angle [rad]."""
        mujoco.mj_resetData(self.body.model, self.data)
        self.data.qpos[6] = angle
        self.data.qpos[7:] = self.body.posture(angle)

    def advance(self, speed: float) -> bool:
        """Swims one control interval at a motor speed [rad/s]; False when the simulation has diverged."""
        return self.body.run(self.data, speed)

    def read(self, markers: bool) -> Reading:
        """Reads the state; the markers only when they are asked for."""
        reading, qpos, qvel = self.reading, self.data.qpos, self.data.qvel
        reading.position[:] = qpos[:2]
        reading.velocity[:] = qvel[:2]
        reading.heading = float(qpos[5])
        reading.turning[:] = qvel[3:6]
        reading.motor_angle, reading.motor_speed = float(qpos[6]), float(qvel[6])
        reading.tail_angles[:] = qpos[7:]
        reading.tail_rates[:] = qvel[7:]
        if markers:
            model, eyes = self.body.eyes, self._eyes
            eyes.qpos[:] = qpos
            eyes.qvel[:] = qvel
            mujoco.mj_kinematics(model, eyes)
            mujoco.mj_comPos(model, eyes)
            mujoco.mj_comVel(model, eyes)
            mujoco.mj_sensorPos(model, eyes)
            mujoco.mj_sensorVel(model, eyes)
            seen = eyes.sensordata.reshape(2, self.body.markers, 3)
            reading.markers[:] = seen[0, :, :2] - self.body.anchor
            reading.marker_velocities[:] = seen[1, :, :2]
        return reading


def wrapped(angle: float) -> float:
    """An angle between -π and π."""
    return math.remainder(angle, math.tau)
