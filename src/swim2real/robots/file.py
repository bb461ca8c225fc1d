"""Robot files: a TOML file beside an MJCF model says what is calibrated, which sites are markers and what a trial is.

```
format = 1
name = "finger"
description = "..."                    for a person or a VLM who has never seen it
model = "finger.xml"                   MJCF beside this file, or "python:module:function" that returns an MjSpec
camera = "side"                        above (x right, y up), side (x right, z up) or front (y right, z up)
markers = ["base", "knuckle", "tip"]   sites, in the order in which they are tracked
links = [["base", "knuckle"]]          lines of pictures; by default from each marker to the next

[recordings]                           or [swims], for a motor that turns at a constant speed
start = "markers"                      rest, markers or the name of a keyframe
frame = ["base", "knuckle"]            compare in the frame of two markers; left out: in the world
travels = false                        whether a speed means something
[recordings.controls]
tendon = "table"                       or "frequency", a number, or {amplitude = 1.0, phase = 0.0, offset = 0.0}
[recordings.sensors]
load = {unit = "N", worth = 0.01}      an error of 1 N counts as much as 10 mm

[[parameters]]
name = "knuckle_damping"
unit = "N·m·s/rad"
lower = 1e-4
upper = 1e-1
scale = "log"                          or linear; log_offset moves the logarithm's zero
meaning = "..."
value = 1e-3                           by default what the model has
writes = ['joint "knuckle" damping']   or {to = ..., factor = 1.0, offset = 0.0, relative = true}
```

A file that says `extends = "OTHER.toml"` takes over what it doesn't say itself, and adds its parameters.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import RobotError
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.calibrated import Calibrated, read_calibrated
from swim2real.robots.hooks import hook
from swim2real.robots.robot import Control, Recordings, Robot, Sensor, Sine, SteadySwims
from swim2real.robots.table import Table, read_toml

FORMAT = 1
PLANES = {"above": (0, 1), "side": (0, 2), "front": (1, 2)}
MARKER = "marker:"  # before the name of a marker's sensor, where the model may have others
_KEYS = (
    "format", "extends", "name", "description", "model", "camera", "markers", "links", "recordings", "swims",
    "parameters",
)  # fmt: skip


def load_robot(path: str | Path) -> Robot:
    """The robot that a file describes.

    Raises:
        RobotError: The file can't be read, or doesn't fit its model; names the place and what exists.
    """
    place = Path(path)
    table = _whole(place)
    spec = _base(table, place.parent)
    calibrated = read_calibrated(table, spec)
    marker_names, sites, given_rest = _markers(table, spec)
    links = _links(table, marker_names)
    plane = PLANES[table.one_of("camera", tuple(PLANES), "above")]
    trials = _trials(table, spec, marker_names, place.parent)
    prefix = "" if isinstance(trials, SteadySwims) else MARKER
    space = ParameterSpace(tuple(one.parameter for one in calibrated))
    builder = _Builder(spec, space, calibrated, tuple(zip(marker_names, sites, strict=True)), prefix)
    positions = _rest(builder.build(space.published), sites, table)
    rest = positions[:, plane] - positions[0, plane]
    rest = np.where(np.isfinite(given_rest), given_rest, rest)
    away = next(axis for axis in range(3) if axis not in plane)
    rest.flags.writeable = positions.flags.writeable = False
    return Robot(
        name=table.text("name"),
        description=" ".join(table.text("description").split()),
        space=space,
        build=builder.build,
        marker_names=marker_names,
        rest_markers=rest,
        marker_heights=positions[:, away],
        trials=trials,
        plane=plane,
        links=links,
        source=place,
    )


def fingerprint(path: str | Path) -> str:
    """Of a robot file and its model, so that a change of either is seen."""
    place = Path(path)
    table = _whole(place)
    xml = _base(table, place.parent).to_xml()
    return hashlib.sha256(repr((dict(table.content), xml)).encode()).hexdigest()[:16]


def _whole(place: Path) -> Table:
    """The file, with what it takes over."""
    table = read_toml(place)
    table.allow(*_KEYS)
    if "extends" in table.content:
        other = _whole(place.parent / table.text("extends"))
        ours = dict(table.content)
        content: dict[str, Any] = {**other.content, **ours}
        for key in ("swims", "recordings"):
            if isinstance(ours.get(key), dict):
                content[key] = {**other.content.get(key, {}), **ours[key]}
        content["parameters"] = [*other.list("parameters"), *table.list("parameters")]
        content.pop("extends")
        table = Table(content, table.where)
    if table.content.get("format") != FORMAT:
        raise table.wrong("format", table.content.get("format"), f"must be {FORMAT} for this version")
    return table


def _base(table: Table, folder: Path) -> mujoco.MjSpec:
    """The model before anything is written to it."""
    model = table.text("model")
    if model.startswith("python:"):
        return hook(table, "model", folder)()
    path = folder / model
    if not path.is_file():
        raise RobotError(f"{table.where}: model '{path}' is not there; give the MJCF file's way from the robot file")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise RobotError(f"{table.where}: MuJoCo can't read model '{path}': {error}") from error


class _Builder:
    """Makes specs for parameter values."""

    def __init__(
        self, base: mujoco.MjSpec, space: ParameterSpace, calibrated: tuple[Calibrated, ...],
        markers: tuple[tuple[str, str], ...], prefix: str,
    ) -> None:  # fmt: skip
        self._base, self._space, self._calibrated = base, space, calibrated
        if not prefix:  # only the markers' own
            for sensor in list(base.sensors):
                base.delete(sensor)
        for name, site in markers:
            base.add_sensor(
                name=f"{prefix}{name}", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=site,
            )  # fmt: skip

    def build(self, values: Values) -> mujoco.MjSpec:
        """A spec ready to compile.

        Raises:
            ParameterError: A value is missing, unknown, not finite or out of bounds.
        """
        checked = self._space.check(values)
        spec = self._base.copy()
        for one in self._calibrated:
            for write in one.writes:
                write.apply(spec, checked[one.parameter.name])
        return spec


def _markers(table: Table, spec: mujoco.MjSpec) -> tuple[tuple[str, ...], tuple[str, ...], NDArray[np.float64]]:
    """Names, sites, and positions at rest where the file gives them [m]. Shape (M, 2)."""
    there = [site.name for site in spec.sites if site.name]
    names: list[str] = []
    sites: list[str] = []
    rest: list[list[float]] = []
    for entry in table.list("markers"):
        one = Table(entry if isinstance(entry, dict) else {"site": entry}, f"{table.where}, markers")
        one.allow("site", "name", "rest")
        site = one.text("site")
        if site not in there:
            raise RobotError(f"{one.where}: the model has no site '{site}'; there are {', '.join(there) or 'none'}")
        given = one.content.get("rest", [np.nan, np.nan])
        if not isinstance(given, list) or len(given) != 2:
            raise one.wrong("rest", given, "must be two numbers, in m from the first marker")
        sites.append(site)
        names.append(one.text("name", site))
        rest.append([float(x) for x in given])
    if not names or len(set(names)) < len(names):
        raise table.wrong("markers", names, f"must name one site at least, each once; there are {', '.join(there)}")
    return tuple(names), tuple(sites), np.array(rest)


def _links(table: Table, names: tuple[str, ...]) -> tuple[tuple[int, int], ...]:
    if "links" not in table.content:
        return tuple((i, i + 1) for i in range(len(names) - 1))
    found: list[tuple[int, int]] = []
    for pair in table.list("links"):
        if not isinstance(pair, list) or len(pair) != 2:
            raise table.wrong("links", pair, "must be pairs of markers")
        found.append((_marker(table, "links", pair[0], names), _marker(table, "links", pair[1], names)))
    return tuple(found)


def _marker(table: Table, key: str, name: Any, names: tuple[str, ...]) -> int:
    if name not in names:
        raise table.wrong(key, name, f"must be a marker: {', '.join(names)}")
    return names.index(name)


def _rest(spec: mujoco.MjSpec, sites: tuple[str, ...], table: Table) -> NDArray[np.float64]:
    """Positions of the sites in the pose of the model [m]. Shape (M, 3)."""
    try:
        model = spec.compile()
    except ValueError as error:
        raise RobotError(f"{table.where}: the model doesn't compile: {error}") from error
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.array([data.site(site).xpos for site in sites])


def _trials(table: Table, spec: mujoco.MjSpec, markers: tuple[str, ...], folder: Path) -> SteadySwims | Recordings:
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
    return SteadySwims(
        surge_joints=(surge[0], surge[1]),
        motor_joint=motor,
        tail_markers=tuple(_marker(part, "tail_markers", name, markers) for name in part.texts("tail_markers")),
        response=hook(part, "response", folder)() if "response" in part.content else None,
        fit_plan=hook(part, "fit_plan", folder)() if "fit_plan" in part.content else None,
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
    frame = part.texts("frame", 2) if "frame" in part.content else None
    pair = (
        None
        if frame is None
        else (_marker(part, "frame", frame[0], markers), _marker(part, "frame", frame[1], markers))
    )
    travels = part.truth("travels")
    if travels and pair is None:
        raise part.wrong("travels", travels, "needs frame, the two markers that say where it points")
    return Recordings(controls, _sensors(part.table("sensors"), spec), start, pair, travels)


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
    return float(value)


def _sensors(table: Table, spec: mujoco.MjSpec) -> tuple[Sensor, ...]:
    there = [sensor.name for sensor in spec.sensors if sensor.name]
    found: list[Sensor] = []
    for name in table.content:
        if name.partition("[")[0] not in there:
            raise RobotError(f"{table.where}: the model has no sensor '{name}'; there are {', '.join(there) or 'none'}")
        one = table.table(name)
        one.allow("unit", "worth")
        worth = one.number("worth")
        if worth <= 0:
            raise one.wrong("worth", worth, "must be above 0: meters of marker error that one unit counts as")
        found.append(Sensor(name, one.text("unit", "-"), worth))
    return tuple(found)
