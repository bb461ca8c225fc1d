"""The state of N robots as arrays, the batch of simulations that it is read from, and what a policy observes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from fluidstep.batch import Batch
from swim2real.rl.body import Bodies, Indices
from swim2real.rl.conditions import CONTROL_INTERVAL
from swimbase.arrays import Array

_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION
_ROUNDING = 1e-9  # intervals


@dataclass(frozen=True)
class RobotState:
    """N robots, seen by the camera, in the frame that each had at its start: x backward, y to the side.

    A robot without a frame is seen in the world, and its position, heading and their rates are 0. The position is that
    of the point that the floating body turns about. Every attribute is an array with a row per robot.

    Attributes:
        markers: The markers, then the further sites [m]. Shape (N, K, 2).
        marker_velocities: Their velocities [m/s]. Shape (N, K, 2).
        position: Position of the floating body [m]. Shape (N, 2).
        velocity: Its velocity [m/s]. Shape (N, 2).
        heading: Its heading, 0 at the start, without jumps [rad]. Shape (N,).
        turning: Rates at which it turns about the axes of the world [rad/s]. Shape (N, 3).
        heading_rate: Rate of the heading [rad/s]. Shape (N,).
        roll: Angle by which it leans toward the y side of its frame [rad]; an estimate doesn't know it. Shape (N,).
        motor_angles: Angles of the motors [rad]. Shape (N, P).
        motor_speeds: Their speeds [rad/s]. Shape (N, P).
        joint_angles: Positions of the other joints [rad or m]. Shape (N, J).
        joint_rates: Their rates [rad/s or m/s]. Shape (N, J).
        sensors: Readings of the robot's sensors. Shape (N, S).
        commands: Present commands of the actuators [unit]. Shape (N, A).
        previous_actions: Actions that led to them. Shape (N, A).
    """

    markers: Array
    marker_velocities: Array
    position: Array
    velocity: Array
    heading: Array
    turning: Array
    heading_rate: Array
    roll: Array
    motor_angles: Array
    motor_speeds: Array
    joint_angles: Array
    joint_rates: Array
    sensors: Array
    commands: Array
    previous_actions: Array

    @staticmethod
    def zeros(bodies: Bodies, count: int) -> RobotState:
        """A state of zeros."""
        layout, actuators = bodies.layout, len(bodies.actuators)
        k, p, j = layout.markers, layout.motors.shape[1], layout.joints.shape[1]
        shapes = [(k, 2), (k, 2), (2,), (2,), (), (3,), (), (), (p,), (p,), (j,), (j,),
                  (len(bodies.sensors),), (actuators,), (actuators,)]  # fmt: skip
        return RobotState(*(np.zeros((count, *shape)) for shape in shapes))


class Robots:
    """N robots, each with one of the parameter sets.

    Attributes:
        bodies: The compiled sets.
        state: True state, as last read.
        commanded: Commands of the last intervals, the present one first, of which late actuators follow an older one.
            Shape (N, D, A).
        measured: Readings of the robot's sensors at the ends of the last intervals, likewise. Shape (N, D, S).
    """

    def __init__(self, bodies: Bodies, count: int, threads: int = 1) -> None:
        """Makes robots that have not been started.

        Args:
            bodies: The compiled sets.
            count: Number of robots.
            threads: Threads that step them.
        """
        self.bodies, self.batch = bodies, Batch(bodies.models, count, threads, bodies.readers)
        self.state = RobotState.zeros(bodies, count)
        self._controls = np.zeros((count, bodies.steps, bodies.models[0].nu))
        # what is late by d follows the command before the present one for the first d of an interval, and so on
        since = np.arange(bodies.steps)[:, None] / bodies.steps
        late = bodies.control_delays[:, None] / CONTROL_INTERVAL
        self._older = np.ceil(np.maximum(late - since, 0.0) - _ROUNDING).astype(int)
        self._readings_late = bodies.sensor_delays / CONTROL_INTERVAL
        self.commanded = np.zeros((count, self._older.max(initial=0) + 1, len(bodies.actuators)))
        depth = int(np.ceil(self._readings_late.max(initial=0.0))) + 1
        self.measured = np.zeros((count, depth, len(bodies.sensors)))

    def start(self, index: int, member: int, phase: float) -> None:
        """Places a robot at rest at its start, to be read."""
        self.batch.start(index, member).qpos[:] = self.bodies.start(member, phase)
        self.state.heading[index] = 0.0
        self.state.commands[index] = self.state.previous_actions[index] = self.commanded[index] = 0.0

    def read(self, which: Indices) -> None:
        """Reads robots that were started."""
        self.batch.step(self._controls, 0, which)
        self.measured[which] = self.batch.sensors[which][:, None, self.bodies.sensors]
        self._decode()

    def advance(self, actions: Array, which: Indices | None = None) -> None:
        """Steps robots one control interval, and reads them.

        Args:
            actions: Actions from -1 to 1. Shape (N, A).
            which: Robots that are stepped; None for all.
        """
        state, rows = self.state, slice(None) if which is None else which
        state.commands[rows] = self.bodies.actuators.next_commands(state.commands[rows], actions[rows])
        state.previous_actions[rows] = actions[rows]
        self.commanded[rows, 1:], self.commanded[rows, 0] = self.commanded[rows, :-1], state.commands[rows]
        members = self.batch.members
        followed = np.take_along_axis(self.commanded, self._older[members], axis=1)
        self._controls[:, :, self.bodies.layout.controls] = followed
        self.batch.step(self._controls, self.bodies.steps, which)
        self.measured[rows, 1:] = self.measured[rows, :-1]
        self.measured[rows, 0] = self.batch.sensors[rows][:, self.bodies.sensors]
        self._decode()

    def physics(self, index: int) -> tuple[int, Array]:
        """Parameter set and state of the engine of one robot, to go on from."""
        member = int(self.batch.members[index])
        model = self.bodies.models[member]
        out = np.empty(mujoco.mj_stateSize(model, _PHYSICS))
        mujoco.mj_getState(model, self.batch.data(index), out, _PHYSICS)
        return member, out

    def restore(self, index: int, member: int, physics: Array) -> None:
        """Takes over what `physics` returned."""
        mujoco.mj_setState(self.bodies.models[member], self.batch.start(index, member), physics, _PHYSICS)

    def _decode(self) -> None:
        state, bodies, layout = self.state, self.bodies, self.bodies.layout
        qpos, qvel, sensors = self.batch.qpos, self.batch.qvel, self.batch.sensors
        count, floats = len(qpos), layout.frame is not None
        objects = layout.markers + floats
        seen = sensors[:, bodies.first : bodies.first + 6 * objects].reshape(count, 2, objects, 3)
        places, velocities = bodies.seen_from_start(seen[:, 0] - bodies.origin), bodies.seen_from_start(seen[:, 1])
        state.markers[:], state.marker_velocities[:] = places[:, : layout.markers], velocities[:, : layout.markers]
        if layout.frame is not None:
            state.position[:], state.velocity[:] = places[:, -1], velocities[:, -1]
            state.heading[:] = unwrapped(bodies.heading(places), state.heading)
            state.turning[:] = sensors[:, bodies.first + 6 * objects :][:, :3]
            state.heading_rate[:] = state.turning @ layout.normal
            x, y = bodies.seen_from_start(sensors[:, bodies.first + 6 * objects :][:, 3:6]).T
            state.roll[:] = np.arcsin(np.clip(np.cos(state.heading) * y - np.sin(state.heading) * x, -1.0, 1.0))
        state.motor_angles[:], state.motor_speeds[:] = qpos[:, layout.motors[0]], qvel[:, layout.motors[1]]
        state.joint_angles[:], state.joint_rates[:] = qpos[:, layout.joints[0]], qvel[:, layout.joints[1]]
        late = self._readings_late[self.batch.members][:, None]
        newer = late.astype(int)
        older = np.minimum(newer + 1, self.measured.shape[1] - 1)
        at, before = (np.take_along_axis(self.measured, place, axis=1)[:, 0] for place in (newer, older))
        state.sensors[:] = at + (late - newer)[:, 0] * (before - at)


def _wrapped(angles: Array) -> Array:
    """Angles between -π and π [rad]."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def unwrapped(angles: Array, before: Array) -> Array:
    """The same angles, less than half a turn from those before [rad]."""
    return before + _wrapped(angles - before)


