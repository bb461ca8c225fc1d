"""The fish as an MjSpec: a floating body, a motor turning a crank, two tendons and a tail of five hinged segments."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from swim2real.parameters import Values
from swim2real.robots.fish import geometry as g
from swim2real.robots.fish.parameters import FISH_SPACE, TAIL_SEGMENTS
from swim2real.robots.fish.response import fish_response
from swim2real.robots.fish.stages import FISH_PLAN
from swim2real.robots.robot import Robot, SteadySwims

MARKER_NAMES = tuple(f"M{i}" for i in range(9))
REST_MARKERS = np.array([[x, 0.0] for x in (0.0, 0.142, 0.357, 0.3765, 0.4065, 0.4385, 0.4675, 0.4885, 0.551)])
MARKER_HEIGHTS = np.array([0.05, 0.05, 0.1, 0.05, 0.05, 0.05, 0.05, 0.05, 0.1])  # dorsal and tail fin stand higher
REST_MARKERS.flags.writeable = MARKER_HEIGHTS.flags.writeable = False

DESCRIPTION = (
    "A robotic fish, 0.56 m long, that floats at the surface and is filmed from above. "
    "Its front two thirds, head and body, are stiff; behind them five short stiff segments on elastic hinges make a "
    "tail that ends in a thin, tall fin. "
    "A motor in the body turns at a steady speed; its two crank arms, half a turn apart, pull two tendons along the "
    "sides of the tail in turn, one beat a turn, and because the tendons swap sides between the third and the fourth "
    "segment the tail bends into an S. "
    "The nine markers stand on its midline from head to tail: M0 at the front of the head, M1 at its rear, M2 on the "
    "dorsal fin at the end of the stiff body, M3 to M7 one on each tail segment, just behind the tail joints 0 to 4, "
    "and M8 near the trailing edge of the tail fin. "
    "It swims head first, M0 in front, by the thrust of its beating tail."
)


def build_fish(values: Values) -> mujoco.MjSpec:
    """The fish for given parameter values.

    Args:
        values: All parameters of `FISH_SPACE` in SI.

    Returns:
        A spec ready to compile: bodies fish, motor and tail0 to tail4; a velocity actuator on the motor [rad/s];
        a site and a `framepos` sensor for each of the markers M0 to M8.

    Raises:
        ParameterError: A value is missing, unknown, not finite or out of bounds.
    """
    checked = FISH_SPACE.check(values)
    spec = _world()
    fluid = [checked[name] for name in FISH_SPACE.names[:5]]
    fish = _front(spec, fluid)
    _motor(fish, checked["motor_arm_length"], fluid)
    _tail(
        spec,
        fish,
        [checked[f"hinge_stiffness_{i}"] for i in range(TAIL_SEGMENTS)],
        [checked[f"hinge_damping_{i}"] for i in range(TAIL_SEGMENTS)],
        fluid,
    )
    _tendons(spec)
    spec.add_actuator(
        name="motor",
        target="motor",
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        gainprm=[g.MOTOR_GAIN, *[0.0] * 9],
        biasprm=[0.0, 0.0, -g.MOTOR_GAIN, *[0.0] * 7],
        ctrllimited=True,
        ctrlrange=[-g.MOTOR_SPEED_LIMIT, g.MOTOR_SPEED_LIMIT],
    )
    for name in MARKER_NAMES:
        spec.add_sensor(
            name=name, type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name
        )
    return spec


def _world() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = "fish"
    spec.compiler.degree = False
    spec.option.timestep = 0.001
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    spec.option.gravity = [0, 0, 0]
    spec.option.density = g.WATER_DENSITY
    spec.option.viscosity = g.WATER_VISCOSITY
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return spec


def _box(
    body: mujoco.MjsBody, half_size: Sequence[float], pos: Sequence[float], fluid: Sequence[float] | None = None,
    mass: float | None = None, density: float = g.PLA,
) -> None:  # fmt: skip
    """A box of a mass or a density, with ellipsoid fluid forces where coefficients are given."""
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half_size, pos=pos, contype=0, conaffinity=0)
    _finish(geom, fluid, mass, density)


def _fin(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, outline: np.ndarray, thickness: float,
    fluid: Sequence[float] | None = None, mass: float | None = None, density: float = g.PLA,
) -> None:  # fmt: skip
    vertices, faces = g.extrude(outline, thickness)
    spec.add_mesh(
        name=name, uservert=vertices.ravel(), userface=faces.ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
    )
    geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0)
    _finish(geom, fluid, mass, density)


def _finish(geom: mujoco.MjsGeom, fluid: Sequence[float] | None, mass: float | None, density: float) -> None:
    if mass is None:
        geom.density = density
    else:
        geom.mass = mass
    if fluid is not None:
        geom.fluid_ellipsoid = 1
        geom.fluid_coefs = fluid


def _hinge(
    body: mujoco.MjsBody, name: str, axis: Sequence[float], *, stiffness: float = 0.0, damping: float = 0.0,
    slide: bool = False, pos: Sequence[float] = (0.0, 0.0, 0.0), limit: float | None = None,
) -> None:  # fmt: skip
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE
    joint = body.add_joint(name=name, type=kind, axis=axis, pos=pos)
    if np.ndim(joint.stiffness):  # a polynomial's coefficients since MuJoCo 3.7
        joint.stiffness[0], joint.damping[0] = stiffness, damping
    else:
        joint.stiffness, joint.damping = stiffness, damping
    if limit is not None:
        joint.limited = True
        joint.range = [-limit, limit]


def _front(spec: mujoco.MjSpec, fluid: Sequence[float]) -> mujoco.MjsBody:
    """Head, electronics and rigid body, floating on the water."""
    fish = spec.worldbody.add_body(name="fish")
    for kind, axes in (("slide", "xyz"), ("hinge", "xyz")):
        for i, axis in enumerate(axes):
            held = {("slide", "z"): (500.0, 10.0), ("hinge", "x"): (10.0, 1.0), ("hinge", "y"): (10.0, 1.0)}
            stiffness, damping = held.get((kind, axis), (0.0, 0.0))
            _hinge(
                fish, f"{kind}_{axis}", np.eye(3)[i], stiffness=stiffness, damping=damping,
                slide=kind == "slide", pos=g.ROOT_ANCHOR,
            )  # fmt: skip
    _box(fish, [0.077, 0.0025, 0.05], [0, 0, 0], fluid, density=g.ACRYLIC)  # head plate
    _box(fish, [0.08, 0.02, 0.0015], [0.01, 0, 0.0515], density=g.ACRYLIC)  # head top plate
    _box(fish, [0.06, 0.04, 0.03], [0.005, 0, 0.083], mass=0.53)  # electronics, above the water
    _box(fish, [0.023, 0.015, 0.05], [0.1, 0, 0], fluid, mass=0.08)  # head attachment
    _box(fish, [0.0775, 0.01, 0.0525], [0.2005, 0, 0], fluid, mass=0.6)  # body
    _box(fish, [0.0035, 0.0005, 0.0375], [0.2815, 0, 0], fluid, mass=0.001)  # connector to the tail
    _fin(spec, fish, "dorsal_fin", g.DORSAL_FIN_OUTLINE, g.DORSAL_FIN_THICKNESS, density=g.ACRYLIC)
    for name, pos in (
        ("M0", [-0.077, 0, 0.05]),
        ("M1", [0.065, 0, 0.05]),
        ("left_fin_tip", [g.MOTOR_X, -0.0775, 0.05]),
        ("right_fin_tip", [g.MOTOR_X, 0.0775, 0.05]),
        ("M2", [0.28, 0, 0.1]),
    ):
        fish.add_site(name=name, pos=pos)
    return fish


def _motor(fish: mujoco.MjsBody, arm_length: float, fluid: Sequence[float]) -> None:
    """The shaft across the body with an arm at each end, half a turn apart."""
    motor = fish.add_body(name="motor", pos=[g.MOTOR_X, 0, 0])
    _hinge(motor, "motor", [0, 1, 0])
    _box(motor, [0.0075, 0.06, 0.0075], [0, 0, 0], fluid, mass=0.05)
    for side, sign in (("left", -1), ("right", 1)):
        _box(motor, [0.0075, 0.005, arm_length / 2], [0, sign * 0.055, sign * arm_length / 2], fluid)
        motor.add_site(name=f"motor_{side}", pos=[0, sign * 0.055, sign * (arm_length - 0.005)])


def _tail(
    spec: mujoco.MjSpec, fish: mujoco.MjsBody,
    stiffness: Sequence[float], damping: Sequence[float], fluid: Sequence[float],
) -> None:  # fmt: skip
    parent, parent_x = fish, 0.0
    for i, segment in enumerate(g.SEGMENTS):
        parent = parent.add_body(name=f"tail{i}", pos=[g.HINGE_X[i] - parent_x, 0, 0])
        parent_x = g.HINGE_X[i]
        _hinge(parent, f"tail{i}", [0, 0, 1], stiffness=stiffness[i], damping=damping[i], limit=g.JOINT_LIMIT)
        _segment(parent, i, segment, g.GAPS[i + 1], fluid)
    last = parent
    _box(last, [0.005, 0.0005, 0.0225], [0.023, 0, 0], fluid, mass=0.001)  # fin connector
    outline = g.mirrored(g.TAIL_FIN_OUTLINE)
    _fin(spec, last, "tail_fin", outline, g.TAIL_FIN_THICKNESS, fluid, mass=0.010)
    last.add_site(name="M8", pos=[0.073, 0, 0.1])


def _segment(body: mujoco.MjsBody, i: int, s: g.Segment, gap_behind: float, fluid: Sequence[float]) -> None:
    start = s.gap / 2
    _box(body, [s.gap / 4, 0.0005, s.front_height], [s.gap / 4, 0, 0], fluid, mass=0.001)
    _box(body, [g.PLATE_HALF_LENGTH, 0.0015, s.plate_height], [start + g.PLATE_HALF_LENGTH, 0, 0], fluid)
    tendon_x = start + 0.012
    for side, sign in (("left", -1), ("right", 1)):
        _box(body, [0.003, s.arm_width, 0.007], [tendon_x, sign * s.arm_y, 0], fluid)
        body.add_site(name=f"tail{i}_{side}", pos=[tendon_x, sign * s.tendon_y, 0])
    if s.rear_height:
        rear_x = start + g.SEGMENT_LENGTH + gap_behind / 4
        _box(body, [gap_behind / 4, 0.0005, s.rear_height], [rear_x, 0, 0], fluid, mass=0.001)
    body.add_site(name=f"M{3 + i}", pos=[s.marker_x, 0, 0.05])


def _tendons(spec: mujoco.MjSpec) -> None:
    """Two tendons that cross between segments 2 and 3, which bends the tail into an S."""
    for side, other in (("left", "right"), ("right", "left")):
        tendon = spec.add_tendon(name=side)
        if np.ndim(tendon.stiffness):
            tendon.stiffness[0], tendon.damping[0] = g.TENDON_STIFFNESS, g.TENDON_DAMPING
        else:
            tendon.stiffness, tendon.damping = g.TENDON_STIFFNESS, g.TENDON_DAMPING
        for site in (f"motor_{side}", *(f"tail{i}_{side if i < 3 else other}" for i in range(TAIL_SEGMENTS))):
            tendon.wrap_site(site)


FISH = Robot(
    name="fish",
    description=DESCRIPTION,
    space=FISH_SPACE,
    build=build_fish,
    marker_names=MARKER_NAMES,
    rest_markers=REST_MARKERS,
    marker_heights=MARKER_HEIGHTS,
    trials=SteadySwims(
        surge_joints=("slide_x", "slide_y"),
        motor_joint="motor",
        tail_markers=(6, 7, 8),
        response=fish_response(),
        fit_plan=FISH_PLAN,
    ),
)
