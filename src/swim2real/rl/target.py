"""Swimming to a goal on the water, with a curriculum of goals that are farther away and must be met more closely."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rl.observation import Reading
from swim2real.rl.task import PLACES, RATES, layout

Array = NDArray[np.float64]

SUCCESS_BONUS = 300.0
ACTION_COST = 0.5


@dataclass(frozen=True)
class Stage:
    """One stage of the curriculum.

    Attributes:
        ahead: How far ahead of the start goals are at most [m].
        across: Width of the region of goals, half to either side [m].
        threshold: A goal is reached from nearer than this [m].
        seconds: Length of an episode [s].
    """

    ahead: float
    across: float
    threshold: float
    seconds: float


STAGES = {
    1: Stage(1.0, 1.0, 0.10, 15.0),
    2: Stage(2.0, 2.5, 0.075, 30.0),
    3: Stage(3.0, 4.0, 0.05, 45.0),
}
"""The paper's curriculum, 1x1 m to 3x4 m and 10 to 5 cm. The stage between and the lengths of episodes are ours."""

_NAMES, _BOUNDS = layout(
    {
        "motor_cosine": (1, 1.0),
        "motor_sine": (1, 1.0),
        "motor_speed": (1, RATES),
        "head_turning": (3, RATES),
        "tail_angles": (5, PLACES),
        "tail_rates": (5, RATES),
        "goal_distance": (1, PLACES),
        "goal": (2, PLACES),
        "goal_rate": (2, RATES),
        "previous_action": (1, 1.0),
    }
)


class Target:
    """22 observations; reward -d - 0.5 |a|, and 300 more when the goal is reached, which ends the episode.

    d [m] is the distance of the head from the goal. The goal's direction is seen from the robot, x backward and y to
    its side. So is the rate at which it changes: the robot's velocity in the world, reversed.

    Attributes:
        goal: Of the episode [m]. Shape (2,).
        stage: Of the curriculum. A new one counts from the next episode on.
    """

    OBSERVATION_NAMES: ClassVar[Mapping[str, slice]] = _NAMES
    bounds: ClassVar[Array] = _BOUNDS
    needs_markers: ClassVar[bool] = False

    def __init__(self, stage: int = 3, seconds: float | None = None) -> None:
        """Begins with a stage of the curriculum; without `seconds` episodes are as long as it says."""
        self._length = seconds
        self.stage = stage
        self._playing, self._now = stage, STAGES[stage]
        self.goal = np.array([-self._now.ahead, 0.0])

    @property
    def stage(self) -> int:
        return self._stage

    @stage.setter
    def stage(self, number: int) -> None:
        if number not in STAGES:
            raise ArgumentError(f"the curriculum has no stage {number}; there are {', '.join(map(str, STAGES))}")
        self._stage = number

    @property
    def seconds(self) -> float:
        return self._now.seconds if self._length is None else self._length

    @property
    def threshold(self) -> float:
        """The goal is reached from nearer than this [m]."""
        return self._now.threshold

    def begin(self, rng: np.random.Generator, options: Mapping[str, Any]) -> None:
        self._playing, self._now = self._stage, STAGES[self._stage]
        stage = self._now
        if "goal" in options:
            self.goal[:] = options["goal"]
            return
        while True:
            self.goal[:] = rng.uniform((-stage.ahead, -stage.across / 2), (0.0, stage.across / 2))
            if math.hypot(*self.goal) > 2 * stage.threshold:  # not where the robot is already
                return

    def observe(self, reading: Reading, action: float, out: Array) -> None:
        c, s = math.cos(reading.heading), math.sin(reading.heading)
        x, y = self.goal[0] - reading.position[0], self.goal[1] - reading.position[1]
        vx, vy = -reading.velocity[0], -reading.velocity[1]
        out[0], out[1] = math.cos(reading.motor_angle), math.sin(reading.motor_angle)
        out[2] = reading.motor_speed
        out[3:6] = reading.turning
        out[6:11] = reading.tail_angles
        out[11:16] = reading.tail_rates
        out[16] = math.hypot(x, y)
        out[17], out[18] = c * x + s * y, c * y - s * x
        out[19], out[20] = c * vx + s * vy, c * vy - s * vx
        out[21] = action

    def judge(self, reading: Reading, action: float) -> tuple[float, bool]:
        away = self._away(reading)
        reached = away < self._now.threshold
        return -away - ACTION_COST * abs(action) + SUCCESS_BONUS * reached, reached

    def facts(self, reading: Reading) -> dict[str, Any]:
        goal = (float(self.goal[0]), float(self.goal[1]))
        return {"goal": goal, "goal_distance": self._away(reading), "stage": self._playing}

    def _away(self, reading: Reading) -> float:
        return math.hypot(self.goal[0] - reading.position[0], self.goal[1] - reading.position[1])
