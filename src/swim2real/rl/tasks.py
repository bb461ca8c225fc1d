"""Tasks of policies: go forward, go to a goal with a curriculum of farther goals, or a task of one's own."""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from swim2real import consent
from swim2real.formatting import listed, shortened
from swim2real.rl.state import MOST_PLACE, MOST_RATE, RobotState
from swim2real.robots.named_code import NamedCode, request
from swim2real.robots.robot import Robot
from swimbase.arrays import Array, Mask
from swimbase.errors import ArgumentError
from swimbase.names import label_fault, quoted

ENTRY_POINTS = "swim2real.tasks"  # group of those by which a package offers tasks
_NEEDED = ("observes", "adds", "needs_frame", "stages", "begin", "observe", "score")  # of a task's class
_LATE = 10.0  # s of import after which it is reported
_log = logging.getLogger(__name__)
SUCCESS_SHARE = 0.7  # of the last episodes, that ends a stage of the curriculum
SUCCESS_WINDOW = 50  # episodes


class Task(Protocol):
    """Observations, rewards, starts and ends of N robots.

    A class is one whose `MyTask(robot, count)` is a task. What an episode is about is kept in attributes that are NumPy
    arrays with a row per robot: those are saved and restored with a training. A class may name in `takes` the settings
    `near_goals` and `turn_reward`, which then become attributes of the task.

    Attributes:
        observes: Parts of the robot that a policy sees by default, as `rl.state.PARTS` names them.
        adds: Length and greatest magnitude of each part that the task adds to the observation.
        needs_frame: Whether it is about where the robot is and points.
        stages: Stages of the curriculum, in order; empty without one.
        discount: Of rewards, a step, where the settings of a training don't say.
    """

    observes: ClassVar[tuple[str, ...]]
    adds: ClassVar[Mapping[str, tuple[int, float]]]
    needs_frame: ClassVar[bool]
    stages: ClassVar[tuple[int, ...]]
    discount: ClassVar[float]

    def begin(self, index: int, rng: np.random.Generator, options: Mapping[str, Any]) -> float:
        """Begins an episode of one robot, draws what is random in it, and returns its length [s]."""
        ...

    def observe(self, state: RobotState) -> Array:
        """Part of the observation that the task adds, from a state or an estimate of it. Shape (N, sum of lengths)."""
        ...

    def score(self, state: RobotState, actions: Array) -> tuple[Array, Mask]:
        """Rewards of a step and whether the task is done, from true states after it and actions (N, A). Shapes (N,)."""
        ...

    def info(self, state: RobotState, index: int) -> Mapping[str, object]:
        """Entries of one robot's info that only this task has."""
        ...


class Forward:
    """Swimming or walking forward, as far as possible in two seconds, from rest.

    The reward of a step is how far forward the robot is, -x [m], after it (the paper, Sec. IV). So an episode's return
    is a sum of distances over 100 steps: it isn't the distance at the end.
    """

    observes: ClassVar[tuple[str, ...]] = (
        "position", "heading", "velocity", "heading_rate", "motor_directions", "motor_speeds", "joint_angles",
        "joint_rates", "sensors", "commands",
    )  # fmt: skip
    adds: ClassVar[Mapping[str, tuple[int, float]]] = {}
    needs_frame: ClassVar[bool] = True
    stages: ClassVar[tuple[int, ...]] = ()
    discount: ClassVar[float] = 0.99  # the paper's

    def __init__(self, robot: Robot, count: int, seconds: float = 2.0) -> None:
        del robot
        self._seconds, self._nothing = seconds, np.zeros((count, 0))

    def begin(self, index: int, rng: np.random.Generator, options: Mapping[str, Any]) -> float:
        del index, rng, options
        return self._seconds

    def observe(self, state: RobotState) -> Array:
        del state
        return self._nothing

    def score(self, state: RobotState, actions: Array) -> tuple[Array, Mask]:
        del actions
        return -state.position[:, 0], np.zeros(len(state.position), np.bool_)

    def info(self, state: RobotState, index: int) -> Mapping[str, object]:
        del state, index
        return {}


