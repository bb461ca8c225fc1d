"""Episodes of several environments side by side: what can command them, their figures, and what a robot repeats."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from markertrack import frames
from swim2real.objective.expected_run import Band, ExpectedRun, arrival, motion_of
from swim2real.parameters import Values
from swim2real.rl.actor import Actor
from swim2real.rl.body import Actuators
from swim2real.rl.conditions import CONTROL_INTERVAL
from swim2real.rl.environment import Environments, make_environments
from swim2real.rl.tasks import STAGES, ReachGoal, find_task
from swim2real.rl.training_run import BEST, LAST, TrainingRun
from swimbase.arrays import Array
from swimbase.errors import ArgumentError, RunError
from swimbase.store import write_arrays

_ROLLS = 0.03  # rad; a hull that is held by springs rolls less

Which = Literal["best", "last"]
Policy = Callable[[NDArray[np.float32], Array, int], Array]
"""Gives actions from -1 to 1, shape (N, A), to N environments: from their observations (N, n), their present commands
[unit] (N, A), and the number of steps since the episodes began. A trained `Actor` is one.
"""


def followed(commands: Array, actuators: Actuators) -> Policy:
    """Follows commands as fast as the actuators' rates allow.

    Args:
        commands: Commands of each environment [unit]. Shape (N, A), or (T, N, A) with a row per step, of which the last
            holds.
        actuators: The actuators.
    """
    rows, change = commands if commands.ndim == 3 else commands[None], actuators.rate * CONTROL_INTERVAL
    return lambda observations, present, step: np.clip((rows[min(step, len(rows) - 1)] - present) / change, -1.0, 1.0)


def repeated(actions: Sequence[Array]) -> Policy:
    """Repeats recorded actions, whatever the robot does: the open loop that the paper transfers.

    Args:
        actions: Actions of each environment; after its last one the commands stay. Shapes (T_i, A).
    """
    table = np.zeros((max(map(len, actions)), len(actions), actions[0].shape[1]))
    for i, series in enumerate(actions):
        table[: len(series), i] = series
    return lambda observations, present, step: table[step] if step < len(table) else np.zeros_like(present)


def load_policy(run: TrainingRun, which: Which = "best") -> Actor:
    """Loads a policy from a training run.

    Args:
        run: The training run.
        which: `best` in the evaluations while it learned, or `last`.

    Raises:
        RunError: The policy isn't there or is damaged.
    """
    path = run.folder / (BEST if which == "best" else LAST)
    if not path.is_file():
        raise RunError(f"'{run.folder}' has no {path.name} yet; wait for its first evaluation")
    return Actor.load(path)


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        seed: Seed of its start.
        rate: Steps a second [Hz].
        actions: Actions. Shape (T, A).
        commands: Commands of the actuators in each step [unit]. Shape (T, A).
        rewards: Rewards. Shape (T,).
        heads: Positions of the floating body, the start first [m]. Shape (T + 1, 2).
        markers: Positions of the markers after each step [m]. Shape (T, K, 2).
        rolls: Roll of the floating body after each step [rad]. Shape (T,).
        goal: Goal [m]; None in a task without one. Shape (2,).
        goal_distance: Distance from the goal at the end [m]; None in a task without one.
        distance: Distance covered forward [m].
        success: Whether the goal was reached.
        failure: Why the simulation diverged, in words; empty where it didn't.
    """

    seed: int
    rate: float
    actions: Array
    commands: Array
    rewards: Array
    heads: Array
    markers: Array
    rolls: Array
    goal: Array | None
    goal_distance: float | None
    distance: float
    success: bool
    failure: str

    @property
    def episode_return(self) -> float:
        """Sum of the rewards."""
        return float(self.rewards.sum())

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self.actions) / self.rate


@dataclass(frozen=True)
class EpisodeStatistics:
    """Figures of several episodes.

    Attributes:
        episodes: Number of episodes.
        episode_return: Mean return.
        episode_return_std: Its standard deviation.
        distance: Mean distance covered forward [m].
        distance_std: Its standard deviation [m].
        success: Share of episodes that reached their goal.
        time_to_target: Mean duration of those [s]; None where none did.
        median_time_to_target: Median duration of those [s]; None where none did.
        goal_distance: Mean distance left at the end [m]; None in a task without a goal.
        action_size: Mean magnitude of the actions.
        diverged: Number of episodes whose simulation diverged.
    """

    episodes: int
    episode_return: float
    episode_return_std: float
    distance: float
    distance_std: float
    success: float
    time_to_target: float | None
    median_time_to_target: float | None
    goal_distance: float | None
    action_size: float
    diverged: int

    @staticmethod
    def of(episodes: Sequence[Episode]) -> EpisodeStatistics:
        """Figures of these episodes."""
        returns = np.array([episode.episode_return for episode in episodes])
        distances = np.array([episode.distance for episode in episodes])
        times = [episode.duration for episode in episodes if episode.success]
        left = [episode.goal_distance for episode in episodes if episode.goal_distance is not None]
        return EpisodeStatistics(
            episodes=len(episodes),
            episode_return=float(returns.mean()),
            episode_return_std=float(returns.std()),
            distance=float(distances.mean()),
            distance_std=float(distances.std()),
            success=float(np.mean([episode.success for episode in episodes])),
            time_to_target=float(np.mean(times)) if times else None,
            median_time_to_target=float(np.median(times)) if times else None,
            goal_distance=float(np.mean(left)) if left else None,
            action_size=float(np.mean([np.abs(episode.actions).mean() for episode in episodes])),
            diverged=sum(bool(episode.failure) for episode in episodes),
        )


