"""The state as a camera's marker tracks tell it: with noise, late, and with speeds that are differences."""

from __future__ import annotations

import mujoco
import numpy as np

from swim2real.rl.body import Bodies, Indices
from swim2real.rl.conditions import CONTROL_INTERVAL, StateEstimate
from swim2real.rl.state import RobotState, unwrapped
from swim2real.simulation.pose import SCALAR
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

_SPREAD = 0.1  # rad or m, standard deviation of a joint's position before any marker is seen
_LEAST_NOISE = 0.0002  # m: markers above the floating body move that much when it rolls
_HELD = 1e-6  # rad: of what motors report
_LOAD = 0.005  # N·m or N, by which water pushes a floating body out of the plane, against the springs of its joints
_FREE = 1e3  # of the floating body in the plane
_ITERATIONS = 2


class StateEstimator:
    """Estimates the states of N robots from tracked markers.

    The pose is the most likely one: markers are as precise as the tracker's noise, the robot's joints are near their
    places at rest, motors are where they report, and the floating body leaves the plane as far as its springs let it:
    a hull rolls. Markers alone determine short joints badly: half a millimeter would make them zigzag.
    """

    def __init__(self, bodies: Bodies, estimate: StateEstimate, count: int) -> None:
        """Prepares the estimates.

        Args:
            bodies: The robot.
            estimate: Noise and delay of the tracker.
            count: Number of robots.

        Raises:
            ArgumentError: The robot has a joint that doesn't slide or turn about one axis.
        """
        model = bodies.readers[0]
        if not np.isin(model.jnt_type, SCALAR).all():
            raise ArgumentError(
                f"robot '{bodies.robot.name}' has free or ball joints; a tracked state is only known for robots whose "
                f"joints slide or turn about one axis"
            )
        self._bodies, self._estimate, layout = bodies, estimate, bodies.layout
        self.seen = RobotState.zeros(bodies, count)
        self._before = RobotState.zeros(bodies, count)
        self._looks = [_Look(reader, bodies) for reader in bodies.readers]
        self.frames = np.zeros((estimate.delay + 1, count, layout.markers, 2))
        self.qpos = np.zeros((count, model.nq))
        self.members = np.zeros(count, int)
        spreads = np.full(model.nv, _FREE)
        spreads[layout.joints[1]] = _SPREAD
        spreads[layout.motors[1]] = _HELD
        springs = np.reshape(model.jnt_stiffness, (model.njnt, -1))[model.dof_jntid[layout.held], 0]
        spreads[layout.held] = np.minimum(_LOAD / np.maximum(springs, _HELD), _SPREAD)
        self._certainty = 1 / spreads**2
        self._noise = max(estimate.noise, _LEAST_NOISE)

    def begin(self, index: int, member: int, state: RobotState, rng: np.random.Generator) -> None:
        """Begins an episode of one robot, which has rested where it is for as long as the delay."""
        self.members[index] = member
        self.qpos[index] = self._bodies.starts[member]
        self.qpos[index, self._bodies.layout.joints[0]] = state.joint_angles[index]
        for frame in self.frames:
            frame[index] = self._measured(state, index, rng)
        which = np.array([index])
        self.seen.heading[index] = 0.0
        self._fit(which, state)
        for name in ("marker_velocities", "velocity", "turning", "heading_rate", "joint_rates"):
            getattr(self.seen, name)[index] = 0.0

    def update(self, state: RobotState, which: Indices, rngs: list[np.random.Generator]) -> None:
        """Estimates some robots' states after a control interval, whose true states these are, into `seen`."""
        self.frames[:-1, which] = self.frames[1:, which]
        for index in map(int, which):
            self.frames[-1, index] = self._measured(state, index, rngs[index])
        seen, before = self.seen, self._before
        for name in ("markers", "position", "heading", "joint_angles"):
            getattr(before, name)[:] = getattr(seen, name)
        pose_before = self.qpos.copy()
        self._fit(which, state)
        seen.marker_velocities[which] = (seen.markers - before.markers)[which] / CONTROL_INTERVAL
        seen.velocity[which] = (seen.position - before.position)[which] / CONTROL_INTERVAL
        seen.heading_rate[which] = (seen.heading - before.heading)[which] / CONTROL_INTERVAL
        if self._bodies.layout.frame is not None:
            rates = (self.qpos - pose_before) / CONTROL_INTERVAL
            seen.turning[which] = [self._looks[self.members[i]].turning(rates[i], self.qpos[i]) for i in which]
        seen.joint_rates[which] = (seen.joint_angles - before.joint_angles)[which] / CONTROL_INTERVAL

    def _measured(self, state: RobotState, index: int, rng: np.random.Generator) -> Array:
        noise = rng.standard_normal(state.markers.shape[1:])
        return state.markers[index] + self._estimate.noise * noise

    def _fit(self, which: Indices, state: RobotState) -> None:
        """Fits poses to the oldest frame, and takes over what is reported without delay."""
        seen, layout, certainty = self.seen, self._bodies.layout, self._certainty
        wanted, starts = self.frames[0, which], self._bodies.starts[self.members[which]]
        self.qpos[which[:, None], layout.motors[0]] = state.motor_angles[which]
        expected = starts.copy()
        expected[:, layout.motors[0]] = state.motor_angles[which]
        for _ in range(_ITERATIONS):
            views = [self._looks[self.members[i]].at(self.qpos[i]) for i in which]
            places, slopes = np.array([view[0] for view in views]), np.array([view[1] for view in views])
            count = layout.markers
            missed = (wanted - places[:, :count]).reshape(len(which), -1)
            slope = slopes[:, :count].reshape(len(which), 2 * count, -1)
            matrix = slope.transpose(0, 2, 1) @ slope / self._noise**2 + np.diag(certainty)
            pull = (slope.transpose(0, 2, 1) @ missed[..., None])[..., 0] / self._noise**2
            pull += certainty * (expected - self.qpos[which])
            self.qpos[which] += np.linalg.solve(matrix, pull[..., None])[..., 0]
        seen.markers[which] = wanted
        if layout.frame is not None:
            places = np.array([self._looks[self.members[i]].places(self.qpos[i]) for i in which])
            seen.position[which] = places[:, -1]
            seen.heading[which] = unwrapped(self._bodies.heading(places), seen.heading[which])
        seen.joint_angles[which] = self.qpos[which[:, None], layout.joints[0]]
        for name in ("motor_angles", "motor_speeds", "sensors", "commands", "previous_actions"):
            getattr(seen, name)[which] = getattr(state, name)[which]


