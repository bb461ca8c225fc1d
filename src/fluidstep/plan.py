"""What the fast step knows of a compiled model and calls in the engine.

The plan says whether the fast step applies to a model and holds the constants that it computes with. The engine's
library is loaded in the process already; its public functions take the addresses of a model and of a state
(`MjModel._address`, `MjData._address`), so that a compiled loop can run them without Python and without its lock.
"""

# what numba and llvmlite make has no types
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false, reportUntypedFunctionDecorator=false
# pyright: reportPrivateImportUsage=false, reportCallIssue=false, reportArgumentType=false

from __future__ import annotations

import copy
import ctypes
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import mujoco
import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from swimbase.errors import EngineError

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

MIN = 1e-15  # the engine's mjMINVAL

# where in a geom's row of constants: place in its body, 9 numbers of its rotation there, whether it is turned at all
POS, ROT, TURNED = 0, 3, 12
ABC = 13  # squared products of two semi-axes
DRAG_LIN, DRAG_SLENDER, DRAG_BLUNT = 17, 18, 19
LIFT, MAGNUS = 20, 21
MASS, INERTIA = 22, 25  # of the water that moves along, 3 each
SPIN_LIN, SPIN = 28, 29  # drag against turning, 1 and 3
COLUMNS = 32


class UnsupportedModelError(EngineError):
    """The fast step doesn't apply to a model; the message says why."""


class Water(NamedTuple):
    """What a parameter set has of its own.

    Attributes:
        wet: Address of the model.
        dry: Address of its twin without water; the model's own where the engine steps.
        density: Density of the water [kg/m³].
        wind: Velocity of the water [m/s]. Shape (3,).
        geoms: Constants of the geoms in the water, sorted by body. Shape (G, COLUMNS).
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
        """Whether another model has the same structure; its timestep may be another."""
        return all(np.array_equal(a, b) for a, b in zip(self[3:], other[3:], strict=True))


class EngineState(NamedTuple):
    """The arrays of an `MjData`, named as there, and its address; only inside compiled functions."""

    data: int
    qpos: Array
    qvel: Array
    qacc: Array
    qacc_warmstart: Array
    ctrl: Array
    cdof: Array
    cdof_dot: Array
    cvel: Array
    cinert: Array
    xpos: Array
    xmat: Array
    subtree_com: Array
    M: Array
    qDeriv: Array  # noqa: N815
    qfrc_smooth: Array
    qfrc_constraint: Array
    qfrc_passive: Array
    qfrc_fluid: Array
    sensordata: Array


Addresses = NDArray[np.int64]
STEPPED = ("act", *EngineState._fields[1:])  # arrays of a state whose addresses are in its row, behind its own


def addresses(data: mujoco.MjData, names: Sequence[str] = STEPPED) -> list[int]:
    """The addresses of a state and of some of its arrays, as long as it lives."""
    return [data._address, *(getattr(data, name).ctypes.data for name in names)]


def sizes(model: mujoco.MjModel) -> Addresses:
    """The sizes of a state's arrays: nq, nv, nu, na, nbody, and those of mass matrix, derivative and sensors."""
    data = mujoco.MjData(model)
    lengths = [len(data.M), len(data.qDeriv), model.nsensordata]
    return np.array([model.nq, model.nv, model.nu, model.na, model.nbody, *lengths])


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
    rows: list[Array] = []
    first: list[int] = []
    last: list[int] = []
    in_water = model.opt.density > 0 or model.opt.viscosity > 0
    for body in range(model.nbody):
        begin = int(model.body_geomadr[body])
        geoms = range(begin, begin + int(model.body_geomnum[body]))
        wet = [geom for geom in geoms if model.geom_fluid[geom, 0] > 0]
        first.append(len(rows))
        if in_water and model.body_mass[body] >= MIN:
            if not wet and body > 0:
                raise UnsupportedModelError(
                    f"body '{model.body(body).name}' has no ellipsoid geom: the inertia-box fluid applies to it"
                )
            rows += [_geom_constants(model, geom, normalized) for geom in wet]
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
        raise UnsupportedModelError("the integrator is neither implicit nor implicitfast")
    turns_freely = np.isin(model.jnt_type, (int(joint.mjJNT_FREE), int(joint.mjJNT_BALL))).any()
    if model.opt.integrator == integrator.mjINT_IMPLICITFAST and turns_freely:
        raise UnsupportedModelError("implicitfast treats free and ball joints in its own way")
    if model.opt.enableflags:
        raise UnsupportedModelError("an enable flag is set")
    flags = mujoco.mjtDisableBit
    if model.opt.disableflags & int(flags.mjDSBL_SPRING | flags.mjDSBL_DAMPER):
        raise UnsupportedModelError("passive forces are switched off")
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
    """What the fluid's formulas need of a geom, after the engine's `mj_ellipsoidFluidModel`. Shape (COLUMNS,)."""
    interaction, blunt, slender, angular, kutta, magnus = model.geom_fluid[geom, :6]
    if interaction != 1.0:
        raise UnsupportedModelError(f"geom {geom} has a fluid interaction of {interaction}")
    axes = _semi_axes(int(model.geom_type[geom]), model.geom_size[geom])
    density, viscosity = model.opt.density, model.opt.viscosity
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    row = np.zeros(COLUMNS)
    row[POS : POS + 3] = model.geom_pos[geom]
    row[ROT : ROT + 9] = rotation
    row[TURNED] = not np.array_equal(rotation, np.eye(3).ravel())
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


