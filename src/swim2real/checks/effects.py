"""Effects of each parameter of a robot file on the model: do the bounds compile, do numbers change, and why not?

`read_back` finds out whether the compiled model has what a parameter writes.
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
"""Flags that switch an attribute off: names of mjtDisableBit, which differ between versions."""
_OF_INERTIAL = ("diaginertia", "fullinertia", "inertia", "ipos", "iquat", "mass")


@dataclass(frozen=True)
class ModelEffect:
    """Effect of a parameter on the model at its bounds, the others as published.

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
    """Effects of all parameters on the model.

    Raises:
        RobotError: The model doesn't compile with the published values.
    """
    nominal = _made(robot, {})
    if isinstance(nominal, str):
        raise RobotError(nominal)
    effects: list[ModelEffect] = []
    for parameter in robot.space:
        made = [_made(robot, {parameter.name: value}) for value in (parameter.lower, parameter.upper)]
        changes = any(not isinstance(one, str) and not same(nominal, one) for one in made)
        lower, upper = (one if isinstance(one, str) else None for one in made)
        effects.append(ModelEffect(parameter, lower, upper, changes, undone(robot, parameter)))
    return effects


def why_no_effect(file: RobotFile, robot: Robot, name: str) -> str | None:
    """The reason why a parameter changes nothing, as far as the model shows it; else None.

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
    targets = [(target.selection, one) for target in entry.targets for _, one in target.selection.elements(file.spec)]
    reasons = [next(_reasons(selection, element, model, robot), "") for selection, element in targets]
    return "; ".join(dict.fromkeys(reasons)) if all(reasons) else None


def _made(robot: Robot, changes: dict[str, float]) -> mujoco.MjModel | str:
    """The model, or why there is none."""
    where = "robot '" + robot.name + "'" + "".join(f", {name} = {value:g}" for name, value in changes.items())
    try:
        return compiled(robot.build({**robot.space.published, **changes}), where)
    except RobotError as error:
        return str(error)


def _numbers(spec: mujoco.MjSpec, entry: CalibratedParameter, absolute: bool = False) -> set[tuple[str, int, str, int]]:
    """Each number that a parameter sets, or replaces."""
    selections = [target.selection for target in entry.targets if not (absolute and target.relative)]
    return {(one.kind, k, one.attribute, one.index or 0) for one in selections for k, _ in one.elements(spec)}


def _reasons(selection: Selection, element: Any, model: mujoco.MjModel, robot: Robot) -> Iterator[str]:
    who, name = selection.label(element), selection.attribute
    for flag in _FLAGS.get(name, ()):
        bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", None)
        if bit is not None and model.opt.disableflags & bit:
            yield f"the flag {flag.lower()} of the model's option is off"
    match selection.kind, name:
        case "body", _ if name in _OF_INERTIAL and not element.explicitinertial:
            yield f"{who} has no <inertial>, so its mass comes from its geoms"
        case "geom", "mass" | "density" if element.parent.explicitinertial:
            yield f"body '{element.parent.name}' has an <inertial>, which counts instead of {who}"
        case "geom", "fluidcoef" if not element.fluid_ellipsoid:
            yield f'{who} has no fluidshape="ellipsoid"'
        case "geom", "fluidcoef" if model.opt.density == 0:
            yield "option density is 0, so there is no fluid"
        case "geom", "friction" if not element.contype and not element.conaffinity:
            yield f"{who} touches nothing, since its contype and conaffinity are 0"
        case "joint", "range" if element.name and not model.joint(element.name).limited:
            yield f"{who} has no limits"
        case "actuator", _ if robot.trials.controls.get(element.name, Drive()) == Drive():  # 0
            yield f"no control drives {who}"
        case "equality", _ if not element.active:
            yield f"{who} isn't active"
        case _, "springlength" | "springref" if not np.ravel(element.stiffness)[0]:
            yield f"{who} has no stiffness"
        case _:
            pass
    heavy = {"body": _OF_INERTIAL, "geom": ("mass", "density", "fluidcoef")}.get(selection.kind, ())
    if name in heavy and _fixed(element if selection.kind == "body" else element.parent, model):
        yield f"{who} is fixed to the world"


def _fixed(body: Any, model: mujoco.MjModel) -> bool:
    return bool(body.name) and int(model.body(body.name).weldid[0]) == 0