MOST_PLACE, MOST_RATE = 100.0, 1000.0  # greatest distances [m] and speeds [m/s or rad/s] that can be believed
ANYTHING = 1e6  # of readings and commands, whose unit is the robot's own


@dataclass(frozen=True)
class Part:
    """A part of an observation.

    Attributes:
        read: Its numbers. RobotState to shape (N, k).
        bound: Greatest magnitude that can be believed; beyond it the simulation has diverged.
    """

    read: Callable[[RobotState], Array]
    bound: float


PARTS: Mapping[str, Part] = {
    "markers": Part(lambda s: s.markers.reshape(len(s.markers), -1), MOST_PLACE),
    "marker_velocities": Part(lambda s: s.marker_velocities.reshape(len(s.markers), -1), MOST_RATE),
    "position": Part(lambda s: s.position, MOST_PLACE),
    "heading": Part(lambda s: s.heading[:, None], MOST_PLACE),
    "heading_direction": Part(lambda s: np.column_stack([np.cos(s.heading), np.sin(s.heading)]), 1.0),
    "velocity": Part(lambda s: s.velocity, MOST_RATE),
    "heading_rate": Part(lambda s: s.heading_rate[:, None], MOST_RATE),
    "turning": Part(lambda s: s.turning, MOST_RATE),
    "motor_angles": Part(lambda s: _wrapped(s.motor_angles), np.pi),
    "motor_directions": Part(lambda s: np.concatenate([np.cos(s.motor_angles), np.sin(s.motor_angles)], axis=1), 1.0),
    "motor_speeds": Part(lambda s: s.motor_speeds, MOST_RATE),
    "joint_angles": Part(lambda s: s.joint_angles, MOST_PLACE),
    "joint_rates": Part(lambda s: s.joint_rates, MOST_RATE),
    "sensors": Part(lambda s: s.sensors, ANYTHING),
    "commands": Part(lambda s: s.commands, ANYTHING),
    "previous_actions": Part(lambda s: s.previous_actions, 1.0),
}
"""Parts by name, in SI units; what they hold is said at `RobotState`. `motor_angles` are between -π and π, and
`motor_directions` are their cosines, then their sines. Without motors that part has no numbers.
"""
