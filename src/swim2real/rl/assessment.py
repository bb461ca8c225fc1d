"""Assesses a trained policy on fixed seeded starts, against constant speeds, and in open and closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.parameters import Values
from swim2real.rl.conditions import CONTROL_INTERVAL, REAL_MOTOR, UNDISTURBED, Disturbances, StateEstimate
from swim2real.rl.environment import TaskName, make_environments
from swim2real.rl.policies import ConstantSpeed, Policy, RecordedActions, Which, load_policy
from swim2real.rl.rollout import Episode, EpisodeStatistics, run_episodes
from swim2real.rl.training_run import TrainingRun
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]

TEST_SEED = 2_000_000  # of the episodes that a policy is assessed in
SCANNED_SPEEDS = 20  # constant speeds of each sign that a forward policy is compared with
SCANNED_PHASES = 4  # starts of each, where starts are at any phase
SIDE_BY_SIDE = 50  # environments


@dataclass(frozen=True)
class SpeedScan:
    """Constant motor speeds and what each reaches, from the same starts as a policy.

    Attributes:
        speeds: Speeds [rad/s]. Shape (S,).
        distances: Mean distances over the starts [m]. Shape (S,).
        returns: Mean episode returns. Shape (S,).
        phases: Motor angles at the starts [rad].
    """

    speeds: Array
    distances: Array
    returns: Array
    phases: tuple[float, ...]

    @property
    def farthest(self) -> int:
        """Index of the speed that swims farthest."""
        return int(np.argmax(self.distances))

    @property
    def highest(self) -> int:
        """Index of the speed with the highest return."""
        return int(np.argmax(self.returns))

    @property
    def best_distance(self) -> float:
        """Greatest distance [m]."""
        return float(self.distances[self.farthest])

    @property
    def best_distance_frequency(self) -> float:
        """Frequency that swims farthest [Hz]."""
        return float(self.speeds[self.farthest] / (2 * np.pi))

    @property
    def best_return(self) -> float:
        """Highest return."""
        return float(self.returns[self.highest])

    @property
    def best_return_frequency(self) -> float:
        """Frequency with the highest return [Hz]."""
        return float(self.speeds[self.highest] / (2 * np.pi))

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON."""
        return {
            "speeds": self.speeds.tolist(), "distances": self.distances.tolist(), "returns": self.returns.tolist(),
            "best_distance": self.best_distance, "best_distance_frequency": self.best_distance_frequency,
            "best_return": self.best_return, "best_return_frequency": self.best_return_frequency,
            "phases": list(self.phases),
        }  # fmt: skip


@dataclass(frozen=True)
class LoopResult:
    """How a policy swims in one kind of loop.

    Attributes:
        statistics: Figures of the episodes.
        drift: Mean distance between a swim's end and the undisturbed swim at the same time [m].
        sideways: Mean of |y| at the end [m].
        episodes: The episodes.
    """

    statistics: EpisodeStatistics
    drift: float
    sideways: float
    episodes: list[Episode]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON, without the episodes."""
        return {**self.statistics.as_dict(), "drift": self.drift, "sideways": self.sideways}


@dataclass(frozen=True)
class Assessment:
    """How well a policy swims.

    Attributes:
        task: Task of the policy.
        which: Which policy of the run, `best` or `last`.
        episodes: Episodes of the policy.
        statistics: Their figures.
        scan: Constant speeds; None in a task other than forward.
        loops: Results by loop, as `compare_loops` gives them; empty where they weren't compared.
    """

    task: TaskName
    which: Which
    episodes: list[Episode]
    statistics: EpisodeStatistics
    scan: SpeedScan | None
    loops: dict[str, LoopResult]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON: `policy`, and `constant` of a forward task, and `loops` where they were compared."""
        content: dict[str, Any] = {"task": self.task, "which": self.which, "policy": self.statistics.as_dict()}
        if self.scan is not None:
            content["constant"] = self.scan.as_dict()
        if self.loops:
            content["loops"] = {name: loop.as_dict() for name, loop in self.loops.items()}
        return content