def run_episodes(
    environments: Environments, policy: Policy, seeds: Sequence[int],
    options: Sequence[Mapping[str, object]] | None = None,
) -> list[Episode]:  # fmt: skip
    """Runs one episode in each environment, side by side.

    Args:
        environments: N environments.
        policy: Policy that commands all.
        seeds: Seeds of their starts.
        options: Options of their starts, as `Environments.begin` takes them.

    Returns:
        N episodes.
    """
    environments.seed(seeds)
    which, state = np.arange(environments.count), environments.state
    environments.begin(which, options)
    lengths, succeeded = np.zeros(environments.count, int), np.zeros(environments.count, np.bool_)
    heads, rows = [state.position.copy()], list[tuple[Array, ...]]()
    while len(which):
        actions = np.clip(policy(environments.observations, state.commands, len(rows)), -1.0, 1.0)
        stepped = environments.step(actions, which)
        present = (state.commands.copy(), stepped.rewards, state.markers.copy(), state.roll.copy())
        rows.append((actions.astype(float), *present))
        heads.append(state.position.copy())
        lengths[which] += 1
        succeeded[which] = stepped.success[which]
        which = which[~stepped.ended[which]]
    actions, commands, rewards, markers, rolls = (np.array(series) for series in zip(*rows, strict=True))
    episodes: list[Episode] = []
    for i, (seed, n) in enumerate(zip(seeds, lengths, strict=True)):
        info = environments.info(i)
        goal = np.array(info["goal"]) if "goal" in info else None
        episodes.append(Episode(
            seed=seed, rate=1 / CONTROL_INTERVAL, actions=actions[:n, i], commands=commands[:n, i],
            rewards=rewards[:n, i], heads=np.array(heads)[: n + 1, i], markers=markers[:n, i],
            rolls=rolls[:n, i], goal=goal, goal_distance=info.get("goal_distance"), distance=float(info["distance"]),
            success=bool(succeeded[i]),
            failure=str(info.get("diverged", "")),
        ))  # fmt: skip
    return episodes


def save_episodes(path: str | Path, episodes: Sequence[Episode]) -> None:
    """Writes episodes as arrays, each filled up with NaN to the longest: times, actions, commands, heads, markers."""
    lengths = np.array([len(episode.actions) for episode in episodes])
    longest = lengths.max()

    def stacked(name: str, extra: int = 0) -> Array:
        shape = getattr(episodes[0], name).shape[1:]
        out = np.full((len(episodes), longest + extra, *shape), np.nan)
        for i, episode in enumerate(episodes):
            out[i, : lengths[i] + extra] = getattr(episode, name)
        return out

    no_goal = np.full(2, np.nan)
    write_arrays(path, {
        "times": np.arange(longest + 1) / episodes[0].rate, "lengths": lengths,
        "seeds": np.array([episode.seed for episode in episodes]), "actions": stacked("actions"),
        "commands": stacked("commands"), "rewards": stacked("rewards"), "heads": stacked("heads", 1),
        "markers": stacked("markers"),
        "goals": np.array([no_goal if episode.goal is None else episode.goal for episode in episodes]),
        "distances": np.array([episode.distance for episode in episodes]),
        "successes": np.array([episode.success for episode in episodes]),
    })  # fmt: skip


def expect(run: TrainingRun, episode: Episode, phase: float, ensemble: Sequence[Values]) -> ExpectedRun | None:
    """Repeats recorded commands with the parameters of a training and with others, as the real robot repeats them.

    Args:
        run: Training of the policy.
        episode: The episode whose commands are exported.
        phase: Angle of the motor at its start [rad].
        ensemble: Further parameter sets of the robot.

    Returns:
        What is expected; None for a robot without a frame, of which nothing can be compared.

    Raises:
        ArgumentError: The simulation diverges with one of the sets.
    """
    robot, pair = run.robot, run.robot.trials.frame
    if pair is None:
        return None
    sets = [run.settings.parameters[0], *ensemble]
    environments = make_environments("forward", sets, len(sets), robot=robot, seconds=episode.duration)
    options = [{"phase": phase, "member": i} for i in range(len(sets))]
    swims = run_episodes(environments, repeated([episode.actions] * len(sets)), range(len(sets)), options)
    for number, swim in enumerate(swims):
        if swim.failure:
            raise ArgumentError(f"parameter set {number} of the expectation: {swim.failure}; leave it out")
    first = swims[0]
    axes = frames.body_axes(first.markers[:1], pair)
    origin = frames.components(first.heads[1:2] - frames.heads(first.markers[:1], pair), axes)[0]
    motions = [motion_of(swim.markers, pair, origin) for swim in swims]
    places = np.array([np.vstack([np.zeros((1, 2)), place]) for place, _ in motions])  # with the start
    headings = np.array([np.append(0.0, heading) for _, heading in motions])
    rolls = np.array([np.append(0.0, swim.rolls) for swim in swims])
    goal = None if episode.goal is None else (float(episode.goal[0]), float(episode.goal[1]))
    aims = goal is not None and issubclass(find_task(run.task), ReachGoal)
    threshold = STAGES[max(STAGES)].threshold if aims else None
    return ExpectedRun(
        robot=robot.name, task=run.settings.task, frame=(robot.marker_names[pair[0]], robot.marker_names[pair[1]]),
        origin=(float(origin[0]), float(origin[1])), goal=goal, threshold=threshold, rate=episode.rate,
        sets=len(sets), x=Band.of(places[..., 0]), y=Band.of(places[..., 1]), heading=Band.of(headings),
        roll=Band.of(rolls) if np.abs(rolls).max() > _ROLLS else None,
        arrivals=[arrival(swim.heads, episode.rate, goal, threshold) for swim in swims],
    )  # fmt: skip
