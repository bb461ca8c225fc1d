"""`import-recording`: logs of a controller, of encoders or of motion capture, to a reference."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import From, finite_above_0, one_each, word
from swim2real.cli.terminal import say, tell
from swimbase.errors import ArgumentError, Swim2RealError

Named = Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=COLUMN[:UNIT] ...")]
NamedPairs = Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=XCOLUMN,YCOLUMN[:UNIT] ...")]


def import_recording(
    tables: Positional[tuple[Path, ...]], *, robot: str, to: opt.ToReference,
    time: Annotated[tuple[str, ...], tyro.conf.arg(metavar="COLUMN[:UNIT] ...")] = (), controls: Named = (),
    sensors: Named = (), markers: NamedPairs = (), control_tables: tuple[Path, ...] = (),
    frequency: opt.Frequencies = (), begin: From = (), until: opt.Until = (),
) -> int:  # fmt: skip
    """Make trials of logs: text tables with a header, of any program and in any units.

    Reads one table per trial; adds the trials to a reference folder, reference.json included. Unnamed parts are taken
    from the column of their own name. A column's unit is the given one (hip=q1:deg), or that of its header (hip_deg,
    'load [mN]', a row of units), or the model's. A factor may stand before it, or in its place (hip=q1:-1,
    hip=counts:0.0879deg). If a trial has been tracked and its log has no markers, the track is kept. Exits with
    1 where the trials, which are written all the same, are probably of another unit, order, axes, clock or sign.

    Args:
        tables: Tables, one per trial, of any encoding and separator; their names become the trials' names.
        robot: Robot whose recordings they are: a robot file (.toml), or fish.
        time: Column of the time stamps, which may count from 1970 or be dates; by default time, t, timestamp or stamp.
            Two where tables and control tables name it differently.
        controls: Columns of the actuators that the robot file drives by a table.
        sensors: Columns of the sensors that the robot file compares.
        markers: Columns of the markers in the camera's plane; by default NAME_x and NAME_y, or named after the plane's
            axes.
        control_tables: Separate tables of the controls, one per table and on its clock.
        begin: Use the log from this time after its first row on [s], which becomes time 0 of the trial; one for all
            tables, or one for each. For a tracked trial: when the video begins; by default the log is on the video's
            clock.
    """
    if not tables:
        raise ArgumentError("no table was given")
    for option, values in (("control-tables", control_tables), ("frequency", frequency)):
        one_each(option, values, len(tables), "tables")
    finite_above_0("frequency", *frequency, unit=" Hz")
    from swim2real import pipeline
    from swim2real.checks.mistakes import judged
    from swim2real.robots import load_robot
    from swim2real.trials import TrialSet

    body = load_robot(robot, markers_only=True)
    made = pipeline.import_recording(
        tables, body, to, time=time, controls=controls, sensors=sensors, markers=markers,
        control_tables=control_tables, frequency=frequency, begin=begin, until=until,
    )  # fmt: skip
    for one, path in zip(made, tables, strict=True):
        say(f"{one.trial.name}: {one.rows} rows of {path}; the trial has {one.trial.track.duration:.2f} s")
        say(f"  {', '.join(f'{what} from {column}' for what, column in one.columns.items())}")
        for note in (*(f"{stream} at {clock}" for stream, clock in one.trial.timebases.items()), *one.notes):
            say(f"  {note}")
    doubts: tuple[str, ...] = ()
    try:
        doubts = judged(body, TrialSet(tuple(one.trial for one in made), body.marker_names)).doubts
    except Swim2RealError as error:
        tell(f"warning: whether they are the robot's wasn't seen: {error}")
    for line in doubts:
        tell(f"warning: probably wrong: {line}; the trials are written all the same")
    say(f"{to}: {len(made)} trials. Next: swim2real check {word(robot)} --reference {word(to)}")
    return 1 if doubts else 0
