"""The toolbox's own files: parameters in YAML, a trajectory in .npz, the model in MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from swim2real.errors import ArgumentError, ParameterError
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.sysid.problem import SysidProblem
from swim2real.sysid.toolbox import toolbox
from swim2real.sysid.trajectory import Trajectory

BEGUN, IDENTIFIED = "params_x_0.yaml", "params_x_hat.yaml"  # as the toolbox names them in its results


def save(problem: SysidProblem, folder: str | Path) -> None:
    """Writes parameters, model and trajectories as the toolbox does.

    Raises:
        ArgumentError: The folder holds something already.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    if any(place.iterdir()):
        raise ArgumentError(f"'{place}' isn't empty; name a new folder")
    problem.parameters.save_to_disk(place / BEGUN)
    for sequences in problem.sequences:
        sequences.spec.to_file((place / f"{sequences.name}.xml").as_posix())
        for name, trajectory in zip(sequences.sequence_name, sequences.measured_rollout, strict=True):
            trajectory.save_to_disk(place / f"{name}.npz")


def load(folder: str | Path, robot: Robot) -> SysidProblem:
    """What `save` wrote.

    Raises:
        ArgumentError: There are no trajectories, or they aren't this robot's.
        ParameterError: The parameters can't be read.
        MissingExtraError: The toolbox isn't installed.
    """
    sysid, place = toolbox(), Path(folder)
    stored = _read(place / BEGUN)
    values = robot.space.check(_values(stored, place / BEGUN), where=f"'{place / BEGUN}'")
    parameters = sysid.ParameterDict({name: stored[name] for name in values})  # the file is sorted by name
    for one in parameters.values():
        one.modifier = None  # which the file doesn't keep
    model = robot.build(values).compile()
    paths = sorted(place.glob("*.npz"))
    if not paths:
        raise ArgumentError(f"'{place}' has no trajectories; name a folder that `swim2real export-sysid` wrote")
    found: list[Trajectory] = []
    for path in paths:
        try:
            one = sysid.SystemTrajectory.load_from_disk(path, model)
        except (OSError, EOFError, BadZipFile, KeyError, ValueError) as error:
            raise ArgumentError(f"'{path}' is no trajectory of robot '{robot.name}': {error}") from error
        found.append(
            Trajectory(path.stem, one.initial_state, one.control.data[:-1], one.sensordata.times, one.sensordata.data)
        )
    return SysidProblem(robot, parameters, found)


def read_values(path: str | Path, space: ParameterSpace, others: Values) -> dict[str, float]:
    """Values that the toolbox identified.

    Args:
        path: Its YAML file of parameters, or a folder with its results.
        space: Whose names and bounds are allowed.
        others: Values of those that the file doesn't have.

    Raises:
        ParameterError: Not there, not readable, an unknown name, or a value that isn't allowed.
        MissingExtraError: The toolbox isn't installed.
    """
    place = Path(path) / IDENTIFIED if Path(path).is_dir() else Path(path)
    return space.check({**others, **_values(_read(place), place)}, where=f"'{place}'")


def _read(place: Path) -> Any:
    sysid = toolbox()
    import yaml

    try:
        return sysid.ParameterDict.load_from_disk(place)
    except FileNotFoundError:
        raise ParameterError(f"parameters of the toolbox '{place}' are not there") from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError, yaml.YAMLError) as error:
        raise ParameterError(
            f"'{place}' can't be read as parameters of the toolbox: {' '.join(str(error).split())}"
        ) from error


def _values(parameters: Any, place: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, one in parameters.items():
        number = np.asarray(one.value)
        if number.size != 1:
            raise ParameterError(f"parameter '{name}' in '{place}' has {number.size} numbers; it must have one")
        found[name] = number.item()
    return found
