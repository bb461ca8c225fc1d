"""What a trial of a robot is, as its file says: steady swims, or recordings with what drives them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco

from swim2real.errors import RobotError
from swim2real.robots.compiled import compiled
from swim2real.robots.hooks import called
from swim2real.robots.robot import Control, Recordings, Sensor, Sine, SteadySwims
from swim2real.robots.table import Table


def read_trials(table: Table, spec: mujoco.MjSpec, markers: tuple[str, ...], folder: Path) -> SteadySwims | Recordings:
    """What [recordings] or [swims] says.

    Raises:
        RobotError: Neither or both are there, or one doesn't fit the model or its markers; names what exists.
    """
    kinds = [key for key in ("recordings", "swims") if key in table.content]
    if len(kinds) != 1:
        raise RobotError(
            f"{table.where}: there must be [recordings], for trials that are played back, or [swims], for a motor "
            f"that turns at a constant speed; found {' and '.join(kinds) or 'neither'}"
        )
    part = table.table(kinds[0])
    return _swims(part, markers, spec, folder) if kinds == ["swims"] else _recordings(part, markers, spec)


def _swims(part: Table, markers: tuple[str, ...], spec: mujoco.MjSpec, folder: Path) -> SteadySwims:
    part.allow("surge_joints", "motor_joint", "tail_markers", "response", "fit_plan")
    surge, motor = part.texts("surge_joints", 2), part.text("motor_joint")
    joints = [joint.name for joint in spec.joints]
    for key, name in (*(("surge_joints", one) for one in surge), ("motor_joint", motor)):
        if name not in joints:
            raise part.wrong(key, name, f"must be a joint of the model: {', '.join(joints)}")
    if len(spec.actuators) != 1:
        raise RobotError(
            f"{part.where}: the model has {len(spec.actuators)} actuators; steady swims need one, which turns "
            f"motor_joint at the speed that it is given [rad/s]; use [recordings] for other robots"
        )
    if len(markers) < 2:
        raise RobotError(f"{part.where}: there is one marker; steady swims need two, the first two on the head")
    return SteadySwims(
        surge_joints=(surge[0], surge[1]),
        motor_joint=motor,
        tail_markers=tuple(marker_index(part, "tail_markers", name, markers) for name in part.texts("tail_markers")),
        response=called(part, "response", folder) if "response" in part.content else None,
        fit_plan=called(part, "fit_plan", folder) if "fit_plan" in part.content else None,
    )


def _recordings(part: Table, markers: tuple[str, ...], spec: mujoco.MjSpec) -> Recordings:
    part.allow("controls", "sensors", "start", "frame", "travels")
    actuators = [actuator.name for actuator in spec.actuators]
    controls: dict[str, Control] = {}
    table = part.table("controls")
    for name in table.content:
        if name not in actuators:
            raise RobotError(
                f"{table.where}: the model has no actuator '{name}'; there are {', '.join(actuators) or 'none'}"
            )
        controls[name] = _control(table, name)
    start = part.text("start", "rest")
    keys = [key.name for key in spec.keys]
    if start not in ("rest", "markers", *keys):
        raise part.wrong("start", start, f"must be one of rest, markers{''.join(f', {key}' for key in keys)}")
    frame = _frame(part, markers) if "frame" in part.content else None
    travels = part.truth("travels")
    if travels and frame is None:
        raise part.wrong("travels", travels, "needs frame, the two markers that say where it points")
    return Recordings(controls, _sensors(part.table("sensors"), spec), start, frame, travels)


def _frame(part: Table, markers: tuple[str, ...]) -> tuple[int, int]:
    first, second = (marker_index(part, "frame", name, markers) for name in part.texts("frame", 2))
    if first == second:
        raise part.wrong("frame", part.content["frame"], "must be two different markers")
    return first, second


def marker_index(table: Table, key: str, name: Any, names: tuple[str, ...]) -> int:
    """Which marker a name is.

    Raises:
        RobotError: None is named so.
    """
    if name not in names:
        raise table.wrong(key, name, f"must be a marker: {', '.join(names)}")
    return names.index(name)


def _control(table: Table, name: str) -> Control:
    value: Any = table.content[name]
    if isinstance(value, Mapping):
        sine = Table(value, f"{table.where}, {name}")
        sine.allow("amplitude", "phase", "offset")
        return Sine(sine.number("amplitude"), sine.number("phase", 0.0), sine.number("offset", 0.0))
    if value in ("table", "frequency"):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise table.wrong(name, value, 'must be "table", "frequency", a number, or {amplitude = …}')
    return table.number(name)


def _sensors(table: Table, spec: mujoco.MjSpec) -> tuple[Sensor, ...]:
    if not table.content:
        return ()
    model = compiled(spec.copy(), table.where)
    sizes = {model.sensor(i).name: int(model.sensor_dim[i]) for i in range(model.nsensor) if model.sensor(i).name}
    found: list[Sensor] = []
    for name in table.content:
        _check_sensor(table, name, sizes)
        one = table.table(name)
        one.allow("unit", "worth")
        worth = one.number("worth")
        if worth <= 0:
            raise one.wrong("worth", worth, "must be above 0: meters of marker error that one unit counts as")
        found.append(Sensor(name, one.text("unit", "-"), worth))
    return tuple(found)


def _check_sensor(table: Table, name: str, sizes: Mapping[str, int]) -> None:
    """`NAME`, or `"NAME[I]"` for one number of a vector."""
    matched = re.fullmatch(r"(.*)\[(\d+)\]", name)
    stem, index = (name, None) if name in sizes or matched is None else (matched[1], int(matched[2]))
    if stem not in sizes:
        raise RobotError(f"{table.where}: the model has no sensor '{stem}'; there are {', '.join(sizes) or 'none'}")
    size = sizes[stem]
    if index is None and size > 1:
        raise RobotError(
            f'{table.where}: sensor \'{stem}\' has {size} values; say which one: "{stem}[0]" to "{stem}[{size - 1}]"'
        )
    if index is not None and index >= size:
        raise RobotError(f"{table.where}: sensor '{stem}' has {size} values, from [0]; there is no [{index}]")
