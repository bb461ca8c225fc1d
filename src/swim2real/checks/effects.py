"""What each parameter of a robot file does to the model: do the bounds compile, do numbers change, and why not?

Whether the compiled model has what a parameter writes, `read_back` tells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from swim2real.parameters import Parameter
from swim2real.robots.compiled import compiled, same
from swim2real.robots.drives import Drive
from swim2real.robots.file import CalibratedParameter, RobotFile
from swim2real.robots.read_back import undone
from swim2real.robots.robot import Robot
from swim2real.robots.targets import Selection
from swimbase.errors import RobotError

_FLAGS = {
    "damping": ("DAMPER", "PASSIVE"), "frictionloss": ("FRICTIONLOSS",), "friction": ("CONTACT",),
    "gravity": ("GRAVITY",), "range": ("LIMIT",), "stiffness": ("SPRING", "PASSIVE"),
}  # fmt: skip
"""What switches an attribute off: names of mjtDisableBit, which differ between versions."""
_OF_INERTIAL = ("diaginertia", "fullinertia", "inertia", "ipos", "iquat", "mass")


@dataclass(frozen=True)
class ModelEffect:
    """What a parameter does to the model at its bounds, the others as published.

    Attributes:
        parameter: The parameter.
        lower: Why the model doesn't compile at the lower bound; None where it does.
        upper: Why the model doesn't compile at the upper bound; None where it does.
        changes: Whether any number of the model differs at a bound.
        undone: What the model makes of it instead of what it says, with the cause; None where it is as written.
    """

    parameter: Parameter
    lower: str | None
    upper: str | None
    changes: bool
    undone: str | None = None


def model_effects(robot: Robot) -> list[ModelEffect]:
    """What each parameter does to the model.

    Raises:
        RobotError: The model doesn't compile with the published values.
    """
    nominal = _made(robot, {})
    if isinstance(nominal, str):
        raise RobotError(nominal)
    effects: list[ModelEffect] = []
    for parameter in robot.space:
        lower, upper = (_made(robot, {parameter.name: value}) for value in (parameter.lower, parameter.upper))
        changes = any(not isinstance(made, str) and not same(nominal, made) for made in (lower, upper))
        effects.append(ModelEffect(parameter, _why(lower), _why(upper), changes, undone(robot, parameter)))
    return effects


def why_no_effect(file: RobotFile, robot: Robot, name: str) -> str | None:
    """Why a parameter changes nothing, as far as the model tells; None where it doesn't.

    Args:
        file: Robot file.
        robot: Robot that the file describes.
        name: Name of a parameter that changes nothing.
    """
    position = [entry.parameter.name for entry in file.calibrated].index(name)
    entry = file.calibrated[position]
    if entry.delays:
        return "what it delays doesn't change in these trials"
    for later in file.calibrated[position + 1 :]:
        if _numbers(file.spec, entry) <= _numbers(file.spec, later, absolute=True):
            return f"parameter '{later.parameter.name}' writes to the same place after it"
    model = file.spec.copy().compile()
    reasons = [
        next(_reasons(target.selection, element, model, robot), None)
        for target in entry.targets
        for _, element in target.selection.elements(file.spec)
    ]
    if None in reasons:
        return None
    return "; ".join(dict.fromkeys(filter(None, reasons)))


def _made(robot: Robot, changes: dict[str, float]) -> mujoco.MjModel | str:
    """The model, or why there is none."""
    where = "robot '" + robot.name + "'" + "".join(f", {name} = {value:g}" for name, value in changes.items())
    try:
        return compiled(robot.build({**robot.space.published, **changes}), where)
    except RobotError as error:
        return str(error)


def _why(made: mujoco.MjModel | str) -> str | None:
    return made if isinstance(made, str) else None


def _numbers(
    spec: mujoco.MjSpec, entry: CalibratedParameter, absolute: bool = False
) -> set[tuple[str, int, str, int]]:  # fmt: skip
    """Each number that a parameter sets, or replaces."""
    selections = [target.selection for target in entry.targets if not (absolute and target.relative)]
    return {
        (selection.kind, number, selection.attribute, selection.index or 0)
        for selection in selections for number, _ in selection.elements(spec)
    }  # fmt: skip


def _reasons(
    selection: Selection, element: Any, model: mujoco.MjModel, robot: Robot
) -> Iterator[str]:  # fmt: skip
    who, name = selection.label(element), selection.attribute
    for flag in _FLAGS.get(name, ()):
        bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", None)
        if bit is not None and model.opt.disableflags & bit:
            yield f"the flag {flag.lower()} of the model's option is off"
    match selection.kind:
        case "body":
            yield from _of_body(element, who, name, model)
        case "geom":
            yield from _of_geom(element, who, name, model)
        case "joint":
            yield from _of_joint(element, who, name, model)
        case "tendon":
            if name == "springlength" and not np.ravel(element.stiffness)[0]:
                yield f"{who} has no stiffness"
        case "actuator":
            if robot.trials.controls.get(element.name, Drive()) == Drive():  # 0
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


def _of_geom(geom: Any, who: str, name: str, model: mujoco.MjModel) -> Iterator[str]:
    if name in ("mass", "density") and geom.parent.explicitinertial:
        yield f"body '{geom.parent.name}' has an <inertial>, which counts instead of {who}"
    if name == "fluidcoef":
        if not geom.fluid_ellipsoid:
            yield f'{who} has no fluidshape="ellipsoid"'
        if model.opt.density == 0:
            yield "option density is 0, so there is no fluid"
    if name in ("mass", "density", "fluidcoef") and _fixed(geom.parent, model):
        yield f"{who} is fixed to the world"
    if name == "friction" and not geom.contype and not geom.conaffinity:
        yield f"{who} touches nothing, since its contype and conaffinity are 0"


def _of_joint(joint: Any, who: str, name: str, model: mujoco.MjModel) -> Iterator[str]:
    if name == "springref" and not np.ravel(joint.stiffness)[0]:
        yield f"{who} has no stiffness"
    if name == "range" and joint.name and not model.joint(joint.name).limited:
        yield f"{who} has no limits"


def _fixed(body: Any, model: mujoco.MjModel) -> bool:
    return bool(body.name) and int(model.body(body.name).weldid[0]) == 0
