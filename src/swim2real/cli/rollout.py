"""`rollout`."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

from swim2real.cli import tables
from swim2real.cli.rl_arguments import Rollout
from swim2real.cli.subject import values_of
from swim2real.cli.trained import robot_of_training
from swim2real.errors import ArgumentError, MissingExtraError
from swim2real.report.training_page import write_training_page
from swim2real.rl import run_files
from swim2real.rl.assessment import Assessment, assess, trained_disturbances, write_episodes
from swim2real.rl.disturbances import StateEstimate
from swim2real.rl.film import write_film
from swim2real.rl.target import STAGES
from swim2real.simulation import Simulator


def rollout(a: Rollout) -> int:
    """Assesses a policy and writes what was found."""
    robot = robot_of_training(a.policy)
    settings = run_files.read_json(a.policy / run_files.SETTINGS)
    if a.goals and settings["task"] != "target":
        raise ArgumentError("--goals is for target policies; this one swims forward: use --episodes")
    if a.stage not in STAGES:
        raise ArgumentError(f"--stage is {a.stage}; there are {', '.join(map(str, STAGES))}")
    sets = None if a.parameters is None else [values_of(a.parameters, Simulator(robot, 1))]
    what = trained_disturbances(settings)
    if a.tendon_friction is not None:
        what = replace(what, tendon_friction=a.tendon_friction)
    if a.current is not None:
        what = replace(what, current=a.current)
    found = assess(
        a.policy, robot, a.goals or a.episodes, parameters=sets, disturbances=what, which=a.which, stage=a.stage,
        estimate=StateEstimate(a.noise, a.delay) if a.closed_loop else None,
    )  # fmt: skip
    content = {**found.content, "parameters": str(a.parameters or settings.get("reference", "as trained"))}
    out = a.out or a.policy
    out.mkdir(parents=True, exist_ok=True)
    run_files.write_json(out / "rollout.json", content)
    write_episodes(out / "episodes.npz", found.episodes)
    if a.film:
        threshold = STAGES[a.stage].threshold if settings["task"] == "target" else None
        try:
            write_film(out / "rollout.mp4", found.episodes[0], threshold=threshold)
        except MissingExtraError as error:
            tables.console.print(f"no film: {error}", soft_wrap=True, markup=False)
    page = write_training_page(a.policy, out, found)
    if a.json:
        print(json.dumps(content, indent=2))
    else:
        _print(found)
        tables.console.print(f"Written: {page}, rollout.json, episodes.npz", soft_wrap=True)
    return 0


def _print(found: Assessment) -> None:
    own, content = found.content["policy"], found.content
    rows = [
        ("episodes", str(own["episodes"])),
        ("return", f"{own['episode_return']:.2f} ± {own['episode_return_std']:.2f}"),
        ("distance", f"{own['distance']:.3f} ± {own['distance_std']:.3f} m"),
    ]
    if own["goal_distance"] is not None:
        rows.append(("reached", f"{100 * own['success']:.0f} %"))
        rows.append(("time to target, median", _seconds(own["median_time_to_target"])))
        rows.append(("left to the goal", f"{own['goal_distance']:.3f} m"))
    constant = content.get("constant")
    if constant:
        rows.append((
            "best constant frequency, distance",
            f"{constant['best_distance']:.3f} m at {constant['best_distance_frequency']:+.2f} Hz",
        ))  # fmt: skip
        rows.append((
            "best constant frequency, return",
            f"{constant['best_return']:.2f} at {constant['best_return_frequency']:+.2f} Hz",
        ))  # fmt: skip
    tables.table(f"Policy for {content['task']}", ("figure", "value"), rows)
    if found.loops:
        tables.table(
            "Loops", ("loop", "return", "distance m", "drift m", "sideways m", "reached"),
            [
                (name, *(f"{one[key]:.3f}" for key in ("episode_return", "distance", "drift", "sideways")),
                 f"{100 * one['success']:.0f} %")
                for name, one in content["loops"].items()
            ],
        )  # fmt: skip


def _seconds(value: Any) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:.1f} s"
