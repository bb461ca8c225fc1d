"""Swimming forward: as far as possible in two seconds, from rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swim2real.rl.observation import Reading, wrapped
from swim2real.rl.task import PLACES, RATES, layout

Array = NDArray[np.float64]

_NAMES, _BOUNDS = layout(
    {
        "marker_positions": (22, PLACES),
        "marker_velocities": (22, RATES),
        "head_position": (2, PLACES),
        "heading": (1, PLACES),
        "head_velocity": (2, RATES),
        "heading_rate": (1, RATES),
        "motor_angle": (1, math.pi),
        "motor_speed": (1, RATES),
    }
)


class Forward:
    """52 observations; the reward of a step is how far forward the head is, -x [m], after it (the paper, Sec. IV).

    So an episode's return is a sum of distances over 100 steps: it isn't the distance at the end. The markers are the
    nine that are tracked, x and y of each in turn, then the left and the right fin tip. The motor's angle is between -π
    and π; all others are what they are in SI units.
    """

    OBSERVATION_NAMES: ClassVar[Mapping[str, slice]] = _NAMES
    bounds: ClassVar[Array] = _BOUNDS
    needs_markers: ClassVar[bool] = True

    def __init__(self, seconds: float = 2.0) -> None:
        self.seconds = seconds

    def begin(self, rng: np.random.Generator, options: Mapping[str, Any]) -> None:
        pass

    def observe(self, reading: Reading, action: float, out: Array) -> None:
        out[0:22] = reading.markers.ravel()
        out[22:44] = reading.marker_velocities.ravel()
        out[44:46] = reading.position
        out[46] = reading.heading
        out[47:49] = reading.velocity
        out[49] = reading.turning[2]
        out[50] = wrapped(reading.motor_angle)
        out[51] = reading.motor_speed

    def judge(self, reading: Reading, action: float) -> tuple[float, bool]:
        return -float(reading.position[0]), False

    def facts(self, reading: Reading) -> dict[str, Any]:
        return {}
