"""`export-sysid` and `import-sysid`."""

from __future__ import annotations

from swim2real.calibration import Problem
from swim2real.cli import tables
from swim2real.cli.calibrate import horizon, threads
from swim2real.cli.subject import PUBLISHED, robot_for, values_of
from swim2real.cli.sysid_arguments import ExportSysid, ImportSysid
from swim2real.parameters import read_parameters, write_parameters
from swim2real.simulation import Engine
from swim2real.sysid import read_values, save, to_sysid
from swim2real.trials import load_reference


def export_sysid(a: ExportSysid) -> int:
    """Writes a problem as the toolbox's files."""
    robot = robot_for(a.parameters)
    problem = Problem(
        robot, load_reference(a.reference), horizon=horizon(a.horizon), threads=threads(a.threads)
    )  # fmt: skip
    save(to_sysid(problem, values_of(a.parameters, problem)), a.out)
    tables.console.print(f"{a.out}: {len(robot.space)} parameters, {len(problem.trials)} trials", soft_wrap=True)
    return 0


def import_sysid(a: ImportSysid) -> int:
    """Writes identified values as a parameters file."""
    robot = robot_for(a.like)
    published = str(a.like) == PUBLISHED
    others = robot.space.published if published else read_parameters(a.like, robot.name, robot.space).values
    values, engine = read_values(a.results, robot.space, others), Engine.of(robot)
    write_parameters(a.out, robot.name, values, engine.name, engine.as_dict(), robot.source)
    changed = sum(values[name] != others[name] for name in values)
    tables.console.print(f"{a.out}: {changed} of {len(values)} parameters differ from {a.like}", soft_wrap=True)
    return 0
