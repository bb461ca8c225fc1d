"""A recording of other programs' logs: which of their columns a robot's trial is made of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from markertrack.span import Span
from markertrack.track import MarkerTrack
from swim2real.robots.robot import Robot
from swim2real.trials import Signals, Trial
from swim2real.trials.log_table import LogTable, choices
from swim2real.trials.timebase import by_stamps
from swimbase.arrays import Array
from swimbase.errors import ArgumentError, TrialError, about

_DIGITS = 9  # of times in s


@dataclass(frozen=True)
class Wanted:
    """Which columns are taken for what; what isn't named is taken from the column of its name.

    Attributes:
        time: Columns of the time stamps, of which each table has one; none for the one that is called so.
        controls: Columns by the names of actuators.
        sensors: Columns by the names of sensors.
        markers: Columns by the names of markers: x and y of the camera's plane, with a comma between them.
    """

    time: tuple[str, ...]
    controls: Mapping[str, str]
    sensors: Mapping[str, str]
    markers: Mapping[str, str]

    @classmethod
    def of(
        cls, robot: Robot, time: Sequence[str], controls: Sequence[str], sensors: Sequence[str], markers: Sequence[str]
    ) -> Wanted:
        """Reads options, each given as NAME=COLUMN.

        Raises:
            ArgumentError: The robot has no actuator that takes a table, no such sensor or no such marker.
        """
        return cls(
            tuple(time),
            choices("controls", controls, _commanded(robot), f"actuator that robot '{robot.name}' takes from a table"),
            choices(
                "sensors",
                sensors,
                [sensor.name for sensor in robot.trials.sensors],
                f"sensor under [recordings.sensors] of robot '{robot.name}'",
                behind=partial(_behind, robot),
            ),
            choices("markers", markers, robot.marker_names, f"marker of robot '{robot.name}'"),
        )


@dataclass(frozen=True)
class Recorded:
    """A trial, and what it is made of.

    Attributes:
        trial: The trial.
        rows: How many rows the log has.
        columns: Columns in words, by what they were taken for, such as `sensor load`.
        notes: What was understood without being said, or is missing.
    """

    trial: Trial
    rows: int
    columns: Mapping[str, str]
    notes: Sequence[str]


def recorded(
    name: str, log: LogTable, robot: Robot, wanted: Wanted, *, span: Span, from_first_row: bool,
    commands: LogTable | None = None, tracked: Trial | None = None, frequency: float | None = None,
) -> Recorded:  # fmt: skip
    """Makes a trial of a log, or adds the log's controls and sensors to a trial that was tracked.

    Args:
        name: Name of the trial.
        log: The log.
        robot: Whose trial it is.
        wanted: Which columns are taken.
        span: The stretch that is taken, counted from the log's first row [s].
        from_first_row: Of a trial that was tracked: whether the beginning of the stretch is the time of its video's
            first frame; otherwise the log is on the video's clock.
        commands: Log of the controls, where it is another one, on the same clock.
        tracked: The trial of this name that is there, whose track is kept if the log has no markers.
        frequency: What was asked of the motor [Hz].

    Raises:
        ArgumentError: A column isn't there, or its unit isn't known.
        TrialError: Cells or times are wrong, or there is nothing to compare.
    """
    tables = [log] if commands is None else [log, commands]
    for text in wanted.time:
        if not any(table.has(text) for table in tables):
            raise ArgumentError(log.missing(text, "the time stamps (--time COLUMN:UNIT)"))
    clocks = [table.times(*wanted.time) for table in tables]
    stamps, driving_times = clocks[0], clocks[-1]
    columns = {"time": stamps.words}
    notes = [note for clock in clocks for note in clock.notes]
    positions = _positions(log, robot, wanted, columns)
    into = tracked if positions is None and robot.marker_names else None
    if into is None and positions is None and robot.marker_names:
        raise ArgumentError(
            f"{log.path} has no columns of the markers {', '.join(robot.marker_names)}, and there is no trial '{name}' "
            f"that was tracked: say --markers NAME=XCOLUMN,YCOLUMN for each, or track its film first"
        )
    if into is not None and span.until is not None:
        raise ArgumentError(f"--until is for new trials; '{name}' was tracked, and its frames say where it ends")
    if into is None:
        zero, origin = stamps.first, f"first row of {log.path.name}"
    elif from_first_row:
        zero, origin = stamps.first + round(1e9 * span.begin), f"first row of {log.path.name} plus {span.begin:g} s"
    else:
        zero, origin = 0, f"time 0 of {log.path.name}"
    driving = tables[-1]
    limits = {sensor.name: sensor.unit for sensor in robot.trials.sensors}
    controls = _signals(
        "actuator", driving, driving_times.since(zero), dict.fromkeys(_commanded(robot), ""), wanted.controls, columns,
        notes, optional=into is not None and into.controls is not None,
    )  # fmt: skip
    sensors = _signals(
        "sensor", log, stamps.since(zero), limits, wanted.sensors, columns, [],
        optional=into is not None and into.sensors is not None,
    )  # fmt: skip
    if into is not None:
        if controls is None and sensors is None:
            raise ArgumentError(f"{log.path}: nothing of it is taken; say --controls or --sensors NAME=COLUMN")
        trial = replace(
            into, controls=controls or into.controls, sensors=sensors or into.sensors,
            timebases={**into.timebases, **by_stamps(origin, controls=controls, sensors=sensors)},
        )  # fmt: skip
        return Recorded(_on_clock(trial, log), len(stamps.values), columns, notes)
    if positions is None:
        if sensors is None:
            raise TrialError(f"robot '{robot.name}' has neither markers nor sensors, so there is nothing to compare")
        track = MarkerTrack(sensors.times, np.zeros((len(sensors.times), 0, 2)))
    else:
        seen = np.isfinite(positions).all(axis=2).any(axis=-1)
        if seen.sum() < 2:
            raise TrialError(f"{log.path}: {seen.sum()} rows have a marker; a trial needs at least 2")
        track = MarkerTrack(np.round(stamps.since(zero), _DIGITS)[seen], positions[seen])
    clocks = by_stamps(origin, track=track if track.marker_count else None, controls=controls, sensors=sensors)
    trial = Trial(
        name, track, frequency, provenance=f"log {log.path.name}", controls=controls, sensors=sensors, timebases=clocks
    )
    return Recorded(_on_clock(trial, log).within(span), len(stamps.values), columns, notes)


def _commanded(robot: Robot) -> list[str]:
    """Actuators that a table drives."""
    return [name for name, drive in robot.trials.controls.items() if drive.table]


def _signals(
    kind: str, log: LogTable, times: Array, units: Mapping[str, str], given: Mapping[str, str],
    columns: dict[str, str], notes: list[str], *, optional: bool,
) -> Signals | None:  # fmt: skip
    """Columns as signals, rows without any left out; None where none is needed, or none is there that needn't be."""
    if optional and not given and not any(log.has(name) for name in units):
        return None
    option, without = ("--controls", "") if kind == "actuator" else (
        "--sensors", " or, where it wasn't measured, put # before it under [recordings.sensors] of the robot file"
    )  # fmt: skip
    found: dict[str, Array] = {}
    for name, unit in units.items():
        what = f"{kind} '{name}'" + ("" if name in given else f", so say {option} {name}=COLUMN{without}")
        columns[f"{kind} {name}"], found[name] = log.column(given.get(name, name), what, unit)
        if lacking := int(np.isnan(found[name]).sum()):
            notes.append(f"{lacking} of {len(times)} rows have no value of {kind} '{name}': the one before holds")
    if not found:
        return None
    values = np.stack(list(found.values()), axis=1)
    kept = np.isfinite(values).any(axis=-1)
    if not kept.any():
        raise TrialError(f"{log.path}: the columns of {', '.join(found)} are empty; take others")
    return Signals(np.round(times, _DIGITS)[kept], tuple(units), values[kept])


