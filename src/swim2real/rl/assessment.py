"""Assesses a trained policy on fixed seeded starts, against constant frequencies, and in open and closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.parameters import Values
from swim2real.rl import run_files
from swim2real.rl.disturbances import Disturbances, StateEstimate
from swim2real.rl.drift import compare_loops
from swim2real.rl.evaluation import SCANNED, Scan, figures, scan_constant_speeds
from swim2real.rl.policy import Trained, Which
from swim2real.rl.rollout import Episode, roll, some_environments
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]

TEST_SEED = 2_000_000  # of the episodes that a policy is judged by
SCAN_PHASES = 4
SIDE_BY_SIDE = 50  # environments


@dataclass(frozen=True)
class Assessment:
    """What was found.

    Attributes:
        content: Figures as plain JSON: `policy`, and `constant` of a forward task, and `loops` where asked for.
        episodes: Of the policy.
        scan: Of a forward task.
        loops: Episodes by loop, where asked for.
    """

    content: dict[str, Any]
    episodes: list[Episode]
    scan: Scan | None
    loops: dict[str, list[Episode]]


def assess(
    run: str | Path, robot: Robot, episodes: int, *, parameters: Sequence[Values] | None = None,
    disturbances: Disturbances | None = None, which: Which = "best", estimate: StateEstimate | None = None,
    stage: int = 3, scanned: int = SCANNED,
) -> Assessment:  # fmt: skip
    """Assesses a policy.

    Args:
        run: Folder of its training.
        robot: What swims.
        episodes: How many; their starts depend on their numbers alone.
        parameters: Of the simulator; None for those that it was trained with.
        disturbances: Of the simulator; None for those that it was trained with.
        which: Policy.
        estimate: Also compare open and closed loop, with this view of a tracker, under `disturbances`.
        stage: Of the curriculum of target, for goals and threshold.
        scanned: Constant speeds of each sign that a forward policy is compared with.

    Raises:
        RunError: The run has no policy.
        ArgumentError: No episodes.
    """
    if episodes < 1:
        raise ArgumentError(f"{episodes} episodes are asked for; an assessment needs at least 1")
    policy = Trained(run, which)
    settings = run_files.read_json(Path(run) / run_files.SETTINGS)
    sets = list(settings["parameters"] if parameters is None else parameters)
    what = trained_disturbances(settings) if disturbances is None else disturbances
    seeds = range(TEST_SEED, TEST_SEED + episodes)
    swum: list[Episode] = []
    for first in range(0, episodes, SIDE_BY_SIDE):
        some = seeds[first : first + SIDE_BY_SIDE]
        environments = some_environments(
            policy.task, sets, len(some), robot=robot, disturbances=replace(what, estimate=None), stage=stage
        )
        swum += roll(environments, policy, some)
    content: dict[str, Any] = {"task": policy.task, "which": which, "policy": figures(swum)}
    scan, loops = None, dict[str, list[Episode]]()
    if policy.task == "forward":
        low, high = what.start_phase
        # as many phases as are drawn from, in the middle of equal shares
        phases = [low + (high - low) * (i + 0.5) / SCAN_PHASES for i in range(SCAN_PHASES)] if high > low else [low]
        scan = scan_constant_speeds(
            sets[0], robot, phases, swum[0].duration, disturbances=replace(what, estimate=None), count=scanned
        )
        content["constant"] = {**scan.as_dict(), "phases": phases}
    if estimate is not None:
        found, loops = compare_loops(
            policy, policy.task, sets[0], robot, seeds[: min(episodes, SIDE_BY_SIDE)], what, estimate, stage=stage
        )
        content["loops"] = found
    return Assessment(content, swum, scan, loops)


def trained_disturbances(settings: dict[str, Any]) -> Disturbances:
    """Those that a run was trained with, without a tracker's view."""
    kept = settings["disturbances"]
    low, high = kept["start_phase"]
    x, y = kept["current"]
    return Disturbances((low, high), (x, y), kept["tendon_friction"])


def write_episodes(path: Path, episodes: Sequence[Episode]) -> None:
    """Writes episodes as arrays, each filled up with NaN to the longest: times, actions, commands, heads, markers."""
    longest = max(len(one.actions) for one in episodes)
    lengths = np.array([len(one.actions) for one in episodes])

    def filled(name: str, extra: int = 0) -> Array:
        shape = getattr(episodes[0], name).shape[1:]
        out = np.full((len(episodes), longest + extra, *shape), np.nan)
        for i, one in enumerate(episodes):
            out[i, : lengths[i] + extra] = getattr(one, name)
        return out

    nowhere = np.full(2, np.nan)
    np.savez_compressed(
        path, times=np.arange(longest + 1) / episodes[0].rate, lengths=lengths,
        seeds=np.array([one.seed for one in episodes]), actions=filled("actions"), commands=filled("commands"),
        rewards=filled("rewards"), heads=filled("heads", 1), markers=filled("markers"),
        goals=np.array([nowhere if one.goal is None else one.goal for one in episodes]),
        distances=np.array([one.distance for one in episodes]), successes=np.array([one.success for one in episodes]),
    )  # fmt: skip


def policy_commands(
    run: str | Path, robot: Robot, seconds: float, *, which: Which = "best", phase: float = 0.0,
    goal: tuple[float, float] | None = None,
) -> Array:  # fmt: skip
    """Motor commands of a policy in the simulator that it was trained in, from rest [rad/s]. Shape (T,).

    An episode goes on until the seconds are over; one that reaches its goal ends there.

    Args:
        run: Folder of its training.
        robot: What swims.
        seconds: [s].
        which: Policy.
        phase: Of the motor at the start [rad].
        goal: Of a target task [m]; ahead is -x. None for 1 m straight ahead.
    """
    if not (math.isfinite(seconds) and seconds >= 0.02):
        raise ArgumentError(f"{seconds:g} s of commands are asked for; it must be at least 0.02 s")
    policy = Trained(run, which)
    settings = run_files.read_json(Path(run) / run_files.SETTINGS)
    options: dict[str, Any] = {"phase": phase, "member": 0}
    if policy.task == "target":
        options["goal"] = goal or (-1.0, 0.0)
    elif goal is not None:
        raise ArgumentError("a goal is for policies of task target; this one swims forward")
    environments = some_environments(policy.task, settings["parameters"], 1, robot=robot, seconds=seconds)
    episode = roll(environments, policy, [TEST_SEED], [options])[0]
    if episode.ended:
        raise ArgumentError(f"the policy can't be recorded: {episode.ended}")
    return episode.commands