@dataclass(frozen=True)
class _CurriculumStage:
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
    1: _CurriculumStage(1.0, 1.0, 0.10, 30.0),
    2: _CurriculumStage(2.0, 2.5, 0.075, 60.0),
    3: _CurriculumStage(3.0, 4.0, 0.05, 90.0),
}
"""The paper's curriculum, 1x1 m to 3x4 m and 10 to 5 cm. The stage between and the lengths of episodes are ours.

The real fish swims at most 0.12 m/s, so the farthest goals are 10, 20 and 30 s away; a turn takes as long again.
"""


class ReachGoal:
    """Going to a goal in the plane.

    The reward of a step is 100 times the way [m] by which the goal has come nearer, minus 0.02 times the mean magnitude
    of the actions, and 20 more when the goal is reached: the episode's end. The way is the distance, and `turn_reward`
    per radian from ahead to the goal: a slow turn pays off later than the discount looks ahead. The goal's direction is
    seen from the robot, x backward and y to its side. So is the rate at which it changes: the velocity, reversed.

    Attributes:
        goals: Goals of the episodes [m]. Shape (N, 2).
        stage: Stage of the curriculum. A new one counts from the next episode on.
        takes: Settings of a training that are attributes of the task.
        near_goals: Share of the episodes whose goal is one of an earlier stage, to be met as closely as the present
            stage asks for. They count as episodes of that earlier stage.
        turn_reward: Distance by which the goal counts as nearer after a turn of 1 rad toward it [m].
    """

    PROGRESS: ClassVar[float] = 100.0
    ACTION_COST: ClassVar[float] = 0.02
    BONUS: ClassVar[float] = 20.0

    observes: ClassVar[tuple[str, ...]] = (
        "motor_directions", "motor_speeds", "turning", "joint_angles", "joint_rates", "sensors", "commands",
        "previous_actions",
    )  # fmt: skip
    adds: ClassVar[Mapping[str, tuple[int, float]]] = {
        "goal_distance": (1, MOST_PLACE), "goal": (2, MOST_PLACE), "goal_rate": (2, MOST_RATE),
    }  # fmt: skip
    needs_frame: ClassVar[bool] = True
    stages: ClassVar[tuple[int, ...]] = tuple(STAGES)
    discount: ClassVar[float] = 0.995  # 4 s: a turn takes some beats
    takes: ClassVar[tuple[str, ...]] = ("near_goals", "turn_reward")

    def __init__(self, robot: Robot, count: int, seconds: float | None = None, stage: int = 3) -> None:
        """Begins with a stage of the curriculum; without `seconds` episodes are as long as it says.

        Raises:
            ArgumentError: There is no such stage.
        """
        del robot
        if stage not in STAGES:
            raise ArgumentError(f"the curriculum has no stage {stage}; there are {', '.join(map(str, STAGES))}")
        self._seconds, self.stage, self.near_goals, self.turn_reward = seconds, stage, 0.0, 0.0
        self.goals, self.thresholds, self.before = np.zeros((count, 2)), np.zeros(count), np.zeros(count)
        self.episode_stages = np.zeros(count, int)

    def begin(self, index: int, rng: np.random.Generator, options: Mapping[str, Any]) -> float:
        stage, threshold = self.stage, STAGES[self.stage].threshold
        if self.near_goals and stage > 1 and rng.random() < self.near_goals:
            stage = int(rng.integers(1, stage))
        region = STAGES[stage]
        self.episode_stages[index], self.thresholds[index] = stage, threshold
        if "goal" in options:
            self.goals[index] = options["goal"]
        else:
            goal = np.zeros(2)
            while math.hypot(*goal) <= 2 * threshold:  # not where the robot is already
                goal = rng.uniform((-region.ahead, -region.across / 2), (0.0, region.across / 2))
            self.goals[index] = goal
        self.before[index] = self._way(*self.goals[index])
        return region.seconds if self._seconds is None else self._seconds

    def observe(self, state: RobotState) -> Array:
        goal = _seen(self.goals - state.position, state.heading)
        return np.column_stack([self._distances(state), *goal, *_seen(-state.velocity, state.heading)])

    def score(self, state: RobotState, actions: Array) -> tuple[Array, Mask]:
        reached = self._distances(state) < self.thresholds
        way = self._way(*_seen(self.goals - state.position, state.heading))
        nearer, self.before[:] = self.before - way, way
        cost = self.ACTION_COST * np.abs(actions).mean(axis=1)
        return self.PROGRESS * nearer - cost + self.BONUS * reached, reached

    def info(self, state: RobotState, index: int) -> Mapping[str, object]:
        goal = (float(self.goals[index, 0]), float(self.goals[index, 1]))
        distance, stage = float(self._distances(state)[index]), int(self.episode_stages[index])
        return {"goal": goal, "goal_distance": distance, "stage": stage}

    def _distances(self, state: RobotState) -> Array:
        return np.hypot(*(self.goals - state.position).T)

    def _way(self, x: Any, y: Any) -> Any:
        return np.hypot(x, y) + self.turn_reward * np.abs(np.arctan2(y, -x))


