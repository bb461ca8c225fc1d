"""A calibration problem as objects of the toolbox, ready for `mujoco.sysid.optimize`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import Problem
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.simulation.playback import sensor_address
from swim2real.sysid.recordings import recording_trajectories
from swim2real.sysid.swims import swim_trajectories
from swim2real.sysid.toolbox import toolbox
from swim2real.sysid.trajectory import Array, Trajectory


class SysidProblem:
    """Parameters and trials of a robot as the toolbox has them.

    Attributes:
        robot: Whose they are.
        parameters: A `ParameterDict`, each parameter within its bounds. One that is `frozen` stays as it is.
        sequences: A list of one `ModelSequences` with a sequence a trial. Readings are NaN where nothing was measured.
        residual: What `optimize` and `save_results` take as `residual_fn`: the distances of all markers that count [m]
            and the sensors' differences by their worth, such that the squares add up to the mean over trials of the
            mean squared distance.
    """

    def __init__(self, robot: Robot, parameters: Any, trajectories: Sequence[Trajectory]) -> None:
        """Makes the objects.

        Args:
            robot: Whose they are.
            parameters: A `ParameterDict` with the robot's parameters.
            trajectories: At least one.

        Raises:
            MissingExtraError: The toolbox isn't installed.
        """
        sysid = toolbox()
        self.robot, self.parameters = robot, parameters
        spec = robot.build(self._values(parameters))
        model = spec.compile()
        self._columns, self._worths, self._mapping = _compared_columns(robot, model)
        series = [_series(one, model) for one in trajectories]
        self.sequences = [
            sysid.ModelSequences(
                robot.name, spec, [one.name for one in trajectories], [one.state for one in trajectories],
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
            one.name: float(np.clip(parameters[one.name].value.item(), one.lower, one.upper))
            for one in self.robot.space
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
        weights = self._worths / np.sqrt(np.maximum(counts, 1.0) * len(self.sequences[0].sequence_name))
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
    for one in problem.robot.space:
        parameters.add(sysid.Parameter(one.name, checked[one.name], one.lower, one.upper))
    if problem.protocol.name == "playback":
        trajectories = recording_trajectories(problem, checked)
    else:
        trajectories = swim_trajectories(problem, checked)
    return SysidProblem(problem.robot, parameters, trajectories)


def _series(one: Trajectory, model: mujoco.MjModel) -> tuple[Any, Any]:
    """Controls, the last of which the toolbox doesn't apply, and readings."""
    sysid = toolbox()
    times = model.opt.timestep * np.arange(len(one.controls) + 1)
    controls = np.concatenate([one.controls, one.controls[-1:]])
    return (
        sysid.TimeSeries.from_control_names(times, controls, model),
        sysid.TimeSeries.from_names(one.times, one.readings, model),
    )


def _compared_columns(robot: Robot, model: mujoco.MjModel) -> tuple[NDArray[np.intp], Array, dict[str, Any]]:
    """What is compared, markers first: places among all readings, what a unit is worth [m/unit], and names.

    The names make a signal of each column, since the toolbox's report has no room for more in one.
    """
    first = model.nsensordata - 3 * len(robot.marker_names)
    found = {
        f"{name} {'xyz'[axis]}": (first + 3 * i + axis, 1.0)
        for i, name in enumerate(robot.marker_names) for axis in robot.plane
    }  # fmt: skip
    found |= {one.name: (sensor_address(model, one.name), one.meters_per_unit) for one in robot.trials.sensors}
    custom = toolbox().SignalType.CustomObs
    mapping = {name: (custom, np.array([i])) for i, name in enumerate(found)}
    return np.array([at for at, _ in found.values()]), np.array([worth for _, worth in found.values()]), mapping
