"""The swimming robot as a Gymnasium environment: one action a control interval of 20 ms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, SupportsFloat, TypedDict, Unpack, get_args

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.parameters import Values
from swim2real.rl.body import Bodies, BodyState, Swimmer
from swim2real.rl.conditions import CONTROL_INTERVAL, REAL_MOTOR, UNDISTURBED, Disturbances, Motor
from swim2real.rl.state_estimation import StateEstimator
from swim2real.rl.tasks import Forward, Target, Task
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]
Observation = NDArray[np.float32]
TaskName = Literal["forward", "target"]

DIVERGED = -1000.0  # reward of a step that the simulation can't make

_PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION
# compiled robots are made anew in a resumed run; of the one that swims, the physics are kept
_NOT_SAVED = ("_bodies", "_swimmers", "_swimmer", "observation_space", "action_space", "spec")


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
        task: Task of the robot.
        motor: Motor that carries out the actions.
        command: Speed that the motor is sent [rad/s].
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": [],
        "render_fps": round(1 / CONTROL_INTERVAL),
    }

    def __init__(self, task: Task, bodies: Bodies, motor: Motor = REAL_MOTOR, seed: int | None = None) -> None:
        """Makes the environment.

        Args:
            task: Task of the robot.
            bodies: Parameter sets; one is drawn for every episode.
            motor: Motor that carries out the actions.
            seed: Seed of the first `reset` that is called without one.
        """
        self.task, self.motor = task, motor
        self.render_mode = None
        self._bodies, self._disturbances = bodies, bodies.disturbances
        self._seed = seed
        bounds = task.bounds.astype(np.float32)
        self.observation_space = spaces.Box(-bounds, bounds, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._swimmers: dict[int, Swimmer] = {}
        self._next_observation, self._observation = np.zeros(len(bounds)), np.zeros(len(bounds))
        estimate = self._disturbances.estimate
        self._estimator = None if estimate is None else StateEstimator(estimate)
        self._needs_markers = task.needs_markers or self._estimator is not None
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
        state = swimmer.read(self._needs_markers)
        if self._estimator is not None:
            self._estimator.begin(swimmer.body, state, rng)
        self._observe(state)
        return self._observation.astype(np.float32), self._make_info(state, False)

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
            state = self._swimmer.read(self._needs_markers)
            if self._observe(state):
                reward, done = self.task.score(state, act)
                info = self._make_info(state, done)
                over = self._steps >= self._last
                if done:
                    self._last = self._steps
                return self._observation.astype(np.float32), reward, done, over and not done, info
        time = self._steps * CONTROL_INTERVAL
        self._last = self._steps
        info = {
            **self._info,
            "time": time,
            "command": self.command,
            "diverged": f"the simulation diverged {time:.2f} s after the start, commanded {self.command:.2f} rad/s",
        }
        return self._observation.astype(np.float32), DIVERGED, True, False, info

    @property
    def swimmer(self) -> Swimmer:
        """The robot that swims in this episode.

        Raises:
            ArgumentError: No episode has begun.
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

    def save_state(self) -> dict[str, Any]:
        """Everything that decides how a running episode goes on, to be pickled."""
        swimmer = self.swimmer
        physics = np.empty(mujoco.mj_stateSize(swimmer.body.model, _PHYSICS))
        mujoco.mj_getState(swimmer.body.model, swimmer.data, physics, _PHYSICS)
        return {
            "member": next(member for member, known in self._swimmers.items() if known is swimmer),
            "physics": physics,
            "rest": {name: value for name, value in vars(self).items() if name not in _NOT_SAVED},
        }

    def restore_state(self, state: dict[str, Any]) -> None:
        """Goes on with the episode that `save_state` was called in."""
        self.reset(options={"member": state["member"]})
        swimmer = self.swimmer
        mujoco.mj_setState(swimmer.body.model, swimmer.data, state["physics"], _PHYSICS)
        for name, value in state["rest"].items():
            setattr(self, name, value)
        swimmer.read(markers=True)

    def _observe(self, state: BodyState) -> bool:
        """Writes the observation and returns whether it can be believed."""
        seen = state if self._estimator is None else self._estimator.update(state)
        self.task.observe(seen, self._action, self._next_observation)
        if not (np.abs(self._next_observation) <= self.task.bounds).all():  # NaN too
            return False
        self._next_observation, self._observation = self._observation, self._next_observation
        return True

    def _make_info(self, state: BodyState, success: bool) -> dict[str, Any]:
        x, y = float(state.position[0]), float(state.position[1])
        self._info = {
            "time": self._steps * CONTROL_INTERVAL,
            "distance": -x,
            "position": (x, y),
            "heading": state.heading,
            "command": self.command,
            "success": success,
            **self.task.info(state),
        }
        return dict(self._info)  # the receiver adds entries to it


def make_task(task: TaskName, stage: int = 3, seconds: float | None = None) -> Task:
    """The task of a name.

    Args:
        task: `forward` or `target`.
        stage: Stage of the curriculum of `target`.
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


class EnvironmentOptions(TypedDict, total=False):
    """Optional arguments of those that make environments.

    Attributes:
        robot: Robot that swims; by default the fish.
        disturbances: What the real water and robot add; by default nothing.
        stage: Stage of the curriculum of `target`; by default the last.
        seconds: Length of an episode [s]; by default the task's own.
        motor: Motor that carries out the actions; by default the real one.
        seed: Seed of the first environment's first episode that is begun without one.
    """

    robot: Robot
    disturbances: Disturbances
    stage: int
    seconds: float | None
    motor: Motor
    seed: int | None


def make_environments(
    task: TaskName, parameters: Values | Sequence[Values] | None, count: int, **options: Unpack[EnvironmentOptions]
) -> list[SwimEnv]:
    """Environments that share compiled robots. The i-th does what `make_env` with the seed + i does.

    Args:
        task: `forward` or `target`.
        parameters: Parameters of the robot; of several sets one is drawn for every episode. None for the published
            ones.
        count: Number of environments.
        options: See `EnvironmentOptions`.

    Raises:
        ArgumentError: There is no such task, stage or length, or no parameter set.
        ParameterError: A value isn't allowed.
    """
    robot, seed = options.get("robot", FISH), options.get("seed")
    sets = robot.space.published if parameters is None else parameters
    bodies = Bodies(robot, sets, options.get("disturbances", UNDISTURBED))
    stage, seconds, motor = options.get("stage", 3), options.get("seconds"), options.get("motor", REAL_MOTOR)
    return [
        SwimEnv(make_task(task, stage, seconds), bodies, motor, None if seed is None else seed + i)
        for i in range(count)
    ]


def make_env(
    task: TaskName, parameters: Values | Sequence[Values] | None = None, **options: Unpack[EnvironmentOptions]
) -> SwimEnv:
    """One environment; the arguments are those of `make_environments`."""
    return make_environments(task, parameters, 1, **options)[0]
