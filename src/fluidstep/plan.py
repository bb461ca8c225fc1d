"""Plan of the fast step for a compiled model: says if it applies, and holds the constants that it computes with."""

from __future__ import annotations

import copy
from typing import NamedTuple

import mujoco
import numpy as np

from fluidstep.engine import MIN, Array, Indices, UnsupportedModelError

# where in a geom's row of constants: place in its body, 9 numbers of its rotation there, whether it is turned at all
POS, ROT, TURNED = 0, 3, 12
ABC = 13  # squared products of two semi-axes
BOX = 16  # whether it is the inertia box of a body without an ellipsoid
DRAG_LIN, DRAG_SLENDER, DRAG_BLUNT = 17, 18, 19
LIFT, MAGNUS = 20, 21
MASS, INERTIA = 22, 25  # of the water that moves along, 3 each
SPIN_LIN, SPIN = 28, 29  # drag against turning, 1 and 3
DRAG = MASS  # of an inertia box along its axes, in the place of the mass
COLUMNS = 32


class Water(NamedTuple):
    """Fluid of one parameter set, and the constants that depend on it.

    Attributes:
        wet: Address of the model.
        dry: Address of its twin without water; the model's own where the engine steps.
        density: Density of the water [kg/m³].
        wind: Velocity of the water [m/s]. Shape (3,).
        geoms: Constants of the geoms in the water and of inertia boxes, sorted by body. Shape (G, COLUMNS).
    """

    wet: int
    dry: int
    density: float
    wind: Array
    geoms: Array


class Plan(NamedTuple):
    """The structure of a model, which all its parameter sets have.

    Attributes:
        timestep: [s].
        symmetric: Whether the integrator is `implicitfast`, which drops the antisymmetric part of the derivative.
        floor: Smallest denominator of the fluid's formulas.
        body_first: First geom of each body. Shape (bodies,).
        body_last: The one after its last. Shape (bodies,).
        body_root: Root of the tree that a body is in. Shape (bodies,).
        body_parent: Shape (bodies,).
        body_dof: First degree of freedom of each body. Shape (bodies,).
        dof_body: Shape (nv,).
        dof_parent: The next degree of freedom above in the tree, -1 for none. Shape (nv,).
        dof_last: The last that turns or moves together with it in one joint, -1 for hinges and slides. Shape (nv,).
        d_rowadr: Rows of the engine's sparse velocity derivative.
        d_rownnz: Their lengths.
        d_colind: Their columns.
        m_rowadr: Rows of the engine's sparse mass matrix, lower half.
        m_rownnz: Their lengths.
        m_colind: Their columns.
    """

    timestep: float
    symmetric: bool
    floor: float
    body_first: Indices
    body_last: Indices
    body_root: Indices
    body_parent: Indices
    body_dof: Indices
    dof_body: Indices
    dof_parent: Indices
    dof_last: Indices
    d_rowadr: Indices
    d_rownnz: Indices
    d_colind: Indices
    m_rowadr: Indices
    m_rownnz: Indices
    m_colind: Indices

    def same(self, other: Plan) -> bool:
        """True if another model has the same structure; its timestep may be another."""
        return all(np.array_equal(a, b) for a, b in zip(self[3:], other[3:], strict=True))


