"""Drives of actuators in a trial: a steady speed, a sine, a number, or a table of commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from swim2real.robots.targets import Delays
from swim2real.trials import Trial
from swimbase.arrays import Array
from swimbase.errors import EngineError, TrialError, about


@dataclass(frozen=True)
class Drive:
    """Command of an actuator: offset + amplitude sin(2 pi f t + phase), f being the trial's frequency.

    Attributes:
        amplitude: Amplitude in the actuator's unit; 0 for the same number in every trial.
        phase: Phase at the first time stamp [rad].
        offset: Mean value in the actuator's unit.
        speed: Whether it gets 2 pi f instead, the constant speed of a motor [rad/s].
        table: Whether it gets its column of the trial's table of controls instead.
        interpolated: Whether that goes from row to row on straight lines; otherwise a row holds until the next.
    """

    amplitude: float = 0.0
    phase: float = 0.0
    offset: float = 0.0
    speed: bool = False
    table: bool = False
    interpolated: bool = False

    def commands(self, times: Array, frequency: float, phase: float = 0.0) -> Array:
        """Commands of a drive without a table.

        Args:
            times: Times since the first time stamp [s]. Shape (N,).
            frequency: Frequency of the trial [Hz].
            phase: Phase of the beat at the first time stamp, beside the drive's own [rad].
        """
        if self.speed:
            return np.full(len(times), 2 * np.pi * frequency)
        if not self.amplitude:
            return np.full(len(times), float(self.offset))
        angles = 2 * np.pi * frequency * times + self.phase + phase
        return self.offset + self.amplitude * np.sin(angles)


SPEED, TABLE = Drive(speed=True), Drive(table=True)
INTERPOLATED = Drive(table=True, interpolated=True)


def commands(
    model: mujoco.MjModel, drives: Mapping[str, Drive], trial: Trial, times: Array, delays: Delays | None = None
) -> Array:
    """Controls of steps that begin at given times; an actuator that isn't named gets 0.

    Args:
        model: Compiled model of the robot.
        drives: What drives each actuator, by its name.
        trial: Trial whose table and frequency drive it.
        times: Times on the trial's clock [s]. Shape (N,).
        delays: By how much controls arrive late. Where a parameter says so, a step gets the mean of a table's commands
            during it, so that the loss is a smooth function of the delay.

    Returns:
        Shape (N, nu).

    Raises:
        EngineError: The model has no such actuator.
        TrialError: The trial has no such column, or no frequency.
    """
    names = [model.actuator(i).name for i in range(model.nu)]
    out = np.zeros((len(times), model.nu))
    for name, drive in drives.items():
        if name not in names:
            raise EngineError(
                f"actuator '{name}' is to be driven; the model has {', '.join(names) or 'no actuators'}; "
                f"name one of these"
            )
        late = None if delays is None else delays.control(name, trial.name)
        if drive.table:
            over = 0.0 if late is None else model.opt.timestep
            column = _recorded(name, trial, times - (late or 0.0), over, drive.interpolated)
        else:
            if trial.nominal_frequency is None and (drive.speed or drive.amplitude):
                raise TrialError(
                    f"trial '{trial.name}' has no nominal frequency, which drives actuator '{name}'; write it into "
                    f"reference.json"
                )
            since = times - (late or 0.0) - trial.track.times[0]
            column = drive.commands(since, trial.nominal_frequency or 0.0)
        out[:, names.index(name)] = column
    return out


def _recorded(name: str, trial: Trial, times: Array, over: float, interpolated: bool) -> Array:
    if trial.controls is None:
        raise TrialError(
            f"trial '{trial.name}' has no controls; actuator '{name}' needs a table with a column of its name"
        )
    with about(f"trial '{trial.name}': the controls don't drive actuator '{name}'"):
        return trial.controls.at(name, times, over, interpolated=interpolated)
