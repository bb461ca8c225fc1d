"""Numbers of an MJCF element, by the names that they have in MJCF files.

An MjSpec calls some of them otherwise (`fluid_coefs` for `fluidcoef`), and spreads the gains of servos over
parameters of their laws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

_OTHER_NAMES = {"fluidcoef": "fluid_coefs", "diaginertia": "inertia", "fullinertia": "fullinertia", "user": "userdata"}
NOT_NEGATIVE = frozenset({
    "armature", "damping", "density", "diaginertia", "friction", "frictionloss", "kp", "kv", "mass", "size",
    "stiffness", "timestep", "viscosity",
})  # fmt: skip
"""Attributes in which a number below 0 has no physical sense."""


@dataclass(frozen=True)
class Attribute:
    """Numbers of an element that can be read and written.

    Attributes:
        size: How many; None for a single one, which needs no index.
        read: The number at an index.
        write: Puts a number at an index.
    """

    size: int | None
    read: Callable[[int], float]
    write: Callable[[int, float], None]


def attribute(element: Any, name: str) -> Attribute | None:
    """The numbers of an element under an MJCF name; None where it has none of this name."""
    if name in ("kp", "kv") and hasattr(element, "gainprm"):
        return _gain(element, name)
    attr = _spec_name(element, name)
    if attr is None:
        return None
    value = getattr(element, attr)
    if isinstance(value, float):
        return Attribute(None, lambda _: float(getattr(element, attr)), lambda _, x: setattr(element, attr, x))
    size = None if name in ("damping", "stiffness") else len(value)  # a polynomial's coefficients since MuJoCo 3.7

    def write(index: int, number: float) -> None:
        getattr(element, attr)[index] = number

    return Attribute(size, lambda index: float(getattr(element, attr)[index]), write)


def attribute_names(element: Any) -> tuple[str, ...]:
    """MJCF names of the numbers that an element has."""
    found = {other: name for name, other in _OTHER_NAMES.items()}
    names = [found.get(attr, attr.replace("_", "")) for attr in dir(element) if _numeric(element, attr)]
    gains = [name for name in ("kp", "kv") if hasattr(element, "gainprm") and _gain(element, name) is not None]
    return tuple(sorted({*names, *gains}))


def _spec_name(element: Any, name: str) -> str | None:
    for attr in dir(element):
        if attr == _OTHER_NAMES.get(name, name) or attr.replace("_", "") == name:
            return attr if _numeric(element, attr) else None
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
    position, velocity = actuator.biasprm[1] != 0, actuator.biasprm[2] != 0
    place = 1 if name == "kp" else 2
    if not (position if name == "kp" else position or velocity):
        return None
    leads = name == "kp" or not position  # the gain by which the control counts

    def write(_: int, number: float) -> None:
        if leads:
            actuator.gainprm[0] = number
        actuator.biasprm[place] = -number

    return Attribute(None, lambda _: -float(actuator.biasprm[place]), write)
