"""A calibration problem as the toolbox's objects and files: parameters in YAML, trajectories in .npz, model in MJCF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import Problem
from swim2real.errors import ArgumentError, ParameterError
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.simulation.playback import sensor_address
from swim2real.sysid.toolbox import toolbox
from swim2real.sysid.trajectory import Array, Trajectory, trajectories


class SysidProblem:
    """Parameters and trials of a robot as the toolbox has them.

    Attributes:
        robot: The robot that is identified.
        parameters: A `ParameterDict`, each parameter within its bounds. One that is `frozen` stays as it is.
        sequences: A list of one `ModelSequences` with a sequence a trial. Readings are NaN where nothing was measured.
        residual: What `optimize` and `save_results` take as `residual_fn`: the distances of all markers that count [m]
            and the sensors' differences times their `meters_per_unit`, such that the squares add up to the mean over
            trials of the mean squared distance.
    """

    def __init__(self, robot: Robot, parameters: Any, real: Sequence[Trajectory]) -> None:
        """Makes the objects.

        Args:
            robot: The robot that is identified.
            parameters: A `ParameterDict` with the robot's parameters.
            real: The real trials, one at least.

        Raises:
            MissingExtraError: The toolbox isn't installed.
        """
        sysid = toolbox()
        self.robot, self.parameters = robot, parameters
        spec = robot.build(self._values(parameters))
        model = spec.compile()
        self._columns, self._meters_per_unit, self._mapping = _compared_columns(robot, model)
        series = [_series(trajectory, model) for trajectory in real]
        self.sequences = [
            sysid.ModelSequences(
                robot.name, spec, [trajectory.name for trajectory in real], [trajectory.state for trajectory in real],
                [controls for controls, _ in series], [readings for _, readings in series],
            )
        ]  # fmt: skip
        self.residual: Callable[..., Any] = sysid.build_residual_fn(
            models_sequences=self.sequences, build_model=self.build_model, modify_residual=self._compared,
            resample_true=False,
        )  # fmt: skip

    def build_model(self, parameters: Any, _: mujoco.MjSpec | None = None) -> mujoco.MjModel:
        """The robot's model with the values of a `ParameterDict`, as the toolbox's functions want it."""
        return self.robot.build(self._values(parameters)).compile()

    def _values(self, parameters: Any) -> dict[str, float]:
        """Within bounds: steps up to a bound may end a rounding beyond it."""
        return {
            known.name: float(np.clip(parameters[known.name].value.item(), known.lower, known.upper))
            for known in self.robot.space
        }

    def _compared(
        self, parameters: Any, predicted: Any, measured: Any, model: mujoco.MjModel, everything: bool, **_: Any
    ) -> tuple[Array, Any, Any]:
        sysid = toolbox()
        # a rollout has the sensors of the state before each step beside the time after it
        before = predicted.times - model.opt.timestep
        read = sysid.TimeSeries(before, predicted.data[:, self._columns], self._mapping).resample(measured.times)
        real = measured.data[:, self._columns]
        known = np.isfinite(real)
        counts = known.sum(axis=0).astype(float)
        markers = 2 * len(self.robot.marker_names)
        counts[:markers] = counts[:markers].sum() / 2
        weights = self._meters_per_unit / np.sqrt(np.maximum(counts, 1.0) * len(self.sequences[0].sequence_name))
        return (weights * (real - read.data))[known], read, sysid.TimeSeries(measured.times, real, self._mapping)


def to_sysid(problem: Problem, values: Values) -> SysidProblem:
    """A problem as the toolbox's objects, from given values on.

    Args:
        problem: A robot and real trials.
        values: Where an identification is to begin. Starts, and of swims phases and registration, are found with them
            and stay as they are.

    Raises:
        MissingExtraError: The toolbox isn't installed.
        EngineError: A simulation of these values diverges.
        TrialError: Nothing tells where a trial begins.
    """
    sysid = toolbox()
    checked = problem.robot.space.check(values)
    parameters = sysid.ParameterDict()
    for parameter in problem.robot.space:
        name = parameter.name
        parameters.add(sysid.Parameter(name, checked[name], parameter.lower, parameter.upper))
    return SysidProblem(problem.robot, parameters, trajectories(problem, checked))


def _series(trajectory: Trajectory, model: mujoco.MjModel) -> tuple[Any, Any]:
    """Controls, the last of which the toolbox doesn't apply, and readings."""
    sysid = toolbox()
    times = model.opt.timestep * np.arange(len(trajectory.controls) + 1)
    controls = np.concatenate([trajectory.controls, trajectory.controls[-1:]])
    return (
        sysid.TimeSeries.from_control_names(times, controls, model),
        sysid.TimeSeries.from_names(trajectory.times, trajectory.readings, model),
    )


def _compared_columns(robot: Robot, model: mujoco.MjModel) -> tuple[NDArray[np.intp], Array, dict[str, Any]]:
    """What is compared, markers first: places among all readings, meters that a unit counts as [m/unit], and names.

    The names make a signal of each column, since the toolbox's report has no room for more in one.
    """
    first = model.nsensordata - 3 * len(robot.marker_names)
    columns = {
        f"{name} {'xyz'[axis]}": (first + 3 * i + axis, 1.0)
        for i, name in enumerate(robot.marker_names) for axis in robot.plane
    }  # fmt: skip
    columns |= {
        sensor.name: (sensor_address(model, sensor.name), sensor.meters_per_unit) for sensor in robot.trials.sensors
    }
    custom = toolbox().SignalType.CustomObs
    mapping = {name: (custom, np.array([i])) for i, name in enumerate(columns)}
    return np.array([at for at, _ in columns.values()]), np.array([scale for _, scale in columns.values()]), mapping


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
    """The problem that `save` wrote.

    Raises:
        ArgumentError: There are no trajectories, or they aren't this robot's.
        ParameterError: The parameters can't be read.
        MissingExtraError: The toolbox isn't installed.
    """
    sysid, place = toolbox(), Path(folder)
    stored = _read(place / BEGUN)
    values = robot.space.check(_values(stored, place / BEGUN), where=f"'{place / BEGUN}'")
    parameters = sysid.ParameterDict({name: stored[name] for name in values})  # the file is sorted by name
    for parameter in parameters.values():
        parameter.modifier = None  # which the file doesn't keep
    model = robot.build(values).compile()
    paths = sorted(place.glob("*.npz"))
    if not paths:
        raise ArgumentError(f"'{place}' has no trajectories; name a folder that `swim2real export-sysid` wrote")
    stored_trials: list[Trajectory] = []
    for path in paths:
        try:
            trial = sysid.SystemTrajectory.load_from_disk(path, model)
        except (OSError, EOFError, BadZipFile, KeyError, ValueError) as error:
            raise ArgumentError(f"'{path}' is no trajectory of robot '{robot.name}': {error}") from error
        measured = trial.sensordata
        stored_trials.append(
            Trajectory(path.stem, trial.initial_state, trial.control.data[:-1], measured.times, measured.data)
        )
    return SysidProblem(robot, parameters, stored_trials)


def read_values(path: str | Path, space: ParameterSpace, others: Values) -> dict[str, float]:
    """Values that the toolbox identified.

    Args:
        path: The toolbox's YAML file of parameters, or a folder with its results.
        space: Parameters whose names and bounds are allowed.
        others: Values of the parameters that the file doesn't have.

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
    values: dict[str, Any] = {}
    for name, parameter in parameters.items():
        number = np.asarray(parameter.value)
        if number.size != 1:
            raise ParameterError(f"parameter '{name}' in '{place}' has {number.size} numbers; it must have one")
        values[name] = number.item()
    return values
