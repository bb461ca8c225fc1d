"""Advisors: who says what is physically wrong and where to go. Optimizers ask them through one protocol."""

from swim2real.advisor.physics import PhysicsAdvisor
from swim2real.errors import ArgumentError
from swim2real.optimizers import Advisor
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot

ADVISORS = ("physics",)

__all__ = ["ADVISORS", "PhysicsAdvisor", "make_advisor"]


def make_advisor(name: str, robot: Robot, space: ParameterSpace, seed: int) -> Advisor:
    """The advisor of a name.

    Raises:
        ArgumentError: There is none of that name.
    """
    if name == "physics":
        return PhysicsAdvisor(robot, space, seed)
    raise ArgumentError(f"advisor is '{name}'; this version has {', '.join(ADVISORS)}")
