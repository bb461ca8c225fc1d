"""The robot of a training folder."""

from __future__ import annotations

from pathlib import Path

from swim2real.errors import RunError
from swim2real.rl.run_files import SETTINGS, read_json
from swim2real.robots import ROBOTS, robot_named
from swim2real.robots.robot import Robot


def robot_of_training(folder: Path) -> Robot:
    """The robot that a policy was trained for.

    Raises:
        RunError: The folder is no training run, or of an unknown robot.
    """
    name = read_json(folder / SETTINGS).get("robot")
    if name not in ROBOTS:
        raise RunError(f"'{folder}' is of robot {name!r}; there are {', '.join(ROBOTS)}")
    return robot_named(name)
