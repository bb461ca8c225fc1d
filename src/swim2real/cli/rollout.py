"""`rollout` and `export-commands`: what is done with a trained policy."""

from __future__ import annotations

import json
from dataclasses import replace

from swim2real.cli import tables
from swim2real.cli.rl_arguments import ExportCommands, Rollout
from swim2real.cli.subject import values_of
from swim2real.deployment.commands import XW540_T140, CommandTable, Limits, write_table
from swim2real.errors import ArgumentError
from swim2real.report.training_page import write_training_page
from swim2real.rl.assessment import Assessment, assess, policy_commands
from swim2real.rl.conditions import StateEstimate
from swim2real.rl.film import write_film
from swim2real.rl.rollout import save_episodes
from swim2real.rl.tasks import STAGES
from swim2real.rl.training_run import TrainingRun
from swim2real.simulation import Simulator
from swim2real.store import write_json


def rollout(a: Rollout) -> int:
    """Assesses a policy and writes the figures, the episodes, a film and a page."""
    run = TrainingRun.open(a.policy)
    task = run.settings.task
    if a.goals and task != "target":
        raise ArgumentError("--goals is for target policies; this one swims forward: use --episodes")
    if a.stage not in STAGES:
        raise ArgumentError(f"--stage is {a.stage}; there are {', '.join(map(str, STAGES))}")
    parameters = None if a.parameters is None else [values_of(a.parameters, Simulator(run.robot, 1))]
    disturbances = replace(run.settings.disturbances, estimate=None)
    if a.tendon_friction is not None:
        disturbances = replace(disturbances, tendon_friction=a.tendon_friction)
    if a.current is not None:
        disturbances = replace(disturbances, current=a.current)
    assessment = assess(
        run, a.goals or a.episodes, parameters=parameters, disturbances=disturbances, which=a.which, stage=a.stage,
        estimate=StateEstimate(a.noise, a.delay) if a.closed_loop else None,
    )  # fmt: skip
    content = {**assessment.as_dict(), "parameters": str(a.parameters or run.settings.reference)}
    out = a.out or a.policy
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "rollout.json", content)
    save_episodes(out / "episodes.npz", assessment.episodes)
    if a.film:
        threshold = STAGES[a.stage].threshold if task == "target" else None
        write_film(out / "rollout.mp4", assessment.episodes[0], threshold=threshold)
    page = write_training_page(run, out, assessment)
    if a.json:
        print(json.dumps(content, indent=2))
    else:
        _print_assessment(assessment)
        tables.console.print(f"Written: {page}, rollout.json, episodes.npz", soft_wrap=True)
    return 0


def export_commands(a: ExportCommands) -> int:
    """Writes a policy's commands, checked and ramped."""
    limits = Limits(
        XW540_T140.speed if a.max_speed is None else a.max_speed,
        XW540_T140.acceleration if a.max_acceleration is None else a.max_acceleration,
    )
    speeds = policy_commands(TrainingRun.open(a.policy), a.seconds, which=a.which, phase=a.phase, goal=a.goal)
    table = CommandTable.of(speeds.tolist())
    table = (table.clipped(limits) if a.clip else table.within(limits)).ramped(a.ramp)
    write_table(a.out, table.times, table.velocities)
    if a.json:
        content = {
            "commands": len(table.times), "seconds": table.duration, "speed": table.speed,
            "acceleration": table.acceleration, "out": str(a.out),
        }  # fmt: skip
        print(json.dumps(content, indent=2))
    else:
        print(
            f"{a.out}: {len(table.times)} commands, {table.duration:.2f} s with ramps, at most {table.speed:.2f} rad/s "
            f"and {table.acceleration:.0f} rad/s²; `swim2real deploy {a.out} --dry-run` tries them"
        )
    return 0


def _print_assessment(assessment: Assessment) -> None:
    policy, scan = assessment.statistics, assessment.scan
    rows = [
        ("episodes", str(policy.episodes)),
        ("return", f"{policy.episode_return:.2f} ± {policy.episode_return_std:.2f}"),
        ("distance", f"{policy.distance:.3f} ± {policy.distance_std:.3f} m"),
    ]
    if policy.goal_distance is not None:
        median = policy.median_time_to_target
        rows.append(("reached", f"{100 * policy.success:.0f} %"))
        rows.append(("time to target, median", "–" if median is None else f"{median:.1f} s"))
        rows.append(("left to the goal", f"{policy.goal_distance:.3f} m"))
    if scan is not None:
        rows.append((
            "best constant frequency, distance",
            f"{scan.best_distance:.3f} m at {scan.best_distance_frequency:+.2f} Hz",
        ))  # fmt: skip
        rows.append((
            "best constant frequency, return",
            f"{scan.best_return:.2f} at {scan.best_return_frequency:+.2f} Hz",
        ))  # fmt: skip
    tables.table(f"Policy for {assessment.task}", ("figure", "value"), rows)
    if assessment.loops:
        rows = [
            (name, f"{loop.statistics.episode_return:.3f}", f"{loop.statistics.distance:.3f}", f"{loop.drift:.3f}",
             f"{loop.sideways:.3f}", f"{100 * loop.statistics.success:.0f} %")
            for name, loop in assessment.loops.items()
        ]  # fmt: skip
        tables.table("Loops", ("loop", "return", "distance m", "drift m", "sideways m", "reached"), rows)
