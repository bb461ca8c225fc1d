"""Calls from compiled loops straight into the engine's own C functions.

The engine's library is loaded in the process already; its public functions take the addresses of a model and of a
state (`MjModel._address`, `MjData._address`), so that a loop can run them without Python and without its lock.
"""

# what numba and llvmlite make has no types
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false, reportUntypedFunctionDecorator=false

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import mujoco
import numba
from llvmlite import ir
from numba.extending import intrinsic

from swim2real.simulation.fast_plan import UnsupportedModelError

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


_NAMES = Calls._make(  # type: ignore[arg-type]
    ("mj_step1", "mj_fwdActuation", "mj_fwdAcceleration", "mj_fwdConstraint", "mjd_smooth_vel", "mj_implicit",
     "mj_EulerSkip")
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
