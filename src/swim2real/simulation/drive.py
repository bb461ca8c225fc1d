"""What drives a recording: the controls of every physics step."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import EngineError, TrialError
from swim2real.robots.robot import Control, Sine
from swim2real.trials import Trial

Array = NDArray[np.float64]


def driven(model: mujoco.MjModel, controls: Mapping[str, Control], trial: Trial, times: Array) -> Array:
    """Controls at given times; what isn't named gets 0.

    Args:
        model: Compiled robot.
        controls: By actuator.
        trial: Whose table and frequency drive it.
        times: On the trial's clock [s]. Shape (N,).

    Returns:
        Shape (N, nu).

    Raises:
        EngineError: The model has no such actuator.
        TrialError: The trial has no such column, or no frequency.
    """
    names = [model.actuator(i).name for i in range(model.nu)]
    out = np.zeros((len(times), model.nu))
    for name, control in controls.items():
        if name not in names:
            raise EngineError(
                f"actuator '{name}' is to be driven; the model has {', '.join(names) or 'no actuators'}; "
                f"name one of these"
            )
        out[:, names.index(name)] = _one(name, control, trial, times)
    return out


def _one(name: str, control: Control, trial: Trial, times: Array) -> Array | float:
    if control == "table":
        return _held(name, trial, times)
    if control == "frequency":
        return 2 * np.pi * _frequency(name, trial)
    if isinstance(control, Sine):
        angles = 2 * np.pi * _frequency(name, trial) * (times - trial.track.times[0]) + control.phase
        return control.offset + control.amplitude * np.sin(angles)
    return float(control)


def _held(name: str, trial: Trial, times: Array) -> Array:
    if trial.controls is None:
        raise TrialError(
            f"trial '{trial.name}' has no controls; actuator '{name}' needs a table with a column of its name"
        )
    try:
        return trial.controls.held(name, times)
    except TrialError as error:
        raise TrialError(f"trial '{trial.name}': the controls don't drive actuator '{name}': {error}") from error


def _frequency(name: str, trial: Trial) -> float:
    if trial.nominal_frequency is None:
        raise TrialError(
            f"trial '{trial.name}' has no nominal frequency, which drives actuator '{name}'; write it into "
            f"reference.json"
        )
    return trial.nominal_frequency
