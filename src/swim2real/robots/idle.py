"""Why a parameter may change nothing: what a person would look up in the model, told in a sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from swim2real.robots.calibrated import Calibrated
from swim2real.robots.file import RobotFile
from swim2real.robots.robot import Robot
from swim2real.robots.writes import Target, target

_FLAGS = {
    "damping": ("DAMPER", "PASSIVE"), "frictionloss": ("FRICTIONLOSS",), "friction": ("CONTACT",),
    "gravity": ("GRAVITY",), "range": ("LIMIT",), "stiffness": ("SPRING", "PASSIVE"),
}  # fmt: skip
"""What switches an attribute off: names of mjtDisableBit, which differ between versions."""
_OF_INERTIAL = ("diaginertia", "fullinertia", "inertia", "ipos", "iquat", "mass")


def why_idle(file: RobotFile, robot: Robot, name: str) -> str | None:
    """Why a parameter changes nothing, as far as the model tells; None where it doesn't.

    Args:
        file: Of the robot.
        robot: What is made of it.
        name: Of a parameter that was found to change nothing.
    """
    order = [one.parameter.name for one in file.calibrated]
    one = file.calibrated[order.index(name)]
    for other in file.calibrated[order.index(name) + 1 :]:
        if _numbers(file.spec, one) <= _numbers(file.spec, other, absolute=True):
            return f"parameter '{other.parameter.name}' writes to the same place after it"
    model = file.spec.copy().compile()
    reasons = [
        _reason(found, element, file.spec, model, robot)
        for found in (target(file.spec, write.line) for write in one.writes)
        for _, element in found.elements
    ]
    if None in reasons:
        return None
    return "; ".join(dict.fromkeys(filter(None, reasons)))


def _numbers(spec: mujoco.MjSpec, one: Calibrated, absolute: bool = False) -> set[tuple[str, int, str, int]]:
    """Each number that a parameter writes, or replaces."""
    found = [target(spec, write.line) for write in one.writes if not (absolute and write.relative)]
    return {(of.kind, number, of.attribute, of.index or 0) for of in found for number, _ in of.elements}


def _reason(
    found: Target, element: Any, spec: mujoco.MjSpec, model: mujoco.MjModel, robot: Robot
) -> str | None:  # fmt: skip
    """The first reason why a number of an element doesn't count."""
    return next(_reasons(found, element, spec, model, robot), None)


def _reasons(
    found: Target, element: Any, spec: mujoco.MjSpec, model: mujoco.MjModel, robot: Robot
) -> Iterator[str]:  # fmt: skip
    who, name = found.named(element), found.attribute
    for flag in _FLAGS.get(name, ()):
        bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", None)
        if bit is not None and model.opt.disableflags & bit:
            yield f"the flag {flag.lower()} of the model's option is off"
    match found.kind:
        case "body":
            yield from _of_body(element, who, name, model)
        case "geom":
            yield from _of_geom(element, who, name, spec, model)
        case "joint":
            yield from _of_joint(element, who, name, model)
        case "tendon":
            if name == "springlength" and not np.ravel(element.stiffness)[0]:
                yield f"{who} has no stiffness"
        case "actuator":
            control = robot.trials.control_of(element.name)
            if control is None or control == 0:
                yield f"no control drives {who}"
        case "equality":
            if not element.active:
                yield f"{who} isn't active"
        case _:
            return


def _of_body(body: Any, who: str, name: str, model: mujoco.MjModel) -> Iterator[str]:
    if name in _OF_INERTIAL and not body.explicitinertial:
        yield f"{who} has no <inertial>, so its mass comes from its geoms"
    if name in _OF_INERTIAL and _fixed(body, model):
        yield f"{who} is fixed to the world"


def _of_geom(geom: Any, who: str, name: str, spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[str]:
    body = geom.parent
    if name in ("mass", "density"):
        from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if body.explicitinertial and not from_geoms:
            yield f"body '{body.name}' has an <inertial>, which counts instead of {who}"
        if name == "density" and np.isfinite(geom.mass):
            yield f"{who} has a mass, which counts instead of its density"
    if name == "fluidcoef":
        if not geom.fluid_ellipsoid:
            yield f'{who} has no fluidshape="ellipsoid"'
        if model.opt.density == 0:
            yield "option density is 0, so there is no fluid"
    if name in ("mass", "density", "fluidcoef") and _fixed(body, model):
        yield f"{who} is fixed to the world"
    if name == "friction" and not geom.contype and not geom.conaffinity:
        yield f"{who} touches nothing, since its contype and conaffinity are 0"


def _of_joint(joint: Any, who: str, name: str, model: mujoco.MjModel) -> Iterator[str]:
    if name in ("stiffness", "damping") and np.all(joint.springdamper > 0):
        yield f"{who} has a springdamper, which sets its stiffness and damping"
    if name == "springref" and not np.ravel(joint.stiffness)[0]:
        yield f"{who} has no stiffness"
    if name == "range" and joint.name and not model.joint(joint.name).limited:
        yield f"{who} has no limits"


def _fixed(body: Any, model: mujoco.MjModel) -> bool:
    return bool(body.name) and int(model.body(body.name).weldid[0]) == 0
