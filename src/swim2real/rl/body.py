"""The robot that environments step: compiled once for each parameter set, shared by all of them."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError, EngineError
from swim2real.parameters import Values
from swim2real.rl.disturbances import UNDISTURBED, Disturbances
from swim2real.rl.motor import CONTROL_INTERVAL
from swim2real.robots.robot import Robot

if TYPE_CHECKING:
    from swim2real.simulation.fast_step import FastStep

Array = NDArray[np.float64]

FIN_TIPS = ("left_fin_tip", "right_fin_tip")
ROOT = ("slide_x", "slide_y", "slide_z", "hinge_x", "hinge_y", "hinge_z")
TAIL = tuple(f"tail{i}" for i in range(5))
_SLOW_TURN = math.pi / 2  # rad/s, of the motor when start postures are found
_log = logging.getLogger(__name__)


class Body:
    """One parameter set, compiled: a model to step, without sensors, and one to look with.

    Any number of threads may use it, each with data of its own.

    Attributes:
        model: To step.
        eyes: The same robot with the markers' positions, then their velocities, as sensors.
        steps: Physics steps in a control interval.
        markers: Number of markers.
        anchor: The point that the head turns about, in the robot at rest [m]. Shape (2,).
        rest_markers: Of the robot at rest, from the anchor [m]. Shape (markers, 2).
        rest_hinges: Tail joints behind the anchor in the robot at rest [m]. Shape (5,).
    """

    def __init__(self, robot: Robot, values: Values, disturbances: Disturbances = UNDISTURBED) -> None:
        """Compiles.

        Raises:
            ParameterError: A value isn't allowed.
            ArgumentError: The robot isn't built as the environments need it.
        """
        names = (*robot.marker_names, *FIN_TIPS)
        self.model = _disturbed(robot, values, disturbances).compile()
        looking = _disturbed(robot, values, disturbances)
        for kind in (mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMELINVEL):
            for name in names:
                looking.add_sensor(
                    name=f"{name}_{int(kind)}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name
                )
        self.eyes = looking.compile()
        self.markers = len(names)
        self.anchor = self.model.jnt_pos[0][:2].copy()
        rest = mujoco.MjData(self.eyes)
        mujoco.mj_kinematics(self.eyes, rest)
        self.rest_markers = np.array([rest.site(name).xpos[:2] for name in names]) - self.anchor
        self.rest_hinges = rest.xanchor[7:, 0] - self.anchor[0]
        self.steps = round(CONTROL_INTERVAL / self.model.opt.timestep)
        joints = [self.model.joint(i).name for i in range(self.model.njnt)]
        if joints != [*ROOT, robot.swims.motor_joint, *TAIL]:
            raise ArgumentError(
                f"robot '{robot.name}' has the joints {', '.join(joints)}; the environments know "
                f"{', '.join([*ROOT, robot.swims.motor_joint, *TAIL])}, in this order"
            )
        self._fast = _planned(self.model, robot.name)
        self._postures: tuple[Array, Array] | None = None
        self._lock = Lock()

    def run(self, data: mujoco.MjData, speed: float) -> bool:
        """Steps one control interval at a motor speed [rad/s]; False when the simulation has diverged."""
        if self._fast is not None:
            return not self._fast.run(data, np.array([speed]), self.steps).failed
        before = data.time
        data.ctrl[0] = speed
        mujoco.mj_step(self.model, data, self.steps)
        return bool(data.time > before)  # the engine goes back to 0 after a warning

    def posture(self, angle: float) -> Array:
        """How the tail is bent at a motor angle [rad] when nothing moves: angles of its joints [rad]. Shape (5,)."""
        if math.remainder(angle, math.tau) == 0:
            return np.zeros(len(TAIL))
        with self._lock:
            if self._postures is None:
                self._postures = (self._slow_turn(_SLOW_TURN), self._slow_turn(-_SLOW_TURN))
        # what the water does to a slow tail is opposite in the two turns
        both = [[np.interp(angle, turn[:, 0], turn[:, i], period=math.tau) for i in range(1, 6)]
                for turn in self._postures]  # fmt: skip
        return np.mean(both, axis=0)

    def _slow_turn(self, speed: float) -> Array:
        """Motor angle and tail angles through a slow turn, after a quarter of one. Shape (rows, 6)."""
        data = mujoco.MjData(self.model)
        data.qvel[6] = speed
        rows: list[Array] = []
        for _ in range(round(1.25 * math.tau / abs(speed) / CONTROL_INTERVAL)):
            if not self.run(data, speed):
                return np.zeros((1, 1 + len(TAIL)))
            rows.append(data.qpos[6:].copy())
        return np.array(rows[len(rows) // 5 :])


class Bodies:
    """Parameter sets of one robot, each compiled when it is first needed."""

    def __init__(
        self, robot: Robot, parameters: Values | Sequence[Values], disturbances: Disturbances = UNDISTURBED
    ) -> None:
        """Checks the values.

        Args:
            robot: Whose values they are.
            parameters: One set, or several to draw from.
            disturbances: Added to all.

        Raises:
            ParameterError: A value isn't allowed.
            ArgumentError: There is no set.
        """
        sets = [parameters] if isinstance(parameters, Mapping) else list(parameters)
        if not sets:
            raise ArgumentError("an ensemble of 0 parameter sets is given; environments need at least 1")
        self.robot, self.disturbances = robot, disturbances
        self._values = [robot.space.check(values, where=f"set {i}") for i, values in enumerate(sets)]
        self._made: dict[int, Body] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, index: int) -> Body:
        with self._lock:
            if index not in self._made:
                self._made[index] = Body(self.robot, self._values[index], self.disturbances)
            return self._made[index]


def _disturbed(robot: Robot, values: Values, disturbances: Disturbances) -> mujoco.MjSpec:
    spec = robot.build(values)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    spec.option.wind[:2] = disturbances.current
    if disturbances.tendon_friction:
        tendon, kept = spec.tendon("left"), 1.0 - disturbances.tendon_friction
        if np.ndim(tendon.stiffness):  # a polynomial's coefficients since MuJoCo 3.7
            tendon.stiffness[0] *= kept
        else:
            tendon.stiffness *= kept
    return spec


def _planned(model: mujoco.MjModel, name: str) -> FastStep | None:
    try:
        from swim2real.simulation.fast_step import FastStep  # numba takes a while to import

        return FastStep(model)
    except (ImportError, EngineError) as error:
        _log.warning("robot '%s' swims with the engine's own step, which is slower: %s", name, error)
        return None
