"""Parameters files: JSON with the robot, its values and the physics that they were found with."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swim2real.errors import ParameterError
from swim2real.parameters.space import ParameterSpace, Values

FORMAT = 1
BEST = "best.json"  # the parameters file of a run folder


@dataclass(frozen=True)
class ParametersFile:
    """What a parameters file holds.

    Attributes:
        values: Checked, in the order of the space.
        engine: The engine's name, or None.
        physics: Integrator, time step and fluid fingerprint as recorded, or None.
        path: Where it was read from.
    """

    values: dict[str, float]
    engine: str | None
    physics: dict[str, Any] | None
    path: Path


def robot_of(path: str | Path) -> str:
    """The robot that a parameters file, or a run folder's best parameters, are for: its robot file, or its name.

    Raises:
        ParameterError: Not there, not JSON, another format, or no name; or the robot file isn't there.
    """
    place, content = _read(path)
    name = content.get("robot")
    if not isinstance(name, str):
        raise ParameterError(f"parameters file '{place}': 'robot' is {name!r}; it must be a robot's name")
    file = content.get("robot_file")
    if file is None:
        return name
    source = place.parent / str(file)
    if not source.is_file():
        raise ParameterError(
            f"parameters file '{place}': its robot file '{file}', looked up from the folder of the parameters file, is "
            f"not there; leave the parameters file where it was, or give the robot file's place as its 'robot_file'"
        )
    return str(source)


def read_parameters(path: str | Path, robot: str, space: ParameterSpace) -> ParametersFile:
    """Reads a parameters file, or the best parameters of a run folder.

    Raises:
        ParameterError: Not there, not JSON, another format or robot, or a value that is not allowed.
    """
    place, content = _read(path)
    if content.get("robot") != robot:
        raise ParameterError(f"parameters file '{place}' is for robot {content.get('robot')!r}, not '{robot}'")
    values = content.get("parameters")
    if not isinstance(values, dict):
        raise ParameterError(f"parameters file '{place}': 'parameters' must map names to numbers")
    physics = content.get("physics")
    return ParametersFile(
        space.check(values, where=f"'{place}'"),
        content.get("engine"),
        physics if isinstance(physics, dict) else None,
        place,
    )


def _read(path: str | Path) -> tuple[Path, dict[str, Any]]:
    place = Path(path)
    if place.is_dir():
        if not (place / BEST).is_file():
            raise ParameterError(f"'{place}' is no run folder with a result: it has no {BEST}")
        place = place / BEST
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ParameterError(f"parameters file '{place}' is not there") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ParameterError(f"parameters file '{place}' can't be read as JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else content
        raise ParameterError(f"parameters file '{place}': format is {found!r}; this version reads format {FORMAT}")
    return place, content


def write_parameters(
    path: str | Path, robot: str, values: Values, engine: str, physics: Mapping[str, Any],
    robot_file: Path | None = None, **notes: Any,
) -> None:  # fmt: skip
    """Writes a parameters file at once, so that a reader never sees half of it.

    Args:
        path: Where to.
        robot: Name of the robot.
        values: Checked values.
        engine: Name and version of the engine.
        physics: Integrator, time step and fluid fingerprint.
        robot_file: That describes the robot, for one that isn't known by its name.
        notes: What else the file should tell, such as the loss.
    """
    place = Path(path)
    file = {} if robot_file is None else {"robot_file": from_folder(place.parent, robot_file)}
    content = {
        "format": FORMAT, "robot": robot, **file, "parameters": dict(values), "engine": engine,
        "physics": dict(physics), **notes,
    }  # fmt: skip
    part = place.with_name(place.name + ".part")
    part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    os.replace(part, place)


def from_folder(folder: Path, file: Path) -> str:
    """The way from a folder to a file, so that both can be moved together; the whole path where there is none."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return file.resolve().as_posix()
