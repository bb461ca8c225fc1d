"""Parameters files: JSON with the robot, its values and the physics that they were found with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from swim2real.parameters.space import ParameterSpace, Values
from swimbase.checking import PathText, read
from swimbase.errors import ParameterError
from swimbase.store import path_from, write_json

FORMAT = 1
BEST = "best.json"  # the parameters file of a run folder


class _Content(BaseModel):
    """Content of a parameters file; other keys, such as the loss, are for people."""

    format: Literal[1]
    robot: str
    robot_file: PathText | None = None
    parameters: dict[str, object]
    engine: str | None = None
    physics: dict[str, object] | None = None


@dataclass(frozen=True)
class ParametersFile:
    """Parameters read from a file.

    Attributes:
        values: Checked values, in the order of the space.
        engine: Name and version of the engine; None if the file doesn't say.
        physics: Integrator, time step and fluid fingerprint as recorded; None if the file doesn't say.
        path: Path of the file.
    """

    values: dict[str, float]
    engine: str | None
    physics: dict[str, object] | None
    path: Path


def robot_of(path: str | Path) -> str:
    """The robot that a parameters file is for: the path of its robot file, or its name.

    Args:
        path: Path of the file, or of a run folder, which stands for its best parameters.

    Raises:
        ParameterError: The file isn't there or isn't a parameters file, or its robot file isn't there.
    """
    place, content = _read(path)
    if content.robot_file is None:
        return content.robot
    source = place.parent / content.robot_file
    if not source.is_file():
        raise ParameterError(
            f"parameters file '{place}': its robot file '{content.robot_file}', looked up from the folder of the "
            f"parameters file, is not there; give its place with --robot, or as the parameters file's 'robot_file'"
        )
    return str(source)


def read_parameters(path: str | Path, robot: str, space: ParameterSpace) -> ParametersFile:
    """Reads a parameters file.

    Args:
        path: Path of the file, or of a run folder, which stands for its best parameters.
        robot: Name of the robot that the values must be for.
        space: Parameters of this robot.

    Raises:
        ParameterError: The file isn't there, isn't a parameters file or is for another robot, or a value is not
            allowed.
    """
    place, content = _read(path)
    if content.robot != robot:
        raise ParameterError(
            f"parameters file '{place}' is for robot '{content.robot}', not '{robot}'; give a file of this robot"
        )
    return ParametersFile(space.check(content.parameters, where=f"'{place}'"), content.engine, content.physics, place)


def _read(path: str | Path) -> tuple[Path, _Content]:
    place = Path(path)
    if place.is_dir():
        if not (place / BEST).is_file():
            raise ParameterError(f"'{place}' is no run folder with a result: it has no {BEST}")
        place = place / BEST
    return place, read(_Content, place, "parameters file", ParameterError)


def write_parameters(
    path: str | Path, robot: str, values: Values, engine: str, physics: Mapping[str, Any],
    robot_file: Path | None = None, **notes: Any,
) -> None:  # fmt: skip
    """Writes a parameters file, whole or not at all.

    Args:
        path: Path of the file.
        robot: Name of the robot.
        values: Checked values.
        engine: Name and version of the engine.
        physics: Integrator, time step and fluid fingerprint.
        robot_file: File that describes the robot, for one that isn't known by its name.
        notes: What else the file should say, such as the loss.
    """
    place = Path(path)
    file = {} if robot_file is None else {"robot_file": path_from(place.parent, robot_file)}
    content = {
        "format": FORMAT, "robot": robot, **file, "parameters": dict(values), "engine": engine,
        "physics": dict(physics), **notes,
    }  # fmt: skip
    write_json(place, content)
