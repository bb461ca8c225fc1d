"""Compiled models: their numbers, and in what two of them differ."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from swimbase.errors import RobotError

SHORTEST_STEP = 1e-6  # s
_UNITS = {
    "TOUCH": "N", "ACCELEROMETER": "m/s²", "VELOCIMETER": "m/s", "GYRO": "rad/s", "FORCE": "N", "TORQUE": "N·m",
    "MAGNETOMETER": "T", "RANGEFINDER": "m", "BALLANGVEL": "rad/s", "FRAMEPOS": "m", "FRAMELINVEL": "m/s",
    "FRAMEANGVEL": "rad/s", "FRAMELINACC": "m/s²", "FRAMEANGACC": "rad/s²", "SUBTREECOM": "m", "SUBTREELINVEL": "m/s",
    "GEOMDIST": "m", "JOINTPOS": "rad", "JOINTVEL": "rad/s", "JOINTACTFRC": "N·m", "JOINTLIMITPOS": "rad",
    "JOINTLIMITVEL": "rad/s", "JOINTLIMITFRC": "N·m", "ACTUATORPOS": "rad", "ACTUATORVEL": "rad/s", "TENDONPOS": "m",
    "TENDONVEL": "m/s", "TENDONACTFRC": "N",
}  # fmt: skip
REFUSALS = (ValueError, RuntimeError, MemoryError, mujoco.FatalError)
"""Errors that MuJoCo raises when a model can't be read or compiled."""


def compiled(spec: mujoco.MjSpec, where: str) -> mujoco.MjModel:
    """The model of a spec, which then holds what the compiler made of it.

    Args:
        spec: Spec that is compiled and changed by it.
        where: What a message begins with: file and place.

    Raises:
        RobotError: It doesn't compile, or its time step is so short that no simulation would end.
    """
    try:
        model = spec.compile()
    except REFUSALS as error:
        raise RobotError(f"{where}: the model doesn't compile: {one_line(error)}") from error
    if not model.opt.timestep >= SHORTEST_STEP:
        raise RobotError(
            f"{where}: the model's timestep is {model.opt.timestep:g} s; it must be at least {SHORTEST_STEP:g} s"
        )
    return model


def sensor_units(model: mujoco.MjModel) -> dict[str, str]:
    """Units of the model's sensors by name, `-` where the model doesn't tell."""
    joints, hinge, slide = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    units = dict[str, str]()
    for i in range(model.nsensor):
        kind, of = mujoco.mjtSensor(model.sensor_type[i]).name.removeprefix("mjSENS_"), int(model.sensor_objid[i])
        unit, joint = _UNITS.get(kind, "-"), of if kind.startswith("JOINT") else None
        if kind.startswith("ACTUATOR"):
            unit = unit if model.actuator_trntype[of] == joints else "-"
            joint = int(model.actuator_trnid[of, 0])
        if kind.startswith("TENDON") and model.wrap_type[model.tendon_adr[of]] == mujoco.mjtWrap.mjWRAP_JOINT:
            unit = "-"  # a sum of joints, of whatever kind
        if joint is not None and model.jnt_type[joint] == slide:
            unit = unit.replace("rad", "m").replace("N·m", "N")
        elif joint is not None and model.jnt_type[joint] != hinge:
            unit = "-"
        units[model.sensor(i).name] = unit
    return units


def set_linear(element: Any, attribute: str, value: float) -> None:
    """Sets a stiffness or damping, the first of a polynomial's coefficients since MuJoCo 3.7.

    Args:
        element: Joint or tendon of a spec.
        attribute: `stiffness` or `damping`.
        value: Of the linear coefficient [SI].
    """
    if np.ndim(getattr(element, attribute)):
        getattr(element, attribute)[0] = value
    else:
        setattr(element, attribute, value)


def one_line(error: Exception) -> str:
    """The message of an error without line breaks."""
    return " ".join(str(error).split())


def numbers(model: mujoco.MjModel) -> Iterator[tuple[str, Any]]:
    """Every array of a model and its options, by name."""
    for where, of in (("", model), ("opt.", model.opt)):
        for name in dir(of):
            value = None if name.startswith("_") else getattr(of, name)
            if isinstance(value, np.ndarray) or (where and isinstance(value, float | int)):
                yield f"{where}{name}", value


def same(first: mujoco.MjModel, second: mujoco.MjModel) -> bool:
    """True if two models of one spec have the same numbers."""
    return all(
        name == other and np.array_equal(a, b, equal_nan=isinstance(a, np.ndarray) and a.dtype.kind == "f")
        for (name, a), (other, b) in zip(numbers(first), numbers(second), strict=True)
    )


def largest_difference(first: mujoco.MjModel, second: mujoco.MjModel) -> tuple[str, float]:
    """The array in which two models differ most, by a share of its largest number; infinite for other shapes."""
    largest = ("", 0.0)
    for (name, a), (_, b) in zip(numbers(first), numbers(second), strict=True):
        if np.asarray(a).dtype.kind != "f" or not np.size(a):
            continue
        expected, actual = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
        if expected.shape != actual.shape:
            return name, np.inf
        gap = float(np.nanmax(np.abs(expected - actual)) / max(float(np.nanmax(np.abs(expected))), 1e-300))
        if gap > largest[1]:
            largest = (name, gap)
    return largest
