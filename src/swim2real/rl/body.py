"""The robot that policies command: its parts, found in its model, and its parameter sets, compiled for a batch."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from fluidstep.batch import Batch
from swim2real.parameters import Values
from swim2real.rl.conditions import CONTROL_INTERVAL, UNDISTURBED, Disturbances
from swim2real.robots.compiled import set_linear
from swim2real.robots.robot import CommandLimits, PolicySetup, Robot
from swim2real.simulation.playback import sensor_address
from swim2real.simulation.start import STARTS, start_at_keyframe
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

Indices = NDArray[np.int64]

ORIGIN = "policy:origin"  # site of the point that stands for where the robot is
_SENSOR = "policy:{}"
_SLOW_TURN = math.pi / 2  # rad/s, of the motor when start postures are computed
_ANGLES = 361  # of the motor, for which start postures are kept


def policy_setup(robot: Robot) -> PolicySetup:
    """Set-up of a robot's policies: commands and observations.

    Raises:
        ArgumentError: The robot's file doesn't say.
    """
    if robot.policy is not None:
        return robot.policy
    model = robot.model
    names = ", ".join(model.actuator(i).name for i in range(model.nu))
    raise ArgumentError(
        f"robot '{robot.name}' has no [policy] in its robot file; policies need [policy.actuators] with the limits of "
        f"each actuator that they command, of {names}: NAME = {{lower = ..., upper = ..., rate = ..., unit = ...}}"
    )


@dataclass(frozen=True)
class Actuators:
    """The actuators that a policy commands, in the order of the robot file.

    Attributes:
        names: Their names.
        units: Units of their commands.
        lower: Least commands [unit]. Shape (A,).
        upper: Greatest commands [unit]. Shape (A,).
        rate: Greatest changes [unit/s]. Shape (A,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: Array
    upper: Array
    rate: Array

    @staticmethod
    def of(limits: Mapping[str, CommandLimits]) -> Actuators:
        """The actuators with these limits."""
        each = limits.values()
        return Actuators(
            tuple(limits), tuple(one.unit for one in each), np.array([one.lower for one in each]),
            np.array([one.upper for one in each]), np.array([one.rate for one in each]),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.names)

    def next_commands(self, commands: Array, actions: Array) -> Array:
        """The commands that follow others, for actions from -1 to 1: from the commands, not from what was measured.

        So a recorded table of commands repeats what a policy did.
        """
        return np.clip(commands + actions * (self.rate * CONTROL_INTERVAL), self.lower, self.upper)


@dataclass(frozen=True)
class _Layout:
    """Layout of a robot's parts in its model.

    The floating body is the one that carries the first marker of the robot's frame, with all joints that lead to it. A
    motor is a hinge without a range that an actuator turns; the other joints are the robot's own.

    Attributes:
        plane: Axes of the world that the camera sees.
        normal: Toward the camera. Shape (3,).
        frame: Indices of the two markers that make the frame, x from the first to the second; None without one.
        seen: Sites that a policy sees: the markers, then further ones.
        motors: Places of the motors in qpos and qvel, two rows. Shape (2, P).
        joints: Places of the robot's own joints. Shape (2, J).
        held: Degrees of freedom of the floating body that don't move it in the plane. Shape (H,).
        controls: Places of the commanded actuators in the control. Shape (A,).
    """

    plane: tuple[int, int]
    normal: Array
    frame: tuple[int, int] | None
    seen: tuple[str, ...]
    motors: Indices
    joints: Indices
    held: Indices
    controls: Indices

    @property
    def sites(self) -> tuple[str, ...]:
        """Sites that are read: the seen ones, then the point that stands for the floating body, if there is one."""
        return self.seen if self.frame is None else (*self.seen, ORIGIN)

    @property
    def markers(self) -> int:
        """Number of sites that a policy sees."""
        return len(self.seen)


class Bodies:
    """A robot with one or several parameter sets, compiled.

    Attributes:
        robot: The robot.
        disturbances: What is added to all sets.
        actuators: Actuators that a policy commands.
        layout: Where its parts are.
        models: The sets to step, without sensors.
        readers: The same with sensors: the robot's own, then positions of what is seen and of the floating body, their
            velocities, the floating body's turning rates, and where what was toward the camera is now.
        first: Place of the first of these positions in the readings.
        sensors: Places of the robot's own sensors in the readings. Shape (S,).
        steps: Physics steps in a control interval.
        origin: Where the floating body is at the start [m]; 0 without a frame. Shape (3,).
        turned: Direction of the frame's x axis at the start [rad].
        starts: Positions at the start. Shape (B, nq).
        control_delays: By how much the actuators follow their commands later, as calibrated [s]. Shape (B, A).
        sensor_delays: By how much the sensors' readings are late [s]. Shape (B, S).
    """

    def __init__(
        self, robot: Robot, parameters: Values | Sequence[Values], disturbances: Disturbances = UNDISTURBED
    ) -> None:
        """Compiles the sets.

        Args:
            robot: Robot whose values they are.
            parameters: One set, or several to draw from.
            disturbances: Disturbances that are added to all.

        Raises:
            ParameterError: A value isn't allowed.
            ArgumentError: There is no set, or the robot isn't one that policies can command.
        """
        sets = [parameters] if isinstance(parameters, Mapping) else list(parameters)
        if not sets:
            raise ArgumentError("an ensemble of 0 parameter sets is given; environments need at least 1")
        setup = policy_setup(robot)
        self.robot, self.disturbances = robot, disturbances
        self.actuators = Actuators.of(setup.actuators)
        checked = [robot.space.check(values, where=f"set {i}") for i, values in enumerate(sets)]
        self.layout = _layout(robot, setup)
        self.models = [_disturbed(robot, values, disturbances).compile() for values in checked]
        self.readers = [_reader(robot, values, disturbances, self.layout) for values in checked]
        self.first = int(self.readers[0].sensor(_SENSOR.format(0)).adr[0])
        self.sensors = np.array([sensor_address(self.readers[0], one.name) for one in robot.trials.sensors], int)
        delays = [robot.delays_of(values) for values in checked]
        names = [sensor.name for sensor in robot.trials.sensors]
        # what is ahead of its command or of what it measures can't be simulated: it is on time
        self.control_delays = np.array([[max(d.of("control", n), 0.0) for n in self.actuators.names] for d in delays])
        self.sensor_delays = np.array([[max(d.of("sensor", n), 0.0) for n in names] for d in delays])
        timestep = self.models[0].opt.timestep
        self.steps = round(CONTROL_INTERVAL / timestep)
        if abs(self.steps * timestep - CONTROL_INTERVAL) > 1e-9:
            raise ArgumentError(
                f"the timestep of robot '{robot.name}' is {timestep:g} s; a whole number of steps must make the "
                f"control interval of {CONTROL_INTERVAL} s"
            )
        motor = robot.motor_joint
        if motor is None and disturbances.start_phase != (0.0, 0.0):
            raise ArgumentError(
                f"a start phase is given, but robot '{robot.name}' has no motor_joint to be at one; leave it out"
            )
        self._motor = None if motor is None else int(self.models[0].joint(motor).qposadr[0])
        self.starts = np.array([self._start(model) for model in self.models])
        data = mujoco.MjData(self.readers[0])
        data.qpos[:] = self.starts[0]
        mujoco.mj_forward(self.readers[0], data)
        self.origin, self.turned = np.zeros(3), 0.0
        if self.layout.frame is not None:
            seen = data.sensordata[self.first :][: 3 * self.layout.markers].reshape(-1, 3)[:, list(self.layout.plane)]
            x, y = seen[self.layout.frame[1]] - seen[self.layout.frame[0]]
            self.turned = math.atan2(y, x)
            self.origin = data.site(ORIGIN).xpos.copy()
        c, s = math.cos(self.turned), math.sin(self.turned)
        self._to_start = np.array([[c, -s], [s, c]])  # a row times it is seen in the frame at the start
        self._postures: dict[int, Array] = {}

    def seen_from_start(self, vectors: Array) -> Array:
        """Vectors in the world as the camera sees them, in the frame at the start. Shapes (..., 3) to (..., 2)."""
        return vectors[..., list(self.layout.plane)] @ self._to_start

    def heading(self, places: Array) -> Array:
        """Direction of the frame's x axis, from the places of the sites in the plane. Shapes (N, K, 2) to (N,)."""
        assert self.layout.frame is not None  # only a robot with one has a heading
        across = places[:, self.layout.frame[1]] - places[:, self.layout.frame[0]]
        return np.arctan2(across[:, 1], across[:, 0])

    def __len__(self) -> int:
        return len(self.models)

    def start(self, member: int, phase: float = 0.0) -> Array:
        """Positions at the start, at rest: with the motor at an angle [rad], and the joints where that holds them."""
        qpos = self.starts[member].copy()
        if self._motor is not None and math.remainder(phase, math.tau) != 0:
            qpos[self.layout.joints[0]] = self._posture(member, phase)
            qpos[self._motor] = phase
        return qpos

    def _start(self, model: mujoco.MjModel) -> Array:
        data, trials = mujoco.MjData(model), self.robot.trials
        if trials.start not in STARTS:
            start_at_keyframe(model, data, trials.start)
        return data.qpos.copy()

    def _posture(self, member: int, angle: float) -> Array:
        """Positions of the joints at a motor angle [rad] when nothing moves. Shape (J,)."""
        if member not in self._postures:
            # what the water does to slow joints is opposite in the two turns
            turns = [self._slow_turn(member, speed) for speed in (_SLOW_TURN, -_SLOW_TURN)]
            self._postures[member] = np.mean(turns, axis=0)
        table = self._postures[member]
        place = (angle % math.tau) / math.tau * (_ANGLES - 1)
        before = min(int(place), _ANGLES - 2)
        return table[before] + (place - before) * (table[before + 1] - table[before])

    def _slow_turn(self, member: int, speed: float) -> Array:
        """Positions of the joints at equal motor angles in a slow turn. Shape (_ANGLES, J)."""
        assert self._motor is not None  # only a robot with one is asked for
        batch = Batch([self.models[member]], 1)
        data = batch.start(0, 0)
        data.qpos[:] = self.starts[member]
        data.qvel[self.layout.motors[1]] = speed
        angles, rows = list[float](), list[Array]()
        for step in range(round(1.25 * math.tau / abs(speed) / CONTROL_INTERVAL)):
            batch.step(np.full((1, self.models[member].nu), speed), self.steps)
            if batch.failed[0]:
                return np.zeros((_ANGLES, self.layout.joints.shape[1]))
            if step * CONTROL_INTERVAL * abs(speed) > math.tau / 4:  # once it swings along
                angles.append(float(batch.qpos[0, self._motor]))
                rows.append(batch.qpos[0, self.layout.joints[0]])
        at, known = np.linspace(0.0, math.tau, _ANGLES), np.array(rows)
        return np.column_stack([np.interp(at, angles, known[:, j], period=math.tau) for j in range(known.shape[1])])


def _reader(robot: Robot, values: Values, disturbances: Disturbances, layout: _Layout) -> mujoco.MjModel:
    """The disturbed robot with sensors of what is seen, of the floating body, and its own that trials record."""
    spec = _disturbed(robot, values, disturbances, {sensor.name.partition("[")[0] for sensor in robot.trials.sensors})
    if layout.frame is not None:
        _add_origin(spec, layout)
    kinds = [mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMELINVEL]
    readings = [(kind, site) for kind in kinds for site in layout.sites]
    if layout.frame is not None:
        readings += [(mujoco.mjtSensor.mjSENS_FRAMEANGVEL, ORIGIN), (mujoco.mjtSensor.mjSENS_FRAMEZAXIS, ORIGIN)]
    for i, (kind, site) in enumerate(readings):
        spec.add_sensor(name=_SENSOR.format(i), type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)
    return spec.compile()


def _add_origin(spec: mujoco.MjSpec, layout: _Layout) -> None:
    """Adds a site at the point that the floating body turns about: its last hinge, or else its center of mass.

    Its z axis is toward the camera.
    """
    assert layout.frame is not None  # a robot without one floats nowhere
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    body = int(model.site(layout.seen[layout.frame[0]]).bodyid[0])
    back, upright, quat = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, data.xquat[body])
    mujoco.mju_quatZ2Vec(upright, layout.normal)
    mujoco.mju_mulQuat(quat, back, upright)
    hinges = [j for j in range(model.njnt) if model.jnt_bodyid[j] == body and int(model.jnt_type[j]) == _HINGE]
    place = model.jnt_pos[hinges[-1]] if hinges else model.body_ipos[body]
    spec.body(model.body(body).name).add_site(name=ORIGIN, pos=place, quat=quat)


