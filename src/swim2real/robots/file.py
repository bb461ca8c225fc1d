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

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import RobotError
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.calibrated import Calibrated, read_calibrated
from swim2real.robots.compiled import compiled, said
from swim2real.robots.hooks import called, hook_file
from swim2real.robots.robot import Robot, SteadySwims
from swim2real.robots.table import Table, read_toml
from swim2real.robots.trial_table import marker_index, read_trials

FORMAT = 1
PLANES = {"above": (0, 1), "side": (0, 2), "front": (1, 2)}
MARKER = "marker:"  # before the name of a marker's sensor, where the model may have others
_KEYS = (
    "format", "extends", "name", "description", "model", "camera", "markers", "links", "recordings", "swims",
    "parameters",
)  # fmt: skip


@dataclass(frozen=True)
class RobotFile:
    """A robot file and the model that it is about.

    Attributes:
        place: Of the file.
        table: All that it says, with what it takes over from others.
        spec: The model before any parameter is written to it.
        calibrated: The parameters and what they write.
    """

    place: Path
    table: Table
    spec: mujoco.MjSpec
    calibrated: tuple[Calibrated, ...]


def load_robot(path: str | Path) -> Robot:
    """The robot that a file describes.

    Raises:
        RobotError: The file can't be read, or doesn't fit its model; names the place and what exists.
    """
    file = open_robot_file(path)
    table, spec = file.table, file.spec
    marker_names, sites, given_rest = _markers(table, spec)
    links = _links(table, marker_names)
    plane = PLANES[table.one_of("camera", tuple(PLANES), "above")]
    trials = read_trials(table, spec, marker_names, file.place.parent)
    prefix = "" if isinstance(trials, SteadySwims) else MARKER
    space = ParameterSpace(tuple(one.parameter for one in file.calibrated))
    builder = _Builder(file, space, tuple(zip(marker_names, sites, strict=True)), prefix)
    positions = _rest(builder.build(space.published), sites, table)
    rest = positions[:, plane] - positions[0, plane]
    rest = np.where(np.isfinite(given_rest), given_rest, rest)
    right, up = np.eye(3)[list(plane)]
    heights = positions @ np.cross(right, up)  # toward the camera
    rest.flags.writeable = heights.flags.writeable = False
    return Robot(
        name=table.text("name"),
        description=" ".join(table.text("description").split()),
        space=space,
        build=builder.build,
        marker_names=marker_names,
        rest_markers=rest,
        marker_heights=heights,
        trials=trials,
        plane=plane,
        links=links,
        source=file.place,
    )


def open_robot_file(path: str | Path) -> RobotFile:
    """Reads a robot file, its model and its parameters.

    Raises:
        RobotError: One can't be read, or a parameter doesn't fit the model.
    """
    place = Path(path)
    table = read_whole(place)
    spec = _base(table, place.parent)
    return RobotFile(place, table, spec, read_calibrated(table, spec))


def read_whole(place: Path, by: tuple[Path, ...] = ()) -> Table:
    """A robot file with what it takes over from others, whose places are given from this file.

    Raises:
        RobotError: It or one of them can't be read, or they go round in circles.
    """
    table = read_toml(place)
    table.allow(*_KEYS)
    if "extends" in table.content:
        folder = Path(table.text("extends")).parent
        path = place.parent / table.text("extends")
        if path.resolve() in (place.resolve(), *by):
            raise table.wrong("extends", table.text("extends"), "must not lead back to the file itself")
        taken = read_whole(path, (place.resolve(), *by))
        other, ours = _moved(taken.content, folder), dict(table.content)
        content: dict[str, Any] = {**other, **ours}
        for key in ("swims", "recordings"):
            if isinstance(ours.get(key), dict) and isinstance(other.get(key), dict):
                content[key] = {**other[key], **ours[key]}
        content["parameters"] = [*taken.list("parameters"), *table.list("parameters")]
        content.pop("extends")
        table = Table(content, table.where)
    if table.content.get("format") != FORMAT:
        raise table.wrong("format", table.content.get("format"), f"must be {FORMAT} for this version")
    return table


def _moved(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What a file says, with the places that it names seen from another folder."""

    def moved(value: Any) -> Any:
        file = hook_file(value) if isinstance(value, str) else None
        return value if file is None else f"python:{(folder / file).as_posix()}:{value.rpartition(':')[2]}"

    found = dict(content)
    model = found.get("model")
    if isinstance(model, str):
        found["model"] = moved(model) if model.startswith("python:") else (folder / model).as_posix()
    if isinstance(found.get("swims"), dict):
        found["swims"] = {key: moved(value) for key, value in found["swims"].items()}
    return found


def _base(table: Table, folder: Path) -> mujoco.MjSpec:
    """The model before anything is written to it."""
    model = table.text("model")
    if model.startswith("python:"):
        spec = called(table, "model", folder)
        if not isinstance(spec, mujoco.MjSpec):
            raise table.wrong("model", model, f"must return an MjSpec, not {type(spec).__name__}")
        return spec.copy()  # it may be used again
    path = folder / model
    if not path.is_file():
        raise RobotError(f"{table.where}: model '{path}' is not there; give the MJCF file's way from the robot file")
    return read_mjcf(path, f"{table.where}: ")


def read_mjcf(path: Path, where: str = "") -> mujoco.MjSpec:
    """The model of an MJCF file.

    Args:
        path: Of the file.
        where: What a message begins with.

    Raises:
        RobotError: MuJoCo can't read it.
    """
    try:
        return mujoco.MjSpec.from_file(str(path.resolve()))  # its meshes are found from any working directory
    except ValueError as error:
        raise RobotError(f"{where}MuJoCo can't read model '{path}': {said(error)}") from error


class _Builder:
    """Makes specs for parameter values."""

    def __init__(
        self, file: RobotFile, space: ParameterSpace, markers: tuple[tuple[str, str], ...], prefix: str
    ) -> None:
        base = file.spec
        self._base, self._space, self._calibrated, self._place = base, space, file.calibrated, file.place.resolve()
        if not prefix:  # only the markers' own
            for sensor in list(base.sensors):
                base.delete(sensor)
        for name, site in markers:
            base.add_sensor(
                name=f"{prefix}{name}", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=site,
            )  # fmt: skip

    def __reduce__(self) -> tuple[Any, ...]:
        """A spec can't go to another process; the file is read again there."""
        return _builder_of, (self._place,)

    def build(self, values: Values) -> mujoco.MjSpec:
        """A spec ready to compile.

        Raises:
            ParameterError: A value is missing, unknown, not finite or out of bounds.
        """
        checked = self._space.check(values)
        spec = self._base.copy()
        # all places are found before any is written, since a number may tell what kind of servo it is part of
        found = [(write.into(spec), checked[one.parameter.name]) for one in self._calibrated for write in one.writes]
        for write, value in found:
            write(value)
        return spec


def _builder_of(place: Path) -> _Builder:
    return load_robot(place).build.__self__  # type: ignore[attr-defined]


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
        sites.append(site)
        names.append(one.text("name", site))
        rest.append(one.numbers("rest", 2, "in m from the first marker") if "rest" in one.content else [np.nan] * 2)
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
        found.append((marker_index(table, "links", pair[0], names), marker_index(table, "links", pair[1], names)))
    return tuple(found)


def _rest(spec: mujoco.MjSpec, sites: tuple[str, ...], table: Table) -> NDArray[np.float64]:
    """Positions of the sites in the pose of the model [m]. Shape (M, 3)."""
    model = compiled(spec, table.where)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.array([data.site(site).xpos for site in sites])
