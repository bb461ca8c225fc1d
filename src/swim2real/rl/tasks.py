"""What a policy is to do: swim forward, or to a goal, with a curriculum of goals that get harder to reach."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rl.body import FISH_LAYOUT, BodyState, wrap_angle

Array = NDArray[np.float64]

MOST_PLACE, MOST_RATE = 100.0, 1000.0  # greatest distances [m] and speeds [m/s or rad/s] that can be believed
SUCCESS_BONUS = 300.0
ACTION_COST = 0.5
SUCCESS_SHARE = 0.7  # of the last episodes, that ends a stage of the curriculum
SUCCESS_WINDOW = 50  # episodes


class Task(Protocol):
    """Observations, rewards, starts and ends. Each environment has a task of its own, which keeps an episode's goal.

    Attributes:
        OBSERVATION_NAMES: Where in an observation each part of it is.
        bounds: Greatest magnitude of each number that can be believed; beyond it the simulation has diverged.
        needs_markers: Whether the observation has markers in it.
    """

    OBSERVATION_NAMES: ClassVar[Mapping[str, slice]]
    bounds: ClassVar[Array]
    needs_markers: ClassVar[bool]

    @property
    def seconds(self) -> float:
        """Length of an episode [s]."""
        ...

    def begin(self, rng: np.random.Generator, options: Mapping[str, Any]) -> None:
        """Begins an episode and draws what is random in it."""
        ...

    def observe(self, state: BodyState, action: float, out: Array) -> None:
        """Writes the observation of a state after an action."""
        ...

    def score(self, state: BodyState, action: float) -> tuple[float, bool]:
        """Reward of a step, and whether the task is done, from the true state after it."""
        ...

    def info(self, state: BodyState) -> dict[str, Any]:
        """Entries of a step's info that only this task has."""
        ...


def observation_layout(parts: Mapping[str, tuple[int, float]]) -> tuple[dict[str, slice], Array]:
    """Slices and bounds of an observation, from the length and the bound of each part of it."""
    names: dict[str, slice] = {}
    bounds: list[float] = []
    for name, (length, bound) in parts.items():
        names[name] = slice(len(bounds), len(bounds) + length)
        bounds += [bound] * length
    return names, np.array(bounds)


_FORWARD_NAMES, _FORWARD_BOUNDS = observation_layout(
    {
        "marker_positions": (2 * FISH_LAYOUT.markers, MOST_PLACE),
        "marker_velocities": (2 * FISH_LAYOUT.markers, MOST_RATE),
        "head_position": (2, MOST_PLACE),
        "heading": (1, MOST_PLACE),
        "head_velocity": (2, MOST_RATE),
        "heading_rate": (1, MOST_RATE),
        "motor_angle": (1, math.pi),
        "motor_speed": (1, MOST_RATE),
    }
)


class Forward:
    """Swimming forward, as far as possible in two seconds, from rest.

    52 observations; the reward of a step is how far forward the head is, -x [m], after it (the paper, Sec. IV). So an
    episode's return is a sum of distances over 100 steps: it isn't the distance at the end. The markers are the nine
    that are tracked, x and y of each in turn, then the left and the right fin tip. The motor's angle is between -π and
    π; all other observations are in SI units.
    """

    OBSERVATION_NAMES: ClassVar[Mapping[str, slice]] = _FORWARD_NAMES
    bounds: ClassVar[Array] = _FORWARD_BOUNDS
    needs_markers: ClassVar[bool] = True

    def __init__(self, seconds: float = 2.0) -> None:
        self.seconds = seconds

    def begin(self, rng: np.random.Generator, options: Mapping[str, Any]) -> None:
        pass

    def observe(self, state: BodyState, action: float, out: Array) -> None:
        out[0:22] = state.markers.ravel()
        out[22:44] = state.marker_velocities.ravel()
        out[44:46] = state.position
        out[46] = state.heading
        out[47:49] = state.velocity
        out[49] = state.turning[2]
        out[50] = wrap_angle(state.motor_angle)
        out[51] = state.motor_speed

    def score(self, state: BodyState, action: float) -> tuple[float, bool]:
        return -float(state.position[0]), False

    def info(self, state: BodyState) -> dict[str, Any]:
        return {}


