"""Subject of a command: the robot, the values and the problem that paths name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from swim2real.calibration import Problem, RunFolder
from swim2real.cli.options import DEFAULT_ROBOT, PUBLISHED
from swim2real.cli.terminal import tell
from swim2real.parameters import read_parameters, robot_of
from swim2real.robots import load_robot
from swim2real.robots.robot import Robot
from swim2real.settings import EvaluationSettings
from swim2real.simulation import Engine
from swim2real.trials import load_reference
from swimbase.errors import ArgumentError, ParameterError, RobotError, RunError


class Simulates(Protocol):
    """Whatever simulates a robot."""

    @property
    def robot(self) -> Robot: ...
    @property
    def engine(self) -> Engine: ...


def robot_for(path: Path, given: str | None = None) -> Robot:
    """The robot that parameters are for, or the given one; by default the fish for the published ones."""
    if given is not None:
        return load_robot(given)
    name = DEFAULT_ROBOT if str(path) == PUBLISHED else robot_of(path)
    try:
        return load_robot(name)
    except (ArgumentError, RobotError) as error:
        raise ParameterError(f"'{path}' is for another robot: {error}") from error


def heed(path: Path, anyway: bool, what: str) -> None:
    """Heeds the verdict on a run whose values are to be used: what isn't finished gets a warning.

    Args:
        path: Run folder, or a parameters file, of which no verdict is known.
        anyway: Only warn of a run that isn't usable, too.
        what: What is to be done with the values, as in "train in it".

    Raises:
        RunError: The run isn't usable.
    """
    folder = RunFolder(path)
    if not path.is_dir() or not folder.exists:
        return
    outcome = folder.outcome()
    verdict = None if outcome is None else outcome.verdict
    if outcome is None:
        tell(f"warning: run '{path}' isn't finished; --resume goes on with it")
    elif verdict is not None and verdict.kind != "good":
        said = f"run '{path}' is {verdict.kind}: {verdict.sentence}"
        if verdict.kind == "not usable" and not anyway:
            raise RunError(f"{said}. To {what} all the same, add --anyway")
        tell(f"warning: {said}")


@dataclass(frozen=True)
class _Simulated:
    robot: Robot
    engine: Engine


def values_for(path: Path, robot: Robot) -> dict[str, float]:
    """`values_of` with nothing but the robot and the engine that is installed."""
    return values_of(path, _Simulated(robot, Engine.of(robot)))


def values_of(path: Path, simulator: Simulates) -> dict[str, float]:
    """Parameters of a run folder or file, or the published ones; warns when they were found with other physics."""
    robot = simulator.robot
    if str(path) == PUBLISHED:
        return robot.space.published
    file = read_parameters(path, robot.name, robot.space)
    difference = None
    if file.physics is not None:
        difference = simulator.engine.difference(file.physics)
    elif file.engine is not None and file.engine != simulator.engine.name:
        difference = f"made with {file.engine}; this is {simulator.engine.name}, whose fluid forces may differ"
    if difference:
        tell(f"warning: {file.path} was {difference}")
    return file.values


def problem_of(
    parameters: Path, reference: Path, settings: EvaluationSettings, given: str | None = None
) -> tuple[Problem, dict[str, float]]:
    """The comparison of a robot with real trials, and the values of its parameters."""
    robot = robot_for(parameters, given)
    problem = Problem.with_settings(robot, load_reference(reference), settings)
    return problem, values_of(parameters, problem)
