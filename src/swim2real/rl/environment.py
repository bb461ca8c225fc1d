"""The swimming robot as a Gymnasium environment: one action a control interval of 20 ms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, SupportsFloat, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.parameters import Values
from swim2real.rl.body import Bodies
from swim2real.rl.disturbances import UNDISTURBED, Disturbances
from swim2real.rl.forward import Forward
from swim2real.rl.motor import CONTROL_INTERVAL, REAL_MOTOR, Motor
from swim2real.rl.observation import Reading, Swimmer
from swim2real.rl.target import Target
from swim2real.rl.task import Task
from swim2real.rl.tracked import Tracked
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]
Observation = NDArray[np.float32]
TaskName = Literal["forward", "target"]

DIVERGED = -1000.0  # reward of a step that the simulation can't make


class SwimEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One robot in the water and its task.

    The action is the motor's acceleration, from -1 to 1; the motor's speed is what the robot is sent. An episode ends
    when the task is done, when its time is over (truncated), or when the simulation diverges: then the reward is
    `DIVERGED`, the observation is the last good one, and `info["diverged"]` is a sentence.

    Every step's info has the `time` since the start [s], the forward `distance` of the head since then [m], its
    `position` [m] and `heading` [rad], the `command` that the step was made with [rad/s], and `success`. They are true,
    whatever the observation is made from; a target's also have its `goal` [m], `goal_distance` [m] and `stage`. `reset`
    takes options: `phase`, the motor's angle [rad]; `member`, of an ensemble; `goal` [m].

    Attributes:
        task: What is to be done.
        motor: What acts.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": [],
        "render_fps": round(1 / CONTROL_INTERVAL),
    }

    def __init__(self, task: Task, bodies: Bodies, motor: Motor = REAL_MOTOR, seed: int | None = None) -> None:
        """Makes the environment; the seed is that of the first `reset` that is given none."""
        self.task, self.motor = task, motor
        self.render_mode = None
        self._bodies, self._disturbances = bodies, bodies.disturbances
        self._seed = seed
        bounds = task.bounds.astype(np.float32)
        self.observation_space = spaces.Box(-bounds, bounds, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._swimmers: dict[int, Swimmer] = {}
        self._seen, self._good = np.zeros(len(bounds)), np.zeros(len(bounds))
        estimate = self._disturbances.estimate
        self._tracked = None if estimate is None else Tracked(estimate)
        self._markers = task.needs_markers or self._tracked is not None
        self._swimmer: Swimmer | None = None
        self.command, self._action, self._steps, self._last = 0.0, 0.0, 0, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode at rest."""
        if seed is None and self._seed is not None:
            seed = self._seed
        self._seed = None
        super().reset(seed=seed)
        rng, chosen = self.np_random, options or {}
        member = int(rng.integers(len(self._bodies)))
        phase = float(rng.uniform(*self._disturbances.start_phase))
        member, phase = int(chosen.get("member", member)), float(chosen.get("phase", phase))
        if not 0 <= member < len(self._bodies):
            raise ArgumentError(f"the ensemble has no member {member}; there are {len(self._bodies)}, from 0 on")
        if member not in self._swimmers:
            self._swimmers[member] = Swimmer(self._bodies[member])
        self._swimmer = swimmer = self._swimmers[member]
        self.task.begin(rng, chosen)
        self._last = round(self.task.seconds / CONTROL_INTERVAL)
        self.command, self._action, self._steps = 0.0, 0.0, 0
        swimmer.start(phase)
        reading = swimmer.read(self._markers)
        if self._tracked is not None:
            self._tracked.begin(swimmer.body, reading, rng)
        self._observe(reading)
        return self._good.astype(np.float32), self._info(reading, False)

    def step(self, action: NDArray[Any]) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Swims one control interval."""
        if self._swimmer is None or self._steps >= self._last:
            raise ArgumentError("no episode is on: call reset before step")
        self._action = act = min(max(float(action[0]), -1.0), 1.0)
        if math.isnan(act):
            raise ArgumentError("the action is nan; it must be a number from -1 to 1")
        self.command = self.motor.next_command(self.command, act)
        self._steps += 1
        if self._swimmer.advance(self.command):
            reading = self._swimmer.read(self._markers)
            if self._observe(reading):
                reward, done = self.task.judge(reading, act)
                info = self._info(reading, done)
                over = self._steps >= self._last
                if done:
                    self._last = self._steps
                return self._good.astype(np.float32), reward, done, over and not done, info
        time = self._steps * CONTROL_INTERVAL
        self._last = self._steps
        info = {
            **self._told,
            "time": time,
            "command": self.command,
            "diverged": f"the simulation diverged {time:.2f} s after the start, commanded {self.command:.2f} rad/s",
        }
        return self._good.astype(np.float32), DIVERGED, True, False, info

    @property
    def swimmer(self) -> Swimmer:
        """What swims in this episode.

        Raises:
            ArgumentError: None has begun.
        """
        if self._swimmer is None:
            raise ArgumentError("no episode has begun: call reset first")
        return self._swimmer

    def set_stage(self, stage: int) -> None:
        """Sets the stage of a target task's curriculum, from the next episode on.

        Raises:
            ArgumentError: The task has no stages, or not this one.
        """
        if not isinstance(self.task, Target):
            raise ArgumentError("only the task 'target' has a curriculum")
        self.task.stage = stage

    def _observe(self, reading: Reading) -> bool:
        """Writes the observation; False where it can't be believed."""
        seen = reading if self._tracked is None else self._tracked.see(reading)
        self.task.observe(seen, self._action, self._seen)
        if not (np.abs(self._seen) <= self.task.bounds).all():  # NaN too
            return False
        self._seen, self._good = self._good, self._seen
        return True

    def _info(self, reading: Reading, success: bool) -> dict[str, Any]:
        x, y = float(reading.position[0]), float(reading.position[1])
        self._told = {
            "time": self._steps * CONTROL_INTERVAL,
            "distance": -x,
            "position": (x, y),
            "heading": reading.heading,
            "command": self.command,
            "success": success,
            **self.task.facts(reading),
        }
        return dict(self._told)  # whoever gets it adds to it


