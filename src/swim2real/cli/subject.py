"""What a command is about: the robot and the values that a parameters file or run folder names."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from swim2real.errors import ArgumentError, ParameterError, RobotError
from swim2real.parameters import read_parameters, robot_of
from swim2real.robots import robot_named
from swim2real.robots.robot import Robot
from swim2real.simulation import Engine

PUBLISHED = "published"


class Simulates(Protocol):
    """Whatever simulates a robot."""

    robot: Robot

    @property
    def engine(self) -> Engine: ...


def robot_for(path: Path) -> Robot:
    """The robot that parameters are for; the fish for the published ones."""
    name = "fish" if str(path) == PUBLISHED else robot_of(path)
    try:
        return robot_named(name)
    except (ArgumentError, RobotError) as error:
        raise ParameterError(f"'{path}' is for another robot: {error}") from error


def recorded_robot(folder: Path, settings: Mapping[str, Any]) -> Robot:
    """The robot that the settings of a folder name."""
    file = settings.get("robot_file")
    return robot_named(str(settings.get("robot")) if file is None else folder / str(file))


def values_of(path: Path, simulator: Simulates) -> dict[str, float]:
    """Parameters of a run folder or file, or the published ones; says so when they were found with other physics."""
    robot = simulator.robot
    if str(path) == PUBLISHED:
        return robot.space.published
    file = read_parameters(path, robot.name, robot.space)
    note = None
    if file.physics is not None:
        note = simulator.engine.difference(file.physics)
    elif file.engine is not None and file.engine != simulator.engine.name:
        note = f"made with {file.engine}; this is {simulator.engine.name}, whose fluid forces may differ"
    if note:
        print(f"swim2real: warning: {file.path} was {note}", file=sys.stderr)
    return file.values