def _seen(vectors: Array, heading: Array) -> tuple[Array, Array]:
    """Vectors of the plane as robots see them: x backward, y to their side. Shapes (N, 2), (N,) to (N,) each."""
    (x, y), cosine, sine = vectors.T, np.cos(heading), np.sin(heading)
    return cosine * x + sine * y, cosine * y - sine * x


class PaperReachGoal(ReachGoal):
    """Going to a goal, with the paper's reward: -d - 0.5 |a| a step, and 300 more when the goal is reached (Sec. IV).

    d [m] is the distance of the robot from the goal, |a| the mean magnitude of the actions.
    """

    discount: ClassVar[float] = 0.99
    takes: ClassVar[tuple[str, ...]] = ("near_goals",)

    def score(self, state: RobotState, actions: Array) -> tuple[Array, Mask]:
        distances = self._distances(state)
        reached = distances < self.thresholds
        return -distances - 0.5 * np.abs(actions).mean(axis=1) + 300.0 * reached, reached


TASKS: Mapping[str, type[Any]] = {"forward": Forward, "target": ReachGoal, "paper-target": PaperReachGoal}


def find_task(name: str) -> type[Any]:
    """The class of a task: a built-in one, one of an installed package, or one of a Python file.

    Passing a name permits its code to run, which is remembered; names read from files go through `check_allowed` first.

    Args:
        name: `forward`, `target`, `paper-target`, the name of an entry point in the group `swim2real.tasks`, or
            `python:FILE.py:CLASS` or `python:MODULE:CLASS`.

    Raises:
        ArgumentError: There is no such task, it is no task, can't be imported, or is offered twice.
    """
    if name in TASKS:  # ours, whatever packages call theirs
        return TASKS[name]
    where, code = f"task {quoted(name)}", NamedCode.parse(name, Path())
    if code is not None:
        check_allowed(name, where, allow_code=True)
        return _loaded(code.load, where)
    offers, unread = _offers()
    if name not in offers:
        there = shortened(", ".join([*TASKS, *(quoted(other)[1:-1] for other in sorted(offers))]), 1000)
        also = "".join(f"; the entry points of package {quoted(package)} can't be read" for package in unread)
        raise ArgumentError(
            f"there is no {where}; there are {there}, or give a class of your own as python:FILE.py:CLASS{also}"
        )
    one, *more = places = [f"package {quoted(package)} as {quoted(point.value)}" for package, point in offers[name]]
    if more:
        raise ArgumentError(f"{where} is offered by {listed(places)}; remove one, or name it as python:MODULE:CLASS")
    if fault := label_fault(name):
        raise ArgumentError(f"{where} of {one} {fault}")
    return _loaded(offers[name][0][1].load, f"{where} of {one}")