def without_fluid(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model's twin that the engine steps: no water, and nothing implicit in its Euler step."""
    dry = copy.copy(model)
    dry.opt.density = dry.opt.viscosity = 0.0
    dry.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    return dry


def make_plan(model: mujoco.MjModel, dry: mujoco.MjModel) -> tuple[Plan, Water]:
    """Plans the fast step of a model. The models must live as long as the plan.

    Args:
        model: Compiled.
        dry: Its twin from `without_fluid`.

    Raises:
        UnsupportedModelError: The fast step doesn't apply.
    """
    _check(model)
    # from 3.14 on the engine normalizes velocity and semi-axes, where its floor on denominators took lift away before
    normalized = tuple(int(part) for part in mujoco.__version__.split(".")[:2]) >= (3, 14)
    rows, first, last = list[Array](), list[int](), list[int]()
    in_water = model.opt.density > 0 or model.opt.viscosity > 0
    for body in range(model.nbody):
        wet = np.flatnonzero((model.geom_bodyid == body) & (model.geom_fluid[:, 0] > 0))
        first.append(len(rows))
        if in_water and model.body_mass[body] >= MIN:
            rows += [_geom_constants(model, geom, normalized) for geom in wet.tolist()] or [_box_constants(model, body)]
        last.append(len(rows))
    water = Water(
        model._address, dry._address, float(model.opt.density), np.array(model.opt.wind, dtype=np.float64),
        np.array(rows, dtype=np.float64).reshape(-1, COLUMNS),
    )  # fmt: skip
    return Plan(
        float(model.opt.timestep), bool(model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST),
        1e-300 if normalized else MIN, _indices(first), _indices(last), _indices(model.body_rootid),
        _indices(model.body_parentid), _indices(model.body_dofadr), _indices(model.dof_bodyid),
        _indices(model.dof_parentid), _last_of_joint(model), _indices(model.D_rowadr), _indices(model.D_rownnz),
        _indices(model.D_colind), _indices(model.M_rowadr), _indices(model.M_rownnz), _indices(model.M_colind),
    ), water  # fmt: skip


def engine_plan(model: mujoco.MjModel) -> tuple[Plan, Water]:
    """A plan without a structure, for loops that make the engine's own steps."""
    none = [_indices([])] * (len(Plan._fields) - 3)
    water = Water(model._address, model._address, 0.0, np.zeros(3), np.zeros((0, COLUMNS)))
    return Plan(float(model.opt.timestep), False, MIN, *none), water


def _check(model: mujoco.MjModel) -> None:
    integrator, joint = mujoco.mjtIntegrator, mujoco.mjtJoint
    if model.opt.integrator not in (integrator.mjINT_IMPLICIT, integrator.mjINT_IMPLICITFAST):
        name = integrator(model.opt.integrator).name.removeprefix("mjINT_")
        raise UnsupportedModelError(f"the integrator is {name}; it must be implicit or implicitfast")
    turns_freely = np.isin(model.jnt_type, (int(joint.mjJNT_FREE), int(joint.mjJNT_BALL))).any()
    if model.opt.integrator == integrator.mjINT_IMPLICITFAST and turns_freely:
        raise UnsupportedModelError("implicitfast treats free and ball joints in its own way; use implicit")
    if model.opt.enableflags:
        raise UnsupportedModelError(f"an enable flag is set: enableflags is {model.opt.enableflags}, not 0")
    flags = mujoco.mjtDisableBit
    if model.opt.disableflags & int(flags.mjDSBL_SPRING | flags.mjDSBL_DAMPER):
        raise UnsupportedModelError("springs or dampers are switched off by disableflags")
    if model.nflex or model.nplugin:
        raise UnsupportedModelError("the model has flexes or plugins")
    if getattr(model, "nhistory", 0):
        raise UnsupportedModelError("the model has delayed sensors or actuators")
    if np.any(np.asarray(model.sensor_needstage) == int(mujoco.mjtStage.mjSTAGE_ACC)):
        raise UnsupportedModelError("the model has sensors of forces or accelerations")
    for name in ("control", "passive", "act_dyn", "act_gain", "act_bias", "sensor", "contactfilter", "time"):
        getter = getattr(mujoco, f"get_mjcb_{name}", None)
        if getter is not None and getter() is not None:
            raise UnsupportedModelError(f"a {name} callback is set")


def _geom_constants(model: mujoco.MjModel, geom: int, normalized: bool) -> Array:
    """Numbers of a geom for the fluid's formulas, after the engine's `mj_ellipsoidFluidModel`. Shape (COLUMNS,)."""
    interaction, blunt, slender, angular, kutta, magnus = model.geom_fluid[geom, :6]
    if interaction != 1.0:
        raise UnsupportedModelError(f"geom {geom} has a fluid interaction of {interaction}")
    axes = _semi_axes(int(model.geom_type[geom]), model.geom_size[geom])
    density, viscosity = model.opt.density, model.opt.viscosity
    row = _placed(model.geom_pos[geom], model.geom_quat[geom])
    row[ABC : ABC + 3] = (axes[[1, 2, 0]] * axes[[2, 0, 1]]) ** 2
    largest_square = row[ABC : ABC + 3].max() if normalized else 1.0
    row[ABC : ABC + 3] /= largest_square
    scale = np.sqrt(largest_square)  # of what grows with the squared products
    _, middle, high = np.sort(axes)
    sphere = 2.0 / 3.0 * axes.sum()
    row[DRAG_LIN] = viscosity * 3.0 * np.pi * sphere
    row[DRAG_SLENDER] = slender * np.pi * high * middle
    row[DRAG_BLUNT] = (blunt - slender) * scale
    row[LIFT] = kutta * np.pi * scale
    row[MAGNUS] = magnus * density * 4.0 / 3.0 * np.pi * axes.prod()
    row[MASS : MASS + 3] = density * model.geom_fluid[geom, 6:9]
    row[INERTIA : INERTIA + 3] = density * model.geom_fluid[geom, 9:12]
    row[SPIN_LIN] = viscosity * np.pi * sphere**3
    moments = 8.0 / 15.0 * np.pi * axes * np.maximum(axes[[1, 2, 0]], axes[[2, 0, 1]]) ** 4
    largest = 8.0 / 15.0 * np.pi * middle * high**4
    row[SPIN : SPIN + 3] = angular * moments + slender * (largest - moments)
    return row


def _box_constants(model: mujoco.MjModel, body: int) -> Array:
    """The same for the box of a body's mass and inertia, after the engine's `mj_inertiaBoxFluidModel`."""
    inertia, density, viscosity = model.body_inertia[body], model.opt.density, model.opt.viscosity
    sides = np.sqrt(np.maximum(MIN, inertia.sum() - 2.0 * inertia) * 6.0 / model.body_mass[body])
    sphere, others = sides.mean(), sides[[[1, 2], [2, 0], [0, 1]]]
    row = _placed(model.body_ipos[body], model.body_iquat[body])
    row[BOX] = True
    row[DRAG_LIN], row[SPIN_LIN] = viscosity * 3.0 * np.pi * sphere, viscosity * np.pi * sphere**3
    row[DRAG : DRAG + 3] = 0.5 * density * others.prod(axis=1)
    row[SPIN : SPIN + 3] = density / 64.0 * sides * (others**4).sum(axis=1)
    return row


def _placed(position: Array, quaternion: Array) -> Array:
    """Constants of a place in a body and nothing else yet. Shape (COLUMNS,)."""
    row = np.zeros(COLUMNS)
    row[POS : POS + 3] = position
    mujoco.mju_quat2Mat(row[ROT : ROT + 9], quaternion)
    row[TURNED] = not np.array_equal(row[ROT : ROT + 9], np.eye(3).ravel())
    return row


def _semi_axes(kind: int, size: Array) -> Array:
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.full(3, size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([size[0], size[0], size[1] + size[0]])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return np.array([size[0], size[0], size[1]])
    return np.array(size)


def _last_of_joint(model: mujoco.MjModel) -> Indices:
    last = np.full(model.nv, -1, dtype=np.int32)
    for kind, dof in zip(model.jnt_type, model.jnt_dofadr, strict=True):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            last[dof : dof + 3], last[dof + 3 : dof + 6] = dof + 2, dof + 5
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            last[dof : dof + 3] = dof + 2
    return last


def _indices(values: object) -> Indices:
    return np.ascontiguousarray(values, dtype=np.int32)
