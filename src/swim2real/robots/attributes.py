"""Numbers of an MJCF element, by the names that they have in MJCF files.

An MjSpec calls some of them otherwise (`fluid_coefs` for `fluidcoef`), and spreads the gains of servos over
parameters of their laws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np

_OTHER_NAMES = {
    "diaginertia": "inertia", "fluidcoef": "fluid_coefs", "polycoef": "data", "user": "userdata",
}  # fmt: skip
_POLYNOMIALS = ("damping", "stiffness")  # since MuJoCo 3.7; the first coefficient is the number of the MJCF file
NOT_NEGATIVE = frozenset({
    "armature", "damping", "density", "diaginertia", "fluidcoef", "friction", "frictionloss", "kp", "kv", "mass",
    "size", "stiffness", "timestep", "viscosity",
})  # fmt: skip
"""Attributes in which a number below 0 has no physical sense."""


@dataclass(frozen=True)
class Attribute:
    """Numbers of an element that can be read and written.

    Attributes:
        size: How many; None for a single one, which needs no index.
        read: The number at an index; NaN where the model sets none.
        write: Puts a number at an index.
    """

    size: int | None
    read: Callable[[int], float]
    write: Callable[[int, float], None]


def attribute(element: Any, name: str) -> Attribute | None:
    """The numbers of an element under an MJCF name; None where it has none of this name."""
    if name in ("kp", "kv") and hasattr(element, "gainprm"):
        return _gain(element, name)
    attr = _spec_name(type(element), name)
    if attr is None or not _numeric(element, attr):
        return None
    value = getattr(element, attr)
    if isinstance(value, float):
        return Attribute(None, lambda _: float(getattr(element, attr)), lambda _, x: setattr(element, attr, x))

    def write(index: int, number: float) -> None:
        getattr(element, attr)[index] = number

    size = None if name in _POLYNOMIALS else len(value)
    return Attribute(size, lambda index: float(getattr(element, attr)[index]), write)


def attribute_names(element: Any) -> tuple[str, ...]:
    """MJCF names of the numbers that an element has."""
    found = {other: name for name, other in _OTHER_NAMES.items()}
    names = [found.get(attr, attr.replace("_", "")) for attr in dir(element) if _numeric(element, attr)]
    gains = [name for name in ("kp", "kv") if hasattr(element, "gainprm") and _gain(element, name) is not None]
    return tuple(sorted({*names, *gains}))


def class_name(element: Any) -> str:
    """The default class of an element."""
    found = element.classname if hasattr(element, "classname") else element.default()  # a tendon's
    return str(found.name)


@cache
def _spec_name(kind: type, name: str) -> str | None:
    for attr in dir(kind):
        if attr == _OTHER_NAMES.get(name, name) or attr.replace("_", "") == name:
            return attr
    return None


def _numeric(element: Any, attr: str) -> bool:
    if attr.startswith("_"):
        return False
    value = getattr(element, attr)
    if isinstance(value, float):
        return True
    return isinstance(value, np.ndarray) and value.dtype == np.float64 and value.ndim == 1 and value.size > 0


def _gain(actuator: Any, name: str) -> Attribute | None:
    """`kp` and `kv` of a position or velocity servo; None for an actuator that is neither."""
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED or actuator.biastype != mujoco.mjtBias.mjBIAS_AFFINE:
        return None
    gain, (_, by_length, by_velocity, *_) = actuator.gainprm[0], actuator.biasprm
    position = by_length == -gain != 0
    velocity = by_length == 0 and by_velocity == -gain != 0
    if not (position if name == "kp" else position or velocity):
        return None
    place = 1 if name == "kp" else 2
    leads = name == "kp" or not position  # the gain by which the control counts

    def read(_: int) -> float:
        number = float(actuator.biasprm[place])
        return float("nan") if place == 2 and number > 0 else abs(number)  # above 0 it is a damping ratio

    def write(_: int, number: float) -> None:
        if leads:
            actuator.gainprm[0] = number
        actuator.biasprm[place] = -number

    return Attribute(None, read, write)