_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def _disturbed(
    robot: Robot, values: Values, disturbances: Disturbances, sensors: Collection[str] = ()
) -> mujoco.MjSpec:
    """The disturbed robot, with these of its sensors."""
    spec = robot.build(values)
    for sensor in list(spec.sensors):
        if sensor.name not in sensors:
            spec.delete(sensor)
    spec.option.wind[:2] = disturbances.current
    if disturbances.tendon_friction:
        rubbing = policy_setup(robot).rubbing_tendon
        if rubbing is None:
            raise ArgumentError(
                f"tendon friction is {disturbances.tendon_friction:g}, but robot '{robot.name}' names no "
                f"'rubbing_tendon' in [policy] of its robot file; name one, or leave the friction out"
            )
        tendon, kept = spec.tendon(rubbing), 1.0 - disturbances.tendon_friction
        set_linear(tendon, "stiffness", kept * np.ravel(tendon.stiffness)[0])
    return spec


def _layout(robot: Robot, setup: PolicySetup) -> _Layout:
    spec = robot.build(robot.space.published)
    markers = [sensor.objname for sensor in spec.sensors[-len(robot.marker_names) :]]
    seen = (*markers, *setup.sites)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    frame, axes = robot.trials.frame, np.eye(3)[list(robot.plane)]
    normal = np.cross(*axes)
    root = set[int]()
    if frame is not None:
        body = int(model.site(seen[frame[0]]).bodyid[0])
        while body > 0:
            root |= {j for j in range(model.njnt) if model.jnt_bodyid[j] == body}
            body = int(model.body_parentid[body])
    driven = {int(model.actuator_trnid[i, 0]) for i in range(model.nu)
              if int(model.actuator_trntype[i]) == int(mujoco.mjtTrn.mjTRN_JOINT)}  # fmt: skip
    own = [j for j in range(model.njnt) if j not in root and int(model.jnt_type[j]) in (_HINGE, _SLIDE)]
    motors = [j for j in own if j in driven and int(model.jnt_type[j]) == _HINGE and not model.jnt_limited[j]]
    joints = [j for j in own if j not in motors]
    held = [
        int(model.jnt_dofadr[j]) for j in root
        if not (np.abs(data.xaxis[j] @ normal) > 0.5 if int(model.jnt_type[j]) == _HINGE
                else np.abs(axes @ data.xaxis[j]).max() > 0.5)
    ]  # fmt: skip
    motor = robot.motor_joint
    if motor is not None and [model.joint(j).name for j in motors] != [motor]:
        raise ArgumentError(
            f"the actuator of robot '{robot.name}' must turn its motor_joint '{motor}', a hinge without a range"
        )
    names = [model.actuator(i).name for i in range(model.nu)]
    return _Layout(
        plane=robot.plane, normal=normal, frame=frame, seen=seen, motors=_places(model, motors),
        joints=_places(model, joints),
        held=np.array(sorted(held), int), controls=np.array([names.index(name) for name in setup.actuators]),
    )  # fmt: skip


def _places(model: mujoco.MjModel, joints: list[int]) -> Indices:
    return np.array([[model.jnt_qposadr[j] for j in joints], [model.jnt_dofadr[j] for j in joints]], int)