@dataclass(frozen=True)
class Stage:
    """One stage of the curriculum.

    Attributes:
        ahead: Greatest distance of a goal ahead of the start [m].
        across: Width of the region of goals, half to either side [m].
        threshold: Distance below which a goal is reached [m].
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

_TARGET_NAMES, _TARGET_BOUNDS = observation_layout(
    {
        "motor_cosine": (1, 1.0),
        "motor_sine": (1, 1.0),
        "motor_speed": (1, MOST_RATE),
        "head_turning": (3, MOST_RATE),
        "tail_angles": (FISH_LAYOUT.tail_count, MOST_PLACE),
        "tail_rates": (FISH_LAYOUT.tail_count, MOST_RATE),
        "goal_distance": (1, MOST_PLACE),
        "goal": (2, MOST_PLACE),
        "goal_rate": (2, MOST_RATE),
        "previous_action": (1, 1.0),
    }
)


class Target:
    """Swimming to a goal on the water.

    22 observations; the reward of a step is -d - 0.5 |a|, and 300 more when the goal is reached, which ends the
    episode. d [m] is the distance of the head from the goal. The goal's direction is seen from the robot, x backward
    and y to its side. So is the rate at which it changes: the robot's velocity in the world, reversed.

    Attributes:
        goal: Goal of the episode [m]. Shape (2,).
        stage: Stage of the curriculum. A new one counts from the next episode on.
    """

    OBSERVATION_NAMES: ClassVar[Mapping[str, slice]] = _TARGET_NAMES
    bounds: ClassVar[Array] = _TARGET_BOUNDS
    needs_markers: ClassVar[bool] = False

    def __init__(self, stage: int = 3, seconds: float | None = None) -> None:
        """Begins with a stage of the curriculum; without `seconds` episodes are as long as it says."""
        self._seconds = seconds
        self.stage = stage
        self._episode_stage, self._region = stage, STAGES[stage]
        self.goal = np.array([-self._region.ahead, 0.0])

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
        return self._region.seconds if self._seconds is None else self._seconds

    @property
    def threshold(self) -> float:
        """Distance below which the goal is reached [m]."""
        return self._region.threshold

    def begin(self, rng: np.random.Generator, options: Mapping[str, Any]) -> None:
        self._episode_stage, self._region = self._stage, STAGES[self._stage]
        region = self._region
        if "goal" in options:
            self.goal[:] = options["goal"]
            return
        while True:
            self.goal[:] = rng.uniform((-region.ahead, -region.across / 2), (0.0, region.across / 2))
            if math.hypot(*self.goal) > 2 * region.threshold:  # not where the robot is already
                return

    def observe(self, state: BodyState, action: float, out: Array) -> None:
        c, s = math.cos(state.heading), math.sin(state.heading)
        x, y = self.goal[0] - state.position[0], self.goal[1] - state.position[1]
        vx, vy = -state.velocity[0], -state.velocity[1]
        out[0], out[1] = math.cos(state.motor_angle), math.sin(state.motor_angle)
        out[2] = state.motor_speed
        out[3:6] = state.turning
        out[6:11] = state.tail_angles
        out[11:16] = state.tail_rates
        out[16] = math.hypot(x, y)
        out[17], out[18] = c * x + s * y, c * y - s * x
        out[19], out[20] = c * vx + s * vy, c * vy - s * vx
        out[21] = action

    def score(self, state: BodyState, action: float) -> tuple[float, bool]:
        distance = self._distance(state)
        reached = distance < self._region.threshold
        return -distance - ACTION_COST * abs(action) + SUCCESS_BONUS * reached, reached

    def info(self, state: BodyState) -> dict[str, Any]:
        goal = (float(self.goal[0]), float(self.goal[1]))
        return {"goal": goal, "goal_distance": self._distance(state), "stage": self._episode_stage}

    def _distance(self, state: BodyState) -> float:
        return math.hypot(self.goal[0] - state.position[0], self.goal[1] - state.position[1])


class Curriculum:
    """Goes on to the next stage once most episodes of this one succeed.

    The paper names three stages but not when they change; 70 % of the last 50 episodes is ours. A policy that never
    gets there stays in its stage: farther goals would only teach it to stand still.

    Attributes:
        stage: Present stage.
    """

    def __init__(self, stages: Sequence[int]) -> None:
        """Begins with the first of the stages."""
        self._stages = tuple(stages)
        self.stage = self._stages[0]
        self._recent: deque[bool] = deque(maxlen=SUCCESS_WINDOW)

    def note(self, success: bool, stage: int) -> None:
        """Counts the end of an episode, unless it was begun in an earlier stage."""
        if stage == self.stage:
            self._recent.append(success)

    def advance(self) -> bool:
        """Goes on to the next stage if this one is learned, and returns whether it did."""
        index = self._stages.index(self.stage)
        learned = len(self._recent) == SUCCESS_WINDOW and sum(self._recent) >= SUCCESS_SHARE * SUCCESS_WINDOW
        if not learned or index + 1 == len(self._stages):
            return False
        self.stage = self._stages[index + 1]
        self._recent.clear()
        return True

    def state(self) -> tuple[int, list[bool]]:
        """What a resumed run needs."""
        return self.stage, list(self._recent)

    def restore(self, state: tuple[int, list[bool]]) -> None:
        """Takes over what `state` returned."""
        self.stage, recent = state
        self._recent = deque(recent, maxlen=SUCCESS_WINDOW)