class _Look:
    """View of the markers and the floating body of one parameter set in a pose, as from the start."""

    def __init__(self, model: mujoco.MjModel, bodies: Bodies) -> None:
        self._model, self._data, self._bodies = model, mujoco.MjData(model), bodies
        self._sites = [int(model.site(name).id) for name in bodies.layout.sites]

    def places(self, qpos: Array) -> Array:
        """Places. Shape (K + 1, 2)."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._bodies.seen_from_start(self._data.site_xpos[self._sites] - self._bodies.origin)

    def turning(self, rates: Array, qpos: Array) -> Array:
        """Rates at which the floating body turns about the axes of the world, from those of the joints. Shape (3,)."""
        self.places(qpos)
        mujoco.mj_comPos(self._model, self._data)
        slope = np.zeros((3, self._model.nv))
        mujoco.mj_jacSite(self._model, self._data, None, slope, self._sites[-1])
        return slope @ rates

    def at(self, qpos: Array) -> tuple[Array, Array]:
        """Places and their derivatives by the joints' positions. Shapes (K + 1, 2) and (K + 1, 2, nv)."""
        places = self.places(qpos)
        mujoco.mj_comPos(self._model, self._data)
        slopes = np.zeros((len(self._sites), 3, self._model.nv))
        for slope, site in zip(slopes, self._sites, strict=True):
            mujoco.mj_jacSite(self._model, self._data, slope, None, site)
        return places, self._bodies.seen_from_start(slopes.swapaxes(1, 2)).swapaxes(1, 2)
