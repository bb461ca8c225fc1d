"""The robot that environments step: its layout, its models, compiled once and shared, and its state in the water.

All that the environments know of the fish's build is in `FISH_LAYOUT`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError, EngineError
from swim2real.parameters import Values
from swim2real.rl.conditions import CONTROL_INTERVAL, UNDISTURBED, Disturbances
from swim2real.robots.robot import Robot
from swim2real.simulation.fast_step import FastStep

Array = NDArray[np.float64]

_SLOW_TURN = math.pi / 2  # rad/s, of the motor when start postures are computed
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Layout:
    """Where the parts of a swimming robot are in its model, and which markers show them.

    The joints of the model are those of the root, the motor's, and those of the tail, in this order. The markers that a
    policy sees are those of the robot, along its midline, and two fin tips after them.

    Attributes:
        root_joints: Joints of the head: slides along x, y, z and hinges about them.
        tail_joints: Hinges of the tail, from front to back.
        midline_markers: Number of the robot's own markers.
        fin_tips: Sites at the tips of the left and the right fin.
        head_markers: Indices of the markers on the stiff front.
        tail_markers: Indices of the markers of the tail: one behind each hinge, and a last one behind the last.
        rubbing_tendon: Tendon that loses tension by friction.
    """

    root_joints: tuple[str, ...]
    tail_joints: tuple[str, ...]
    midline_markers: int
    fin_tips: tuple[str, str]
    head_markers: tuple[int, ...]
    tail_markers: slice
    rubbing_tendon: str

    @property
    def markers(self) -> int:
        """Number of markers that a policy sees."""
        return self.midline_markers + len(self.fin_tips)

    @property
    def tail_count(self) -> int:
        """Number of hinges of the tail."""
        return len(self.tail_joints)


FISH_LAYOUT = Layout(
    root_joints=("slide_x", "slide_y", "slide_z", "hinge_x", "hinge_y", "hinge_z"),
    tail_joints=("tail0", "tail1", "tail2", "tail3", "tail4"),
    midline_markers=9,
    fin_tips=("left_fin_tip", "right_fin_tip"),
    head_markers=(0, 1, 2, 9, 10),
    tail_markers=slice(3, 9),
    rubbing_tendon="left",
)

# places in the engine's qpos and qvel, as the order of joints has it
HEADING = FISH_LAYOUT.root_joints.index("hinge_z")
ROTATION = slice(3, 6)  # roll, pitch, heading
MOTOR = len(FISH_LAYOUT.root_joints)
TAIL = slice(MOTOR + 1, None)


class Body:
    """One parameter set, compiled: a model to step, without sensors, and one to compute markers with.

    Any number of threads may use it, each with data of its own.

    Attributes:
        model: Model that is stepped.
        sensor_model: The same robot with the markers' positions, then their velocities, as sensors.
        steps: Physics steps in a control interval.
        anchor: Point that the head turns about, in the robot at rest [m]. Shape (2,).
        rest_markers: Markers of the robot at rest, from the anchor [m]. Shape (markers, 2).
        rest_hinges: Distance of the tail's hinges behind the anchor in the robot at rest [m]. Shape (hinges,).
    """

    def __init__(self, robot: Robot, values: Values, disturbances: Disturbances = UNDISTURBED) -> None:
        """Compiles both models.

        Args:
            robot: Robot whose values they are.
            values: Parameter set.
            disturbances: Current and friction that are added.

        Raises:
            ParameterError: A value isn't allowed.
            ArgumentError: The robot isn't built as the environments need it.
        """
        layout = FISH_LAYOUT
        sites = (*robot.marker_names, *layout.fin_tips)
        self.model = _disturbed_spec(robot, values, disturbances).compile()
        with_sensors = _disturbed_spec(robot, values, disturbances)
        for kind in (mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMELINVEL):
            for name in sites:
                with_sensors.add_sensor(
                    name=f"{name}_{int(kind)}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name
                )
        self.sensor_model = with_sensors.compile()
        self.anchor = self.model.jnt_pos[0][:2].copy()
        rest = mujoco.MjData(self.sensor_model)
        mujoco.mj_kinematics(self.sensor_model, rest)
        self.rest_markers = np.array([rest.site(name).xpos[:2] for name in sites]) - self.anchor
        self.rest_hinges = rest.xanchor[TAIL, 0] - self.anchor[0]
        self.steps = round(CONTROL_INTERVAL / self.model.opt.timestep)
        joints = [self.model.joint(i).name for i in range(self.model.njnt)]
        known = [*layout.root_joints, robot.swims.motor_joint, *layout.tail_joints]
        if joints != known:
            raise ArgumentError(
                f"robot '{robot.name}' has the joints {', '.join(joints)}; the environments know "
                f"{', '.join(known)}, in this order"
            )
        self._fast = _fast_step(self.model, robot.name)
        self._postures: tuple[Array, Array] | None = None
        self._lock = Lock()

    def run(self, data: mujoco.MjData, speed: float) -> bool:
        """Steps one control interval at a motor speed [rad/s]; returns False when the simulation has diverged."""
        if self._fast is not None:
            return not self._fast.run(data, np.array([speed]), self.steps).failed
        before = data.time
        data.ctrl[0] = speed
        mujoco.mj_step(self.model, data, self.steps)
        return bool(data.time > before)  # the engine goes back to 0 after a warning

    def posture(self, angle: float) -> Array:
        """Angles of the tail's hinges at a motor angle [rad] when nothing moves [rad]. Shape (hinges,)."""
        if math.remainder(angle, math.tau) == 0:
            return np.zeros(FISH_LAYOUT.tail_count)
        with self._lock:
            if self._postures is None:
                self._postures = (self._slow_turn(_SLOW_TURN), self._slow_turn(-_SLOW_TURN))
        # what the water does to a slow tail is opposite in the two turns
        both = [[np.interp(angle, turn[:, 0], turn[:, i], period=math.tau) for i in range(1, turn.shape[1])]
                for turn in self._postures]  # fmt: skip
        return np.mean(both, axis=0)

    def _slow_turn(self, speed: float) -> Array:
        """Motor angle and tail angles through a slow turn, after a quarter of a turn. Shape (rows, 1 + hinges)."""
        data = mujoco.MjData(self.model)
        data.qvel[MOTOR] = speed
        rows: list[Array] = []
        for _ in range(round(1.25 * math.tau / abs(speed) / CONTROL_INTERVAL)):
            if not self.run(data, speed):
                return np.zeros((1, 1 + FISH_LAYOUT.tail_count))
            rows.append(data.qpos[MOTOR:].copy())
        return np.array(rows[len(rows) // 5 :])


class Bodies:
    """Parameter sets of one robot, each compiled when it is first needed.

    Attributes:
        robot: Robot whose sets they are.
        disturbances: Disturbances of all sets.
    """

    def __init__(
        self, robot: Robot, parameters: Values | Sequence[Values], disturbances: Disturbances = UNDISTURBED
    ) -> None:
        """Checks the values.

        Args:
            robot: Robot whose values they are.
            parameters: One set, or several to draw from.
            disturbances: Disturbances that are added to all sets.

        Raises:
            ParameterError: A value isn't allowed.
            ArgumentError: There is no set.
        """
        sets = [parameters] if isinstance(parameters, Mapping) else list(parameters)
        if not sets:
            raise ArgumentError("an ensemble of 0 parameter sets is given; environments need at least 1")
        self.robot, self.disturbances = robot, disturbances
        self._values = [robot.space.check(values, where=f"set {i}") for i, values in enumerate(sets)]
        self._compiled: dict[int, Body] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, index: int) -> Body:
        with self._lock:
            if index not in self._compiled:
                self._compiled[index] = Body(self.robot, self._values[index], self.disturbances)
            return self._compiled[index]


@dataclass
class BodyState:
    """The state of the robot, in the world frame: x points backward at the start, y to the side.

    The head is the stiff front of the robot. Its position is that of the point that it turns about, near the center of
    mass. The origin is where that point was at the start.

    Attributes:
        markers: The nine markers, then the left and the right fin tip [m]. Shape (M, 2).
        marker_velocities: Their velocities [m/s]. Shape (M, 2).
        position: Position of the head [m]. Shape (2,).
        velocity: Velocity of the head [m/s]. Shape (2,).
        heading: Heading of the head, 0 at the start [rad].
        turning: Rates of the head's roll, pitch and heading [rad/s]. Shape (3,).
        motor_angle: Angle of the motor [rad].
        motor_speed: Speed of the motor [rad/s].
        tail_angles: Angles of the five hinges [rad]. Shape (5,).
        tail_rates: Their rates [rad/s]. Shape (5,).
    """

    markers: Array = field(default_factory=lambda: np.zeros((FISH_LAYOUT.markers, 2)))
    marker_velocities: Array = field(default_factory=lambda: np.zeros((FISH_LAYOUT.markers, 2)))
    position: Array = field(default_factory=lambda: np.zeros(2))
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    turning: Array = field(default_factory=lambda: np.zeros(3))
    motor_angle: float = 0.0
    motor_speed: float = 0.0
    tail_angles: Array = field(default_factory=lambda: np.zeros(FISH_LAYOUT.tail_count))
    tail_rates: Array = field(default_factory=lambda: np.zeros(FISH_LAYOUT.tail_count))


class Swimmer:
    """One robot in the water.

    Attributes:
        body: Its compiled parameter set.
        data: State of the engine.
        state: Its true state, as last read.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.data = mujoco.MjData(body.model)
        self.state = BodyState()
        self._sensor_data = mujoco.MjData(body.sensor_model)

    def start(self, angle: float) -> None:
        """Places the robot at rest in the world, with the motor at an angle [rad]."""
        mujoco.mj_resetData(self.body.model, self.data)
        self.data.qpos[MOTOR] = angle
        self.data.qpos[TAIL] = self.body.posture(angle)

    def advance(self, speed: float) -> bool:
        """Swims one control interval at a motor speed [rad/s]; returns False when the simulation has diverged."""
        return self.body.run(self.data, speed)

    def read(self, markers: bool) -> BodyState:
        """Reads the state from the engine, with the markers only where they are needed."""
        state, qpos, qvel = self.state, self.data.qpos, self.data.qvel
        state.position[:] = qpos[:2]
        state.velocity[:] = qvel[:2]
        state.heading = float(qpos[HEADING])
        state.turning[:] = qvel[ROTATION]
        state.motor_angle, state.motor_speed = float(qpos[MOTOR]), float(qvel[MOTOR])
        state.tail_angles[:] = qpos[TAIL]
        state.tail_rates[:] = qvel[TAIL]
        if markers:
            model, data = self.body.sensor_model, self._sensor_data
            data.qpos[:] = qpos
            data.qvel[:] = qvel
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_sensorPos(model, data)
            mujoco.mj_sensorVel(model, data)
            sensed = data.sensordata.reshape(2, -1, 3)
            state.markers[:] = sensed[0, :, :2] - self.body.anchor
            state.marker_velocities[:] = sensed[1, :, :2]
        return state


def wrap_angle(angle: float) -> float:
    """An angle between -π and π."""
    return math.remainder(angle, math.tau)


def _disturbed_spec(robot: Robot, values: Values, disturbances: Disturbances) -> mujoco.MjSpec:
    spec = robot.build(values)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    spec.option.wind[:2] = disturbances.current
    if disturbances.tendon_friction:
        tendon, kept = spec.tendon(FISH_LAYOUT.rubbing_tendon), 1.0 - disturbances.tendon_friction
        if np.ndim(tendon.stiffness):  # a polynomial's coefficients since MuJoCo 3.7
            tendon.stiffness[0] *= kept
        else:
            tendon.stiffness *= kept
    return spec


def _fast_step(model: mujoco.MjModel, name: str) -> FastStep | None:
    try:
        return FastStep(model)
    except EngineError as error:
        _log.warning("robot '%s' swims with the engine's own step, which is slower: %s", name, error)
        return None