def make_task(task: TaskName, stage: int = 3, seconds: float | None = None) -> Task:
    """The task of a name.

    Args:
        task: `forward` or `target`.
        stage: Of the curriculum of `target`.
        seconds: Length of an episode [s]; by default the task's own.

    Raises:
        ArgumentError: There is no such task, stage or length.
    """
    if task not in get_args(TaskName):
        raise ArgumentError(f"there is no task '{task}'; there are {', '.join(get_args(TaskName))}")
    if seconds is not None and not (math.isfinite(seconds) and seconds >= CONTROL_INTERVAL):
        raise ArgumentError(f"an episode of {seconds:g} s is asked for; it must have at least {CONTROL_INTERVAL} s")
    if task == "target":
        return Target(stage, seconds)
    return Forward() if seconds is None else Forward(seconds)


def make_env(
    task: TaskName, parameters: Values | Sequence[Values] | None = None, robot: Robot = FISH, *,
    disturbances: Disturbances = UNDISTURBED, stage: int = 3, seconds: float | None = None, motor: Motor = REAL_MOTOR,
    seed: int | None = None,
) -> SwimEnv:  # fmt: skip
    """An environment.

    Args:
        task: `forward` or `target`.
        parameters: Of the robot; of several sets one is drawn for every episode. By default the published ones.
        robot: What swims.
        disturbances: What the real water and robot add.
        stage: Of the curriculum of `target`.
        seconds: Length of an episode [s]; by default the task's own.
        motor: What it can do.
        seed: Of the first episode that is begun without one.

    Raises:
        ArgumentError: Something asked for isn't there.
        ParameterError: A value isn't allowed.
    """
    sets = robot.space.published if parameters is None else parameters
    return SwimEnv(make_task(task, stage, seconds), Bodies(robot, sets, disturbances), motor, seed)
