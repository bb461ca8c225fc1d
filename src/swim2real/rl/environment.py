"""Robots and their tasks as environments: N that step together, and one as Gymnasium has it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, SupportsFloat, TypedDict, Unpack, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swim2real.parameters import Values
from swim2real.rl.body import Bodies, Indices, policy_setup
from swim2real.rl.conditions import CONTROL_INTERVAL, UNDISTURBED, Disturbances
from swim2real.rl.state import PARTS, Robots
from swim2real.rl.state_estimation import StateEstimator
from swim2real.rl.tasks import Task, find_task
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Robot
from swimbase.arrays import Array, Mask
from swimbase.errors import ArgumentError

Observation = NDArray[np.float32]

DIVERGED = -1000.0  # reward of a step that the simulation can't make


@dataclass(frozen=True)
class _Stepped:
    """Results of a step of N environments; rows of those that weren't stepped mean nothing.

    Attributes:
        rewards: Rewards. Shape (N,).
        terminated: Whether the task is done or the simulation diverged. Shape (N,).
        truncated: Whether the time is over. Shape (N,).
        success: Whether the task is done. Shape (N,).
    """

    rewards: Array
    terminated: Mask
    truncated: Mask
    success: Mask

    @property
    def ended(self) -> Mask:
        """True where the episode is over."""
        return self.terminated | self.truncated


class Environments:
    """N robots and their task.

    An action is the rate of each command, from -1 to 1. An episode ends when the task is done, when its time is over
    (truncated), or when the simulation diverges: then the reward is `DIVERGED` and the observation is the last good
    one. What an environment does depends on its own seed and actions alone, not on the others or on the threads.

    Attributes:
        task: Task of the robots.
        bodies: Parameter sets; one is drawn for every episode.
        robots: The robots.
        state: Their true state.
        count: Number of environments.
        names: Where in an observation each part of it is.
        bounds: Greatest magnitude of each number that can be believed.
        observations: Present observations. Shape (N, n).
    """

    def __init__(self, task: Task, bodies: Bodies, count: int, *, task_name: str, threads: int = 1) -> None:
        """Makes environments that have to be reset.

        Args:
            task: Task of the robots, for as many of them.
            bodies: Parameter sets.
            count: Number of environments.
            task_name: Name of the task, as the robot file has it.
            threads: Threads that step them.

        Raises:
            ArgumentError: There is nothing to step, or the robot can't do the task.
        """
        if count < 1 or threads < 1:
            raise ArgumentError(f"{count} environments on {threads} threads are asked for; each must be at least 1")
        robot = bodies.robot
        if task.needs_frame and bodies.layout.frame is None:
            raise ArgumentError(
                f"task '{task_name}' needs a robot that points somewhere; name the two markers of its 'frame' in "
                f"[recordings] of the robot file of '{robot.name}', or train a task of your own"
            )
        self.task, self.bodies, self.count = task, bodies, count
        self.robots = Robots(bodies, count, threads)
        chosen = policy_setup(robot).observe.get(task_name)
        where = f"task '{task_name}'" if chosen is None else f"robot '{robot.name}', task '{task_name}',"
        names = task.observes if chosen is None else chosen
        if unknown := next((name for name in names if name not in PARTS), None):
            raise ArgumentError(f"{where} observes '{unknown}'; it must be one of {', '.join(PARTS)}")
        self._parts = [PARTS[name] for name in names]
        widths = [part.read(self.robots.state).shape[1] for part in self._parts]
        own = {name: (width, PARTS[name].bound) for name, width in zip(names, widths, strict=True)}
        self.names, bounds = dict[str, slice](), list[float]()
        for name, (length, bound) in {**own, **task.adds}.items():
            self.names[name] = slice(len(bounds), len(bounds) + length)
            bounds += [bound] * length
        self.bounds = np.array(bounds)
        self.state = self.robots.state
        self.observations = np.zeros((count, len(self.bounds)), np.float32)
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self._steps, self._last = np.zeros(count, int), np.zeros(count, int)
        self._failures = [""] * count
        estimate = bodies.disturbances.estimate
        self._estimator = None if estimate is None else StateEstimator(bodies, estimate, count)

    @property
    def times(self) -> Array:
        """Times since the episodes began [s]. Shape (N,)."""
        return self._steps * CONTROL_INTERVAL

    def seed(self, seeds: Sequence[int]) -> None:
        """Sets the seed of each environment."""
        self._rngs = [np.random.default_rng(seed) for seed in seeds]

    def begin(self, which: Indices, options: Sequence[Mapping[str, Any]] | None = None) -> None:
        """Begins episodes at rest, and observes.

        Args:
            which: Environments that begin.
            options: For each of them: `phase`, the angle of a motor [rad]; `member`, of an ensemble; and those of the
                task, as `goal` [m].

        Raises:
            ArgumentError: An option isn't allowed.
        """
        bodies, disturbances = self.bodies, self.bodies.disturbances
        members = np.zeros(self.count, int)
        for place, i in enumerate(map(int, which)):
            chosen = {} if options is None else options[place]
            member = int(self._rngs[i].integers(len(bodies)))
            phase = float(self._rngs[i].uniform(*disturbances.start_phase))
            member, phase = int(chosen.get("member", member)), float(chosen.get("phase", phase))
            if not 0 <= member < len(bodies):
                raise ArgumentError(f"the ensemble has no member {member}; there are {len(bodies)}, from 0 on")
            members[i] = member
            self.robots.start(i, member, phase)
            seconds = self.task.begin(i, self._rngs[i], chosen)
            self._steps[i], self._last[i] = 0, round(seconds / CONTROL_INTERVAL)
            self._failures[i] = ""
        self.robots.read(which)
        if self._estimator is not None:
            for i in map(int, which):
                self._estimator.begin(i, int(members[i]), self.state, self._rngs[i])
        self.observations[which] = self._observed()[which]

    def step(self, actions: NDArray[Any], which: Indices | None = None) -> _Stepped:
        """Steps environments one control interval.

        Args:
            actions: Actions from -1 to 1. Shape (N, A).
            which: Environments that are stepped; None for all.

        Raises:
            ArgumentError: An action isn't a number, or an episode isn't on.
        """
        rows = np.arange(self.count) if which is None else which
        if (self._steps[rows] >= self._last[rows]).any():
            raise ArgumentError("no episode is on: call reset before step")
        if np.isnan(actions[rows]).any():
            raise ArgumentError("an action is nan; it must be a number from -1 to 1")
        clipped = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        self.robots.advance(clipped, which)
        self._steps[rows] += 1
        if self._estimator is not None:
            self._estimator.update(self.state, rows, self._rngs)
        observed = self._observed()
        good = ~self.robots.batch.failed & (np.abs(observed) <= self.bounds).all(axis=1)  # NaN isn't
        rewards, done = self.task.score(self.state, clipped)
        rewards, success, done = np.where(good, rewards, DIVERGED), done & good, done | ~good
        changed = rows[good[rows]]
        self.observations[changed] = observed[changed]
        for i in map(int, rows[~good[rows]]):
            commands = ", ".join(f"{command:.2f} {unit}" for command, unit
                                 in zip(self.state.commands[i], self.bodies.actuators.units, strict=True))  # fmt: skip
            self._failures[i] = f"the simulation diverged {self.times[i]:.2f} s after the start, commanded {commands}"
        over = self._steps >= self._last
        self._last[rows] = np.where(done[rows], self._steps[rows], self._last[rows])
        return _Stepped(rewards, done, over & ~done, success)

    def info(self, index: int) -> dict[str, Any]:
        """State of one environment, whatever it observes.

        `time` since the start [s], forward `distance` since then [m], `position` [m], `heading` [rad], the `commands`
        of the actuators [unit], what the task adds, and `diverged`, a sentence, where the simulation has.
        """
        state = self.state
        x, y = (float(v) for v in state.position[index])
        info = {
            "time": float(self.times[index]), "distance": -x, "position": (x, y),
            "heading": float(state.heading[index]), "commands": tuple(map(float, state.commands[index])),
            **self.task.info(state, index),
        }  # fmt: skip
        return {**info, "diverged": self._failures[index]} if self._failures[index] else info

    def set_stage(self, stage: int) -> None:
        """Sets the stage of the curriculum, from the next episode on.

        Raises:
            ArgumentError: The task has no stages, or not this one.
        """
        if stage not in self.task.stages:
            raise ArgumentError(
                f"there is no stage {stage}; this task has {', '.join(map(str, self.task.stages)) or 'none'}"
            )
        self.task.stage = stage  # type: ignore[attr-defined] - a task with stages has a present one

    def save(self) -> tuple[dict[str, NDArray[Any]], dict[str, object]]:
        """Everything that decides how running episodes go on: arrays, and plain JSON."""
        physics = [self.robots.physics(i) for i in range(self.count)]
        arrays: dict[str, NDArray[Any]] = {
            "members": np.array([member for member, _ in physics]),
            "physics": np.array([state for _, state in physics]),
            "steps": self._steps, "last": self._last, "observations": self.observations,
        }  # fmt: skip
        for owner, name in self._kept():
            arrays[name] = owner[name.partition(".")[2]]
        return arrays, {"generators": [rng.bit_generator.state for rng in self._rngs]}

    def restore(self, arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]) -> None:
        """Goes on with the episodes that `save` was called in."""
        for i in range(self.count):
            self.robots.restore(i, int(arrays["members"][i]), arrays["physics"][i])
        self.robots.read(np.arange(self.count))
        for owner, name in self._kept():
            owner[name.partition(".")[2]][...] = arrays[name]
        self._steps[:], self._last[:] = arrays["steps"], arrays["last"]
        self.observations[:] = arrays["observations"]
        for rng, state in zip(self._rngs, rest["generators"], strict=True):
            rng.bit_generator.state = state

    @property
    def interface(self) -> dict[str, Any]:
        """Interface of a policy: the place of each part in an observation, and the actuators that it commands."""
        places = {part: [where.start, where.stop] for part, where in self.names.items()}
        return {"observation": places, "actions": list(self.bodies.actuators.names)}

    def close(self) -> None:
        """Ends the threads."""
        self.robots.batch.close()

    def _kept(self) -> list[tuple[dict[str, Any], str]]:
        """The arrays that decide how episodes go on, beside the physics: their owners and names."""
        owners: list[tuple[str, object]] = [("state", self.state), ("robots", self.robots), ("task", self.task)]
        if self._estimator is not None:
            owners += [("estimator", self._estimator), ("seen", self._estimator.seen)]
        return [(vars(owner), f"{name}.{key}") for name, owner in owners for key, value in vars(owner).items()
                if isinstance(value, np.ndarray) and not key.startswith("_")]  # fmt: skip

    def _observed(self) -> Array:
        seen = self.state if self._estimator is None else self._estimator.seen
        parts = [part.read(seen) for part in self._parts]
        return np.concatenate([*parts, self.task.observe(seen)], axis=1)


class RobotEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One robot and its task, as `Environments` has it, for Gymnasium.

    Every step's info is that of `Environments.info`, with `success`. `reset` takes the options of `Environments.begin`.

    Attributes:
        environments: The one environment.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": [],
        "render_fps": round(1 / CONTROL_INTERVAL),
    }

    def __init__(self, environments: Environments, seed: int | None = None) -> None:
        """Takes an environment.

        Args:
            environments: One.
            seed: Seed of the first `reset` that is called without one.
        """
        self.environments, self.render_mode, self._seed = environments, None, seed
        self.observation_space, self.action_space = make_spaces(environments)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode at rest."""
        seed, self._seed = self._seed if seed is None else seed, None
        super().reset(seed=seed)
        if seed is not None:
            self.environments.seed([seed])
        self.environments.begin(np.zeros(1, int), [options or {}])
        return self.environments.observations[0].copy(), {**self.environments.info(0), "success": False}

    def step(self, action: NDArray[Any]) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Moves one control interval."""
        stepped = self.environments.step(np.asarray(action)[None])
        info = {**self.environments.info(0), "success": bool(stepped.success[0])}
        observation = self.environments.observations[0].copy()
        return observation, float(stepped.rewards[0]), bool(stepped.terminated[0]), bool(stepped.truncated[0]), info

    def close(self) -> None:
        """Ends the threads."""
        self.environments.close()


def make_spaces(environments: Environments) -> tuple[spaces.Box[np.float32], spaces.Box[np.float32]]:
    """Observation and action space."""
    bounds = environments.bounds.astype(np.float32)
    actions = len(environments.bodies.actuators)
    return spaces.Box(-bounds, bounds, dtype=np.float32), spaces.Box(-1.0, 1.0, (actions,), np.float32)


class EnvironmentOptions(TypedDict, total=False):
    """Optional arguments of those that make environments.

    Attributes:
        robot: Robot; by default the fish.
        disturbances: What the real world adds; by default nothing.
        stage: Stage of the curriculum; by default the task's last.
        seconds: Length of an episode [s]; by default the task's own.
        threads: Threads that step them; more than 1 where cores are free.
        seed: Seed of the first environment; the i-th has the seed + i.
    """

    robot: Robot
    disturbances: Disturbances
    stage: int | None
    seconds: float | None
    threads: int
    seed: int | None


def make_environments(
    task: str, parameters: Values | Sequence[Values] | None, count: int, **options: Unpack[EnvironmentOptions]
) -> Environments:
    """Environments that step together. The i-th does what `make_env` with the seed + i does.

    Args:
        task: `forward`, `target`, or a task as `tasks.find_task` finds it.
        parameters: Parameters of the robot; of several sets one is drawn for every episode. None for the published
            ones.
        count: Number of environments.
        options: See `EnvironmentOptions`.

    Raises:
        ArgumentError: There is no such task, stage or length, or the robot can't do it.
        ParameterError: A value isn't allowed.
    """
    robot, seed, seconds = options.get("robot", FISH), options.get("seed"), options.get("seconds")
    if seconds is not None and not (math.isfinite(seconds) and seconds >= CONTROL_INTERVAL):
        raise ArgumentError(f"an episode of {seconds:g} s is asked for; it must have at least {CONTROL_INTERVAL} s")
    sets = robot.space.published if parameters is None else parameters
    bodies = Bodies(robot, sets, options.get("disturbances", UNDISTURBED))
    made = find_task(task)(robot, count, **({} if seconds is None else {"seconds": seconds}))
    environments = Environments(made, bodies, count, task_name=task, threads=options.get("threads", 1))
    stage = options.get("stage")
    if stage is not None and made.stages:
        environments.set_stage(stage)
    if seed is not None:
        environments.seed([seed + i for i in range(count)])
    return environments


def make_env(
    task: str, parameters: Values | Sequence[Values] | None = None, **options: Unpack[EnvironmentOptions]
) -> RobotEnv:
    """One environment; the arguments are those of `make_environments`."""
    seed = options.get("seed")
    rest = cast("EnvironmentOptions", {name: value for name, value in options.items() if name != "seed"})
    return RobotEnv(make_environments(task, parameters, 1, **rest), seed)
