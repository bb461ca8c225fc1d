"""`export-commands`."""

from __future__ import annotations

import json

from swim2real.cli.rl_arguments import ExportCommands
from swim2real.cli.trained import robot_of_training
from swim2real.deployment.commands import XW540_T140, CommandTable, Limits, write_table
from swim2real.rl.assessment import policy_commands


def export_commands(a: ExportCommands) -> int:
    """Writes a policy's commands, checked and ramped."""
    limits = Limits(
        XW540_T140.speed if a.max_speed is None else a.max_speed,
        XW540_T140.acceleration if a.max_acceleration is None else a.max_acceleration,
    )
    found = policy_commands(a.policy, robot_of_training(a.policy), a.seconds, which=a.which, phase=a.phase, goal=a.goal)
    table = CommandTable.of(found.tolist())
    table = (table.clipped(limits) if a.clip else table.within(limits)).ramped(a.ramp)
    write_table(a.out, table.times, table.velocities)
    about = {
        "commands": len(table.times), "seconds": table.duration, "speed": table.speed,
        "acceleration": table.acceleration, "out": str(a.out),
    }  # fmt: skip
    if a.json:
        print(json.dumps(about, indent=2))
    else:
        print(
            f"{a.out}: {len(table.times)} commands, {table.duration:.2f} s with ramps, at most {table.speed:.2f} rad/s "
            f"and {table.acceleration:.0f} rad/s²; `swim2real deploy {a.out} --dry-run` tries them"
        )
    return 0
