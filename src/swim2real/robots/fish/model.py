"""The fish's bodies: a floating head, a motor that turns a crank, two tendons and a tail of five hinged segments.

Facts of the hardware and of the published simulator of it (prior work [michelis2026simple]): lengths [m], masses [kg],
densities [kg/m³]; x from head to tail, z up. What is calibrated isn't here: `fish.toml` writes it. The outlines of the
fins, in the frame of their body, are tables of height, leading edge and trailing edge [m].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.robots.compiled import set_linear

_WATER_DENSITY = 1000.0
_WATER_VISCOSITY = 0.0013  # Pa·s
_ACRYLIC = 1180.0
_PLA = 1250.0

_ROOT_ANCHOR = (0.02456792, 0.0, 0.00080073)
_MOTOR_X = 0.1655
_BODY_END_X = 0.278
_PLATE_HALF_LENGTH = 0.0075
_JOINT_LIMIT = np.deg2rad(80.0)
_TENDON_STIFFNESS = 20000.0  # N/m
_TENDON_DAMPING = 10.0  # N·s/m
_MOTOR_GAIN = 100.0  # N·m·s/rad
_MOTOR_SPEED_LIMIT = 10 * np.pi  # rad/s


@dataclass(frozen=True)
class _Segment:
    """One tail segment: gap in front, then half heights and sideways positions of its parts [m]."""

    gap: float
    front_height: float
    plate_height: float
    arm_width: float
    arm_y: float
    tendon_y: float
    rear_height: float
    marker_x: float


_SEGMENTS = (
    _Segment(0.014, 0.0375, 0.0500, 0.02425, 0.02575, 0.045, 0.0350, 0.0145),
    _Segment(0.015, 0.0350, 0.0475, 0.01925, 0.02075, 0.035, 0.0325, 0.0150),
    _Segment(0.017, 0.0325, 0.0450, 0.01425, 0.01575, 0.025, 0.0300, 0.0160),
    _Segment(0.014, 0.0300, 0.0425, 0.00925, 0.01075, 0.015, 0.0275, 0.0145),
    _Segment(0.006, 0.0275, 0.0400, 0.00425, 0.00575, 0.005, 0.0000, 0.0105),
)
_FIN_GAP = 0.010  # behind the last segment
_SEGMENT_LENGTH = 2 * _PLATE_HALF_LENGTH
_GAPS = (*(s.gap for s in _SEGMENTS), _FIN_GAP)
# each hinge sits in the middle of its gap
_HINGE_X = tuple(
    float(_BODY_END_X + sum(_GAPS[:i]) + i * _SEGMENT_LENGTH + _GAPS[i] / 2) for i in range(len(_SEGMENTS))
)

_TAIL_FIN_THICKNESS = 0.002
_DORSAL_FIN_THICKNESS = 0.003

_WET = "wet"  # default class of the parts that feel the water


def fish_model(hinges: str = "xyz") -> mujoco.MjSpec:
    """The fish with an arm of no length and without any parameter's value.

    Args:
        hinges: Order of the hinges on which the hull turns, the first about an axis of the world.

    Returns:
        A spec with bodies fish, motor and tail0 to tail4, a velocity actuator on the motor [rad/s], and sites M0 to M8.
    """
    spec = _world()
    spec.add_default(_WET, spec.default)
    fish = _front(spec, hinges)
    _motor(spec, fish)
    _tail(spec, fish)
    _tendons(spec)
    spec.add_actuator(
        name="motor",
        target="motor",
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        gainprm=[_MOTOR_GAIN, *[0.0] * 9],
        biasprm=[0.0, 0.0, -_MOTOR_GAIN, *[0.0] * 7],
        ctrllimited=True,
        ctrlrange=[-_MOTOR_SPEED_LIMIT, _MOTOR_SPEED_LIMIT],
    )
    return spec


def rolling_model() -> mujoco.MjSpec:
    """The fish as `extended_model` makes it, free to roll about its own long axis.

    Its hinges have the order z, y, x, so that roll stays roll when the course turns. Names of the tail's wet parts
    begin with `wet_tail`, so that it can have coefficients of its own: MuJoCo's angular and slender drag grow with the
    whole spin, and with the hull's coefficients the tail's yaw would damp the hull's roll.
    """
    spec = extended_model("zyx")
    for i in range(len(_SEGMENTS)):
        for k, geom in enumerate(spec.body(f"tail{i}").geoms):
            if geom.fluid_ellipsoid:
                geom.name = f"wet_tail{i}_{k}"
    return spec


def extended_model(hinges: str = "xyz") -> mujoco.MjSpec:
    """The fish with water at the middles of its two stiff plates that the hull accelerates, of no mass so far.

    MuJoCo's ellipsoid forces depend on velocities alone; a body in water also accelerates water with it.

    Args:
        hinges: As for `fish_model`.

    Returns:
        A spec as `fish_model` makes it, with geoms `water_head` and `water_body`.
    """
    spec = fish_model(hinges)
    for name, x in (("water_head", 0.0), ("water_body", 0.2005)):
        spec.body("fish").add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.002, 0, 0], pos=[x, 0, 0], mass=0.0, contype=0,
            conaffinity=0,
        )  # fmt: skip
    return spec


def _world() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = "fish"
    spec.compiler.degree = False
    spec.option.timestep = 0.001
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    spec.option.gravity = [0, 0, 0]
    spec.option.density = _WATER_DENSITY
    spec.option.viscosity = _WATER_VISCOSITY
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return spec


def _box(
    body: mujoco.MjsBody, half_size: Sequence[float], pos: Sequence[float], wet: mujoco.MjsDefault | None = None,
    mass: float | None = None, density: float = _PLA, name: str = "",
) -> None:  # fmt: skip
    """A box of a mass or a density, with ellipsoid wet forces where it is wet."""
    geom = body.add_geom(
        wet, name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half_size, pos=pos, contype=0, conaffinity=0
    )
    _finish(geom, wet is not None, mass, density)


def _fin(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, outline: np.ndarray, thickness: float,
    wet: mujoco.MjsDefault | None = None, mass: float | None = None, density: float = _PLA,
) -> None:  # fmt: skip
    vertices, faces = extrude(outline, thickness)
    spec.add_mesh(
        name=name, uservert=vertices.ravel(), userface=faces.ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
    )
    geom = body.add_geom(wet, name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0)
    _finish(geom, wet is not None, mass, density)


def _finish(geom: mujoco.MjsGeom, wet: bool, mass: float | None, density: float) -> None:
    if mass is None:
        geom.density = density
    else:
        geom.mass = mass
    geom.fluid_ellipsoid = int(wet)


def _hinge(
    body: mujoco.MjsBody, name: str, axis: Sequence[float], *, stiffness: float = 0.0, damping: float = 0.0,
    slide: bool = False, pos: Sequence[float] = (0.0, 0.0, 0.0), limit: float | None = None,
) -> None:  # fmt: skip
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE
    joint = body.add_joint(name=name, type=kind, axis=axis, pos=pos)
    set_linear(joint, "stiffness", stiffness)
    set_linear(joint, "damping", damping)
    if limit is not None:
        joint.limited = True
        joint.range = [-limit, limit]


def _front(spec: mujoco.MjSpec, hinges: str) -> mujoco.MjsBody:
    """Head, electronics and rigid body, floating on the water."""
    wet = spec.find_default(_WET)
    fish = spec.worldbody.add_body(name="fish")
    for kind, axes in (("slide", "xyz"), ("hinge", hinges)):
        for axis in axes:
            held = {("slide", "z"): (500.0, 10.0), ("hinge", "x"): (10.0, 1.0), ("hinge", "y"): (10.0, 1.0)}
            stiffness, damping = held.get((kind, axis), (0.0, 0.0))
            _hinge(
                fish, f"{kind}_{axis}", np.eye(3)["xyz".index(axis)], stiffness=stiffness, damping=damping,
                slide=kind == "slide", pos=_ROOT_ANCHOR,
            )  # fmt: skip
    _box(fish, [0.077, 0.0025, 0.05], [0, 0, 0], wet, density=_ACRYLIC)  # head plate
    _box(fish, [0.08, 0.02, 0.0015], [0.01, 0, 0.0515], density=_ACRYLIC)  # head top plate
    _box(fish, [0.06, 0.04, 0.03], [0.005, 0, 0.083], mass=0.53)  # electronics, above the water
    _box(fish, [0.023, 0.015, 0.05], [0.1, 0, 0], wet, mass=0.08)  # head attachment
    _box(fish, [0.0775, 0.01, 0.0525], [0.2005, 0, 0], wet, mass=0.6)  # body
    _box(fish, [0.0035, 0.0005, 0.0375], [0.2815, 0, 0], wet, mass=0.001)  # connector to the tail
    _fin(spec, fish, "dorsal_fin", outline_of("dorsal_fin"), _DORSAL_FIN_THICKNESS, density=_ACRYLIC)
    for name, pos in (
        ("M0", [-0.077, 0, 0.05]),
        ("M1", [0.065, 0, 0.05]),
        ("left_fin_tip", [_MOTOR_X, -0.0775, 0.05]),
        ("right_fin_tip", [_MOTOR_X, 0.0775, 0.05]),
        ("M2", [0.28, 0, 0.1]),
    ):
        fish.add_site(name=name, pos=pos)
    return fish


def _motor(spec: mujoco.MjSpec, fish: mujoco.MjsBody) -> None:
    """The shaft across the body with an arm at each end, half a turn apart; `fish.toml` says how long the arms are."""
    wet = spec.find_default(_WET)
    motor = fish.add_body(name="motor", pos=[_MOTOR_X, 0, 0])
    _hinge(motor, "motor", [0, 1, 0])
    _box(motor, [0.0075, 0.06, 0.0075], [0, 0, 0], wet, mass=0.05)
    for side, sign in (("left", -1), ("right", 1)):
        _box(motor, [0.0075, 0.005, 0.0], [0, sign * 0.055, 0], wet, name=f"arm_{side}")
        motor.add_site(name=f"motor_{side}", pos=[0, sign * 0.055, 0])


def _tail(spec: mujoco.MjSpec, fish: mujoco.MjsBody) -> None:
    wet = spec.find_default(_WET)
    parent, parent_x = fish, 0.0
    for i, segment in enumerate(_SEGMENTS):
        parent = parent.add_body(name=f"tail{i}", pos=[_HINGE_X[i] - parent_x, 0, 0])
        parent_x = _HINGE_X[i]
        _hinge(parent, f"tail{i}", [0, 0, 1], limit=_JOINT_LIMIT)
        _segment(parent, i, segment, _GAPS[i + 1], wet)
    last = parent
    _box(last, [0.005, 0.0005, 0.0225], [0.023, 0, 0], wet, mass=0.001)  # fin connector
    outline = mirrored(outline_of("tail_fin"))
    _fin(spec, last, "tail_fin", outline, _TAIL_FIN_THICKNESS, wet, mass=0.010)
    last.add_site(name="M8", pos=[0.073, 0, 0.1])


def _segment(body: mujoco.MjsBody, i: int, s: _Segment, gap_behind: float, wet: mujoco.MjsDefault) -> None:
    start = s.gap / 2
    _box(body, [s.gap / 4, 0.0005, s.front_height], [s.gap / 4, 0, 0], wet, mass=0.001)
    _box(body, [_PLATE_HALF_LENGTH, 0.0015, s.plate_height], [start + _PLATE_HALF_LENGTH, 0, 0], wet)
    tendon_x = start + 0.012
    for side, sign in (("left", -1), ("right", 1)):
        _box(body, [0.003, s.arm_width, 0.007], [tendon_x, sign * s.arm_y, 0], wet)
        body.add_site(name=f"tail{i}_{side}", pos=[tendon_x, sign * s.tendon_y, 0])
    if s.rear_height:
        rear_x = start + _SEGMENT_LENGTH + gap_behind / 4
        _box(body, [gap_behind / 4, 0.0005, s.rear_height], [rear_x, 0, 0], wet, mass=0.001)
    body.add_site(name=f"M{3 + i}", pos=[s.marker_x, 0, 0.05])


def _tendons(spec: mujoco.MjSpec) -> None:
    """Two tendons that cross between segments 2 and 3, which bends the tail into an S."""
    for side, other in (("left", "right"), ("right", "left")):
        tendon = spec.add_tendon(name=side)
        if np.ndim(tendon.stiffness):
            tendon.stiffness[0], tendon.damping[0] = _TENDON_STIFFNESS, _TENDON_DAMPING
        else:
            tendon.stiffness, tendon.damping = _TENDON_STIFFNESS, _TENDON_DAMPING
        for site in (f"motor_{side}", *(f"tail{i}_{side if i < 3 else other}" for i in range(len(_SEGMENTS)))):
            tendon.wrap_site(site)


def outline_of(fin: str) -> NDArray[np.float64]:
    """Height, leading x and trailing x of a fin's side view [m]. Shape (N, 3)."""
    with (resources.files("swim2real.robots.fish") / f"{fin}.csv").open("rb") as table:
        return np.loadtxt(table, delimiter=",")


