"""Robots: how one is built with MjSpec and what its parameters write; and robots by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swim2real.errors import ArgumentError

if TYPE_CHECKING:
    from swim2real.robots.robot import Robot

__all__ = ["ROBOTS", "robot_named"]

ROBOTS = ("fish", "fish-extended")


def robot_named(name: str) -> Robot:
    """The robot of a name, as on the command line and in parameters files.

    Raises:
        ArgumentError: There is none.
    """
    if name not in ROBOTS:
        raise ArgumentError(f"there is no robot '{name}'; there are {', '.join(ROBOTS)}")
    from swim2real.robots.fish import FISH, FISH_EXTENDED  # MuJoCo takes a while to import

    return next(robot for robot in (FISH, FISH_EXTENDED) if robot.name == name)
