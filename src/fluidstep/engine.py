"""The engine as compiled loops call it: by the addresses of its functions, of a model and of a state's arrays.

Its library is loaded in the process already; its public functions take the addresses of a model and of a state
(`MjModel._address`, `MjData._address`), so that a compiled loop can run them without Python and without its lock.
"""

# ruff: noqa: N815 (the engine's names)
# what numba and llvmlite make has no types
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false, reportUntypedFunctionDecorator=false
# pyright: reportPrivateImportUsage=false, reportCallIssue=false, reportArgumentType=false

from __future__ import annotations

import ctypes
import logging
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple, TypeVar, cast

import mujoco
import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from swimbase.arrays import Array
from swimbase.errors import EngineError

Indices = NDArray[np.int32]
Addresses = NDArray[np.int64]

MIN = 1e-15  # the engine's mjMINVAL

_log = logging.getLogger(__name__)
_ASKING = Lock()


class UnsupportedModelError(EngineError):
    """The fast step doesn't apply to a model; the message says why."""


def log_warnings() -> None:
    """Takes the engine's warnings into the log; it would write MUJOCO_LOG.TXT into the working folder.

    Whoever steps a simulation sees that it diverges, so they are of interest to developers only. The engine's bindings
    wait for each other forever where two threads ask for the first time.
    """
    with _ASKING:
        if mujoco.get_mju_user_warning() is None:
            mujoco.set_mju_user_warning(_log.debug)


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
    qDeriv: Array
    qfrc_smooth: Array
    qfrc_constraint: Array
    qfrc_passive: Array
    qfrc_fluid: Array
    sensordata: Array


STEPPED = ("act", *EngineState._fields[1:])  # arrays of a state whose addresses are in its row, behind its own


def addresses(data: mujoco.MjData, names: Sequence[str] = STEPPED) -> list[int]:
    """The addresses of a state and of some of its arrays, as long as it lives."""
    return [data._address, *(getattr(data, name).ctypes.data for name in names)]


def sizes(data: mujoco.MjData) -> Addresses:
    """The sizes of a state's arrays: nq, nv, nu, na, nbody, and those of mass matrix, derivative and sensors."""
    names = ("qpos", "qvel", "ctrl", "act", "xpos", "M", "qDeriv", "sensordata")
    return np.array([len(getattr(data, name)) for name in names])


F = TypeVar("F", bound=Callable[..., object])

_LIBRARY = {"Windows": "mujoco.dll", "Darwin": "libmujoco*.dylib"}


class Calls(NamedTuple):
    """Addresses of the engine's functions, named as there."""

    mj_step1: int
    mj_fwdActuation: int
    mj_fwdAcceleration: int
    mj_fwdConstraint: int
    mjd_smooth_vel: int
    mj_implicit: int
    mj_EulerSkip: int
    mj_step: int
    mj_forward: int
    mj_kinematics: int
    mj_comPos: int
    mj_comVel: int
    mj_sensorPos: int
    mj_sensorVel: int


def find_calls() -> Calls:
    """The functions of the installed engine.

    Raises:
        UnsupportedModelError: It doesn't have them all.
    """
    try:
        path = next(Path(mujoco.__file__).parent.glob(_LIBRARY.get(platform.system(), "libmujoco.so*")))
        library = ctypes.CDLL(str(path))
        return Calls(*(int(ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0) for name in Calls._fields))
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


def _calling(*arguments: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [arg.type for arg in args[1:]])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return numba.void(*arguments), generate


@intrinsic
def _call(typingctx: Any, function: Any, model: Any, data: Any):
    return _calling(numba.intp, numba.intp, numba.intp)


@intrinsic
def _call_flag(typingctx: Any, function: Any, model: Any, data: Any, flag: Any):
    return _calling(numba.intp, numba.intp, numba.intp, numba.int32)


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
