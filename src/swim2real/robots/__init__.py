"""Robots: what a robot tells the rest, robot files, and robots by name or file."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from swimbase.errors import ArgumentError, RunError

if TYPE_CHECKING:
    from swim2real.robots.robot import Robot

__all__ = ["ROBOTS", "load_robot", "recorded_robot", "robot_file"]

ROBOTS = ("fish", "fish-extended", "fish-rolling")
_log = logging.getLogger(__name__)


def load_robot(
    name: str | Path, *, markers_only: bool = False, allow_code: bool = False, allow_outside: bool = False
) -> Robot:
    """A robot by its name, or by its robot file, as on the command line.

    Args:
        name: Name of the robot, or path of its file.
        markers_only: Read of a robot file what tracking takes, whatever its parameters say.
        allow_code: Run the Python code that a robot file names, and remember that.
        allow_outside: Read the files outside of its folder that the robot's model names, and remember that.

    Raises:
        ArgumentError: No robot has this name, and it is no .toml file.
        RobotError: The robot file can't be read, or doesn't fit its model.
        ConsentError: It names Python code, or its model such files, which wasn't allowed.
    """
    if str(name) in ROBOTS:
        if Path(f"{name}.toml").is_file():
            _log.warning("'%s' is the robot that comes with swim2real; for your file say '%s.toml'", name, name)
        from swim2real.robots.fish import FISH, FISH_EXTENDED, FISH_ROLLING  # MuJoCo takes a while to import

        return next(robot for robot in (FISH, FISH_EXTENDED, FISH_ROLLING) if robot.name == str(name))
    if Path(name).suffix != ".toml":
        raise ArgumentError(f"there is no robot '{name}'; there are {', '.join(ROBOTS)}, or give a robot file (.toml)")
    from swim2real.robots.file import robot_from_file

    robot = robot_from_file(name, markers_only=markers_only, allow_code=allow_code, allow_outside=allow_outside)
    if robot.name in ROBOTS and Path(name).resolve() != robot_file(robot.name).resolve():
        _log.warning(
            "robot file '%s' has the name '%s' of the robot that comes with swim2real, so that its results can be "
            "taken for that one's; give it another 'name'", name, robot.name,
        )  # fmt: skip
    return robot


def recorded_robot(
    folder: Path, name: str, file: str | None, given: str | Path | None = None, *, allow_code: bool = False
) -> Robot:
    """The robot of a run, as `load_robot` loads it.

    Args:
        folder: Folder of the run.
        name: Name of the robot, as the run's settings say.
        file: Its robot file, from the folder; None for a built-in robot.
        given: Where the robot file is now; by default where the settings say.
        allow_code: Run the Python code that the robot file names, and remember that.

    Raises:
        RunError: There is no such robot, the file isn't there, or the given robot isn't that of the run.
    """
    if given is not None:
        robot = load_robot(given, allow_code=allow_code)
        if robot.name != name:
            raise RunError(f"run '{folder}' is of robot '{name}', not '{robot.name}'; give its file")
        return robot
    if file is not None and not (folder / file).is_file():
        raise RunError(f"robot file '{folder / file}' of run '{folder}' is not there; give its place with --robot")
    try:
        return load_robot(name if file is None else folder / file, allow_code=allow_code)
    except ArgumentError as error:
        raise RunError(f"'{folder}': {error}") from error


def robot_file(name: str | Path) -> Path:
    """The robot file behind a name, or the file itself."""
    return Path(__file__).parent / "fish" / f"{name}.toml" if str(name) in ROBOTS else Path(name)