def assess(
    run: TrainingRun, episodes: int, *, parameters: Sequence[Values] | None = None,
    disturbances: Disturbances | None = None, which: Which = "best", estimate: StateEstimate | None = None,
    stage: int = 3,
) -> Assessment:  # fmt: skip
    """Assesses a policy.

    Args:
        run: Its training.
        episodes: Number of episodes; their starts depend on their numbers alone.
        parameters: Parameter sets of the simulator; None for those that it was trained with.
        disturbances: Disturbances of the simulator; None for those that it was trained with.
        which: Which policy of the run.
        estimate: Tracker's view to compare open and closed loop with, under `disturbances`; None for no comparison.
        stage: Stage of the curriculum of `target`, for goals and threshold.

    Raises:
        RunError: The run has no policy.
        ArgumentError: No episodes are asked for.
    """
    if episodes < 1:
        raise ArgumentError(f"{episodes} episodes are asked for; an assessment needs at least 1")
    policy, settings, robot = load_policy(run, which), run.settings, run.robot
    task = settings.task
    sets: list[Values] = list(settings.parameters if parameters is None else parameters)
    disturbed = settings.disturbances if disturbances is None else disturbances
    true_state = replace(disturbed, estimate=None)
    seeds = range(TEST_SEED, TEST_SEED + episodes)
    swims: list[Episode] = []
    for first in range(0, episodes, SIDE_BY_SIDE):
        chunk = seeds[first : first + SIDE_BY_SIDE]
        environments = make_environments(task, sets, len(chunk), robot=robot, disturbances=true_state, stage=stage)
        swims += run_episodes(environments, policy, chunk)
    scan, loops = None, dict[str, LoopResult]()
    if task == "forward":
        low, high = disturbed.start_phase
        # phases in the middle of equal shares of the range that starts are drawn from
        shares = [(i + 0.5) / SCANNED_PHASES for i in range(SCANNED_PHASES)]
        phases = [low + (high - low) * share for share in shares] if high > low else [low]
        scan = scan_constant_speeds(
            sets[0], robot, phases, swims[0].duration, disturbances=true_state, count=SCANNED_SPEEDS
        )  # fmt: skip
    if estimate is not None:
        loops = compare_loops(
            policy, task, sets[0], robot, seeds[: min(episodes, SIDE_BY_SIDE)], disturbed, estimate, stage=stage
        )
    return Assessment(task, which, swims, EpisodeStatistics.of(swims), scan, loops)


def scan_constant_speeds(
    parameters: Values, robot: Robot, phases: Sequence[float], seconds: float, *,
    count: int, disturbances: Disturbances = UNDISTURBED,
) -> SpeedScan:  # fmt: skip
    """Swims forward at constant motor speeds, both ways round, up to the motor's limit.

    Args:
        parameters: Parameters of the simulator.
        robot: Robot whose values they are.
        phases: Motor angles at the start [rad]; each speed swims from each.
        seconds: Length of each swim [s].
        count: Number of speeds of each sign.
        disturbances: Disturbances of the simulator.
    """
    motor = REAL_MOTOR  # whose limits and acceleration hold here as for a policy
    positive = motor.speed * np.arange(1, count + 1) / count
    speeds = np.concatenate([-positive[::-1], positive])
    environments = make_environments(
        "forward", [parameters], len(speeds), robot=robot, seconds=seconds, motor=motor, disturbances=disturbances
    )
    policy = ConstantSpeed(speeds, motor.acceleration * CONTROL_INTERVAL)
    distances, returns = np.zeros(len(speeds)), np.zeros(len(speeds))
    for phase in phases:
        episodes = run_episodes(environments, policy, range(len(speeds)), [{"phase": phase}] * len(speeds))
        distances += [episode.distance for episode in episodes]
        returns += [episode.episode_return for episode in episodes]
    return SpeedScan(speeds, distances / len(phases), returns / len(phases), tuple(phases))


