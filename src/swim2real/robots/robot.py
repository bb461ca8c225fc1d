"""What a robot tells the rest of swim2real about itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.parameters import ParameterSpace, Values


@dataclass(frozen=True)
class Robot:
    """A robot that can be built for any parameter values.

    Attributes:
        name: As in parameters files.
        space: The parameters that are calibrated, with their default scale.
        build: Values to an MjSpec. The spec has one `framepos` sensor a marker, in order, and nothing else there.
        marker_names: M names, head first.
        rest_markers: Marker positions of the straight robot relative to the first, x toward the tail [m]. Shape (M, 2).
        surge_joints: The two joints that carry the robot along world x and y.
        motor_joint: The joint that an actuation turns.
        tail_markers: Indices of the markers whose sideways motion shows the beat best.
    """

    name: str
    space: ParameterSpace
    build: Callable[[Values], mujoco.MjSpec]
    marker_names: tuple[str, ...]
    rest_markers: NDArray[np.float64]
    surge_joints: tuple[str, str]
    motor_joint: str
    tail_markers: tuple[int, ...]

    @property
    def head_length(self) -> float:
        """Distance of the first two markers, which sets the scale of a video [m]."""
        return float(np.linalg.norm(self.rest_markers[1] - self.rest_markers[0]))