def extrude(outline: NDArray[np.float64], thickness: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A plate with a given side view.

    Args:
        outline: Height, leading x and trailing x [m]. Shape (N, 3), heights rising.
        thickness: Along y [m].

    Returns:
        Vertices, shape (4 N, 3) [m], and triangles, shape (8 N - 4, 3), a closed surface with outward normals.
    """
    z, lead, trail = outline.T
    half = np.full_like(z, thickness / 2)
    corners = [(lead, -half), (trail, -half), (trail, half), (lead, half)]  # a ring per height, seen from above
    vertices = np.stack([np.stack([x, y, z], axis=1) for x, y in corners], axis=1).reshape(-1, 3)
    rings = 4 * np.arange(len(z) - 1)[:, None]
    sides = [
        rings + np.array(triangle)
        for i, j in ((0, 1), (1, 2), (2, 3), (3, 0))
        for triangle in ([i, j, j + 4], [i, j + 4, i + 4])
    ]
    top = 4 * (len(z) - 1)
    caps = np.array([[0, 2, 1], [0, 3, 2], [top, top + 1, top + 2], [top, top + 2, top + 3]])
    return vertices, np.concatenate([*sides, caps]).astype(np.int64)


def mirrored(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """The outline with its mirror image below z = 0; its first height must be 0."""
    return np.concatenate([outline[:0:-1] * [-1, 1, 1], outline])