def _positions(log: LogTable, robot: Robot, wanted: Wanted, columns: dict[str, str]) -> Array | None:
    """Positions of all markers [m], shape (R, M, 2); None where the log has no columns of theirs."""
    pairs = {name: wanted.markers.get(name) or _named_so(log, robot, name) for name in robot.marker_names}
    if not any(pairs.values()):
        return None
    if lacking := [name for name, pair in pairs.items() if not pair]:
        raise ArgumentError(
            f"{log.path} has no columns for the markers {', '.join(lacking)}; say --markers NAME=XCOLUMN,YCOLUMN for "
            f"each"
        )
    found: list[Array] = []
    for name, pair in pairs.items():
        texts = _pair(log, name, pair or "")
        axes = [log.column(text, f"{axis} of marker '{name}'", "m") for axis, text in zip("xy", texts, strict=True)]
        columns[f"marker {name}"] = " and ".join(words for words, _ in axes)
        found.append(np.stack([values for _, values in axes], axis=1))
    return np.stack(found, axis=1)


def _named_so(log: LogTable, robot: Robot, name: str) -> str | None:
    """The two columns that are called after a marker and the axes of its plane."""
    for axes in ("".join("xyz"[axis] for axis in robot.plane), "xy"):
        for form in ("{}_{}", "{}_{}_m"):
            pair = [form.format(name, axis) for axis in axes]
            if all(map(log.has, pair)):
                return ",".join(pair)
    return None


def _behind(robot: Robot, name: str) -> str:
    """That a sensor is in the robot file behind a #, and what to do; empty where it isn't."""
    text = "" if robot.source is None else robot.source.read_text(encoding="utf-8")
    if not re.search(rf'(?m)^\s*#\s*"?{re.escape(name)}"?\s*=', text):
        return ""
    return f"; it is there behind #: remove that in {robot.source}, and the one before [recordings.sensors]"


def _pair(log: LogTable, name: str, text: str) -> tuple[str, str]:
    """Two columns that were given as X,Y or X,Y:UNIT."""
    parts = text.split(",")
    if len(parts) != 2:
        raise ArgumentError(f"--markers has '{name}={text}'; say {name}=XCOLUMN,YCOLUMN or {name}=XCOLUMN,YCOLUMN:UNIT")
    x, y = parts
    unit = "" if y in log.names else y.rpartition(":")[2] if ":" in y else ""
    return (f"{x}:{unit}" if unit and (x in log.names or ":" not in x) else x), y


def _on_clock(trial: Trial, log: LogTable) -> Trial:
    """The trial, if its tables are on the clock of its track.

    Raises:
        TrialError: They aren't.
    """
    for what, signals in trial.signals.items():
        remedy = "; --from T says at which second after the log's first row the video begins"
        with about(f"{log.path}: the {what} of trial '{trial.name}' aren't on its clock", remedy):
            signals.check_clock(float(trial.track.times[0]), float(trial.track.times[-1]))
    return trial