def compare_loops(
    policy: Policy, task: TaskName, parameters: Values, robot: Robot, seeds: Sequence[int], disturbances: Disturbances,
    estimate: StateEstimate, seconds: float | None = None, stage: int = 3,
) -> dict[str, LoopResult]:  # fmt: skip
    """Swims each start four times, to see how far a disturbed robot strays from the undisturbed one.

    `nominal` is without the disturbances. The others are with them: `open` repeats the nominal actions, as the paper's
    transfer does; `closed` sees the true state; `tracked` sees what a marker tracker reports.

    Args:
        policy: Policy that steers.
        task: `forward` or `target`.
        parameters: Parameters of the simulator.
        robot: Robot whose values they are.
        seeds: Seeds of the starts.
        disturbances: What is added; its start phases hold for the nominal swims, too.
        estimate: The tracker's view.
        seconds: Length of the episodes [s]; None for the task's own.
        stage: Stage of the curriculum of `target`.

    Returns:
        Results by loop.
    """
    start_only = Disturbances(start_phase=disturbances.start_phase)
    true_state, tracked_state = replace(disturbances, estimate=None), replace(disturbances, estimate=estimate)

    def swim(policy: Policy, disturbed: Disturbances) -> list[Episode]:
        environments = make_environments(
            task, [parameters], len(seeds), robot=robot, disturbances=disturbed, seconds=seconds, stage=stage
        )
        return run_episodes(environments, policy, seeds)

    nominal = swim(policy, start_only)
    episodes = {
        "nominal": nominal,
        "open": swim(RecordedActions([episode.actions for episode in nominal]), true_state),
        "closed": swim(policy, true_state),
        "tracked": swim(policy, tracked_state),
    }
    return {
        name: LoopResult(
            EpisodeStatistics.of(swims),
            float(np.mean([_drift(swim, reference) for swim, reference in zip(swims, nominal, strict=True)])),
            float(np.mean([abs(swim.heads[-1, 1]) for swim in swims])),
            swims,
        )
        for name, swims in episodes.items()
    }


def policy_commands(
    run: TrainingRun, seconds: float, *, which: Which = "best", phase: float = 0.0,
    goal: tuple[float, float] | None = None,
) -> Array:  # fmt: skip
    """Motor commands of a policy in the simulator that it was trained in, from rest [rad/s]. Shape (T,).

    An episode that reaches its goal ends there, others when the seconds are over.

    Args:
        run: Its training.
        seconds: Length [s].
        which: Which policy of the run.
        phase: Angle of the motor at the start [rad].
        goal: Goal of a target task [m]; ahead is -x. None for 1 m straight ahead.

    Raises:
        RunError: The run has no policy.
        ArgumentError: The length isn't allowed, a forward policy is given a goal, or the simulation diverges.
    """
    if not (math.isfinite(seconds) and seconds >= CONTROL_INTERVAL):
        raise ArgumentError(f"{seconds:g} s of commands are asked for; it must be at least {CONTROL_INTERVAL:g} s")
    policy, settings = load_policy(run, which), run.settings
    options: dict[str, Any] = {"phase": phase, "member": 0}
    if settings.task == "target":
        options["goal"] = goal or (-1.0, 0.0)
    elif goal is not None:
        raise ArgumentError("a goal is for policies of task target; this one swims forward")
    environments = make_environments(settings.task, settings.parameters, 1, robot=run.robot, seconds=seconds)
    episode = run_episodes(environments, policy, [TEST_SEED], [options])[0]
    if episode.failure:
        raise ArgumentError(f"the policy can't be recorded: {episode.failure}")
    return episode.commands


def _drift(episode: Episode, reference: Episode) -> float:
    """Distance between two swims at the last time that both have [m]."""
    last = min(len(episode.heads), len(reference.heads)) - 1
    return float(np.linalg.norm(episode.heads[last] - reference.heads[last]))
