"""Whether each parameter of a robot file reaches the model: does it compile at the bounds, do its numbers change?"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from swim2real.errors import RobotError
from swim2real.parameters import Parameter
from swim2real.robots.compiled import compiled, same
from swim2real.robots.robot import Robot


@dataclass(frozen=True)
class Reach:
    """What a parameter does to the model at its bounds, the others as published.

    Attributes:
        parameter: Which.
        lower: Why the model doesn't compile at the lower bound; None where it does.
        upper: Likewise.
        changes: Whether any number of the model is another one at a bound.
    """

    parameter: Parameter
    lower: str | None
    upper: str | None
    changes: bool


def reaches(robot: Robot) -> list[Reach]:
    """What each parameter does to the model.

    Raises:
        RobotError: The model doesn't compile with the published values.
    """
    nominal = _made(robot, {})
    if isinstance(nominal, str):
        raise RobotError(nominal)
    found: list[Reach] = []
    for parameter in robot.space:
        lower, upper = (_made(robot, {parameter.name: value}) for value in (parameter.lower, parameter.upper))
        changes = any(not isinstance(one, str) and not same(nominal, one) for one in (lower, upper))
        found.append(Reach(parameter, _why(lower), _why(upper), changes))
    return found


def _made(robot: Robot, changes: dict[str, float]) -> mujoco.MjModel | str:
    """The model, or why there is none."""
    where = "robot '" + robot.name + "'" + "".join(f", {name} = {value:g}" for name, value in changes.items())
    try:
        return compiled(robot.build({**robot.space.published, **changes}), where)
    except RobotError as error:
        return str(error)


def _why(made: mujoco.MjModel | str) -> str | None:
    return made if isinstance(made, str) else None