F = TypeVar("F", bound=Callable[..., object])

_LIBRARY = {"Windows": "mujoco.dll", "Darwin": "libmujoco*.dylib"}


class Calls(NamedTuple):
    """Addresses of the engine's functions."""

    step1: int
    actuation: int
    acceleration: int
    constraint: int
    derivative: int
    implicit: int
    advance: int
    step: int
    forward: int
    kinematics: int
    com_pos: int
    com_vel: int
    sensor_pos: int
    sensor_vel: int


_NAMES = Calls._make(  # type: ignore[arg-type]
    ("mj_step1", "mj_fwdActuation", "mj_fwdAcceleration", "mj_fwdConstraint", "mjd_smooth_vel", "mj_implicit",
     "mj_EulerSkip", "mj_step", "mj_forward", "mj_kinematics", "mj_comPos", "mj_comVel", "mj_sensorPos", "mj_sensorVel")
)  # fmt: skip


def find_calls() -> Calls:
    """The functions of the installed engine.

    Raises:
        UnsupportedModelError: It doesn't have them all.
    """
    try:
        path = next(Path(mujoco.__file__).parent.glob(_LIBRARY.get(platform.system(), "libmujoco.so*")))
        library = ctypes.CDLL(str(path))
        return Calls(*(int(ctypes.cast(getattr(library, str(name)), ctypes.c_void_p).value or 0) for name in _NAMES))
    except (StopIteration, OSError, AttributeError) as error:
        raise UnsupportedModelError(f"the engine's library can't be called directly: {error!r}") from None


def compiled(function: F) -> F:
    """Compiles a function on its first call, to run without Python's lock; IEEE arithmetic, as in the engine."""
    return cast("F", numba.njit(nogil=True, error_model="numpy")(function))


def borrowing(function: F) -> F:
    """Compiles a function that neither makes nor returns arrays, and doesn't count references to those it is given.

    The count of each array is one number that all threads change: it was a quarter of a step's time on one core, and
    more on two.
    """
    return cast("F", numba.njit(nogil=True, error_model="numpy", _nrt=False)(function))


@intrinsic
def _call(typingctx: Any, function: Any, model: Any, data: Any):
    signature = numba.void(numba.intp, numba.intp, numba.intp)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = args[0].type
        kind = ir.FunctionType(ir.VoidType(), [word, word])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def _call_flag(typingctx: Any, function: Any, model: Any, data: Any, flag: Any):
    signature = numba.void(numba.intp, numba.intp, numba.intp, numba.int32)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = args[0].type
        kind = ir.FunctionType(ir.VoidType(), [word, word, ir.IntType(32)])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return signature, generate


# void function(model, data), all three given as addresses; only inside compiled functions
call = cast("Callable[[int, int, int], None]", _call)
# void function(model, data, int flag)
call_flag = cast("Callable[[int, int, int, int], None]", _call_flag)


@intrinsic
def _pointer(typingctx: Any, address: Any):
    signature = types.CPointer(types.float64)(types.int64)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(sig.return_type))

    return signature, generate


@compiled
def array_at(address: int, shape: Any) -> Array:
    """The numbers at an address."""
    return numba.carray(_pointer(address), shape, np.float64)


@compiled
def state_at(row: Addresses, sizes: Addresses) -> EngineState:
    """The arrays of a state, from its row of addresses."""
    nq, nv, nu, nbody, n_mass, n_derivative = sizes[0], sizes[1], sizes[2], sizes[4], sizes[5], sizes[6]
    return EngineState(
        row[0], array_at(row[2], (nq,)), array_at(row[3], (nv,)), array_at(row[4], (nv,)), array_at(row[5], (nv,)),
        array_at(row[6], (nu,)), array_at(row[7], (nv, 6)), array_at(row[8], (nv, 6)), array_at(row[9], (nbody, 6)),
        array_at(row[10], (nbody, 10)), array_at(row[11], (nbody, 3)), array_at(row[12], (nbody, 9)),
        array_at(row[13], (nbody, 3)), array_at(row[14], (n_mass,)), array_at(row[15], (n_derivative,)),
        array_at(row[16], (nv,)), array_at(row[17], (nv,)), array_at(row[18], (nv,)), array_at(row[19], (nv,)),
        array_at(row[20], (sizes[7],)),
    )  # fmt: skip
