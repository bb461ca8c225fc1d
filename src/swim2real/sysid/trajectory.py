"""A real trial as the toolbox takes it, whatever drives it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """A trial: the state that it begins in, what drives it, and what was measured.

    Attributes:
        name: Of the trial.
        state: Of the engine at time 0, as `physics_state` has it. Shape (S,).
        controls: Of every physics step. Shape (N, nu).
        times: Of the readings, since that state [s]. Shape (T,).
        readings: As the model's sensors give them, NaN where nothing was measured. Shape (T, nsensordata).
    """

    name: str
    state: Array
    controls: Array
    times: Array
    readings: Array


def marker_readings(robot: Robot, model: mujoco.MjModel, positions: Array) -> Array:
    """Readings of a film: the markers' coordinates in the plane of the camera, nothing else.

    Args:
        robot: Whose last sensors are its markers'.
        model: Compiled.
        positions: In the world, NaN where lost [m]. Shape (T, M, 2).

    Returns:
        Shape (T, nsensordata).
    """
    readings = np.full((len(positions), model.nsensordata), np.nan)
    markers = readings[:, -3 * len(robot.marker_names) :].reshape(len(positions), -1, 3)
    markers[:, :, list(robot.plane)] = positions
    readings[:, -3 * len(robot.marker_names) :] = markers.reshape(len(positions), -1)
    return readings


def placed(name: str, positions: Array, begun: Array) -> Array:
    """A track moved and turned as a whole, such that its first frames meet simulated ones.

    Args:
        name: Of the trial.
        positions: In the world of the camera, NaN where lost [m]. Shape (T, M, 2).
        begun: Simulated, at the first K frames [m]. Shape (K, M, 2).

    Returns:
        In the world of the simulation [m]. Shape (T, M, 2).

    Raises:
        TrialError: Too few markers are seen in these frames.
    """
    real, simulated = positions @ [1, 1j], begun @ [1, 1j]
    first = real[: len(simulated)]
    seen = np.isfinite(first)
    here, there = first[seen], simulated[seen]
    if len(here) < 2:
        raise TrialError(
            f"trial '{name}': fewer than two markers are seen in its first {len(simulated)} frames, so nothing tells "
            f"where it begins; cut the video"
        )
    turn = np.vdot(here - here.mean(), there - there.mean())
    moved = (real - here.mean()) * (turn / abs(turn)) + there.mean()
    return np.stack([moved.real, moved.imag], axis=-1)