def _offers() -> tuple[dict[str, list[tuple[str, metadata.EntryPoint]]], list[str]]:
    """Package and entry point of each task that is offered, and packages whose entry points can't be read."""
    offers, seen, unread = dict[str, list[tuple[str, metadata.EntryPoint]]](), set[str](), list[str]()
    for package in metadata.distributions():
        try:
            name = str(package.name)
            if name in seen:  # behind another of this name on the path
                continue
            seen.add(name)
            for point in package.entry_points.select(group=ENTRY_POINTS):
                places = offers.setdefault(point.name, [])
                if all(point.value != other.value for _, other in places):
                    places.append((name, point))
        except Exception:  # whatever an installed package has there
            unread.append(Path(str(getattr(package, "_path", "?"))).stem)
    return offers, unread


def _loaded(load: Callable[[], Any], where: str) -> type[Any]:
    """A task's class. Its code may do anything, also end the program or never end."""
    late = threading.Timer(_LATE, _log.warning, (f"{where} is being imported for {_LATE} s; Ctrl-C ends it",))
    late.daemon = True
    late.start()
    try:
        found = load()
    except (Exception, SystemExit) as error:
        raise ArgumentError(f"{where} can't be imported: {shortened(f'{type(error).__name__}: {error}')}") from error
    finally:
        late.cancel()
    lacking = [name for name in _NEEDED if not hasattr(found, name)]
    if lacking or not isinstance(found, type):
        raise ArgumentError(f"{where} must be a class with {', '.join(_NEEDED)}; it {_lack(found, lacking)}")
    return found


def _lack(found: object, lacking: Sequence[str]) -> str:
    return f"lacks {listed(lacking)}" if isinstance(found, type) else f"is of the type {type(found).__name__}"


def check_allowed(name: str, where: str, *, allow_code: bool = False) -> None:
    """Checks that the code of a task may run.

    Args:
        name: The task, as `find_task` takes it.
        where: What names it.
        allow_code: Allow it now, and remember that.

    Raises:
        ConsentError: It names Python code that wasn't allowed.
    """
    code = NamedCode.parse(name, Path())
    asked = None if code is None else request(where, b"", [code])
    if asked is not None:
        consent.require(asked, allowed=allow_code)


class Curriculum:
    """Goes on to the next stage once most episodes of this one succeed.

    The paper names three stages but not when they change; 70 % of the last 50 episodes is ours. A policy that never
    gets there stays in its stage: farther goals would only teach it to stand still.

    Attributes:
        stage: Present stage; None where there are no stages.
    """

    def __init__(self, stages: Sequence[int]) -> None:
        """Begins with the first of the stages."""
        self._stages = tuple(stages)
        self.stage = self._stages[0] if stages else None
        self._recent: deque[bool] = deque(maxlen=SUCCESS_WINDOW)

    def note(self, success: bool, stage: int) -> None:
        """Counts the end of an episode, unless it was begun in an earlier stage."""
        if stage == self.stage:
            self._recent.append(success)

    def advance(self) -> bool:
        """Goes on to the next stage if this one is learned, and returns whether it did."""
        learned = len(self._recent) == SUCCESS_WINDOW and sum(self._recent) >= SUCCESS_SHARE * SUCCESS_WINDOW
        if not learned or self.stage is None or self.stage == self._stages[-1]:
            return False
        self.stage = self._stages[self._stages.index(self.stage) + 1]
        self._recent.clear()
        return True

    def state(self) -> tuple[int, list[bool]] | None:
        """State that a resumed run needs."""
        return None if self.stage is None else (self.stage, list(self._recent))

    def restore(self, state: tuple[int, list[bool]] | None) -> None:
        """Takes over what `state` returned."""
        if state is not None:
            self.stage, recent = state
            self._recent = deque(recent, maxlen=SUCCESS_WINDOW)
