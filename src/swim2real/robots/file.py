"""Robot files: a TOML file beside an MJCF model says what is calibrated, which sites are markers and what a trial is.

The tables and keys of the file are those of `schema.py`; here they are held against the model.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from swim2real import consent
from swim2real.parameters import Parameter, ParameterSpace, Values
from swim2real.robots import schema
from swim2real.robots.alone import compile_alone, within
from swim2real.robots.compiled import REFUSALS, compiled, one_line, sensor_units
from swim2real.robots.drives import INTERPOLATED, SPEED, TABLE, Drive
from swim2real.robots.mjcf_files import outside
from swim2real.robots.named_code import FORMS, PREFIX, NamedCode, request
from swim2real.robots.robot import CommandLimits, PolicySetup, Robot, Sensor, SteadySwims, Trials
from swim2real.robots.targets import Delay, Target
from swim2real.trials import units
from swimbase.checking import check
from swimbase.errors import ArgumentError, ParameterError, RobotError

PLANES = {"above": (0, 1), "side": (0, 2), "front": (1, 2)}
MARKER = "marker:"  # before the name of a marker's sensor, where the model may have others


@dataclass(frozen=True)
class CalibratedParameter:
    """A parameter of a robot file and what it sets.

    Attributes:
        parameter: Its published value is the model's own, or what the file says.
        targets: Places in the model that it sets.
        delays: What it delays; of the two there is one at least.
    """

    parameter: Parameter
    targets: tuple[Target, ...]
    delays: tuple[Delay, ...] = ()


@dataclass(frozen=True)
class RobotFile:
    """A robot file and the model that it is about.

    Attributes:
        path: Path of the file.
        where: What a message about the file begins with.
        table: All that it says, with what it takes over from others.
        spec: The model before any parameter is written to it.
        calibrated: The parameters and what they set.
    """

    path: Path
    where: str
    table: schema.RobotTable
    spec: mujoco.MjSpec
    calibrated: tuple[CalibratedParameter, ...]


def robot_from_file(
    path: str | Path, *, markers_only: bool = False, allow_code: bool = False, allow_outside: bool = False
) -> Robot:
    """The robot that a file describes.

    Args:
        path: Path of the file.
        markers_only: As `open_robot_file` has it. The robot can be tracked; it isn't one to calibrate.
        allow_code: Run the Python code that the file names, and remember that.
        allow_outside: Read the files outside of the model's folder that it names, and remember that.

    Raises:
        RobotError: The file can't be read, or doesn't fit its model; names the place and what exists.
        ConsentError: Something of this wasn't allowed.
    """
    file = open_robot_file(path, markers_only=markers_only, allow_code=allow_code, allow_outside=allow_outside)
    try:
        return _robot(file, markers_only)
    except RobotError:
        if not markers_only or not file.calibrated:
            raise
        # with a parameter's value the model doesn't compile; the spec has been changed by then
        return _robot(replace(open_robot_file(path, markers_only=True), calibrated=()), markers_only)


def _robot(file: RobotFile, markers_only: bool) -> Robot:
    table = file.table
    markers = _markers(file)
    names = tuple(markers)
    links = None if table.links is None else tuple(_pair(file, "links", pair, names) for pair in table.links)
    trials = _trials(file, names)
    space = ParameterSpace(tuple(entry.parameter for entry in file.calibrated))
    builder = _Builder(file, space, markers, "" if table.recordings is None else MARKER, markers_only)
    plane = PLANES[table.camera]
    model = compiled(builder.build(space.published), file.where)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    positions = np.array([data.site(site).xpos for site in markers.values()]).reshape(-1, 3)
    given_rest = np.array([marker.rest or [np.nan, np.nan] for marker in table.markers]).reshape(-1, 2)
    rest = positions[:, plane] - positions[:1, plane]
    rest = np.where(np.isfinite(given_rest), given_rest, rest)
    right, up = np.eye(3)[list(plane)]
    heights = positions @ np.cross(right, up)  # toward the camera
    rest.flags.writeable = heights.flags.writeable = False
    return Robot(
        name=table.name,
        description=" ".join(table.description.split()),
        space=space,
        build=builder.build,
        marker_names=names,
        rest_markers=rest,
        marker_heights=heights,
        trials=trials,
        plane=plane,
        links=tuple((i, i + 1) for i in range(len(names) - 1)) if links is None else links,
        policy=_policy(file),
        delays={entry.parameter.name: entry.delays for entry in file.calibrated if entry.delays},
        source=file.path,
        targets={entry.parameter.name: entry.targets for entry in file.calibrated},
    )


def open_robot_file(
    path: str | Path, *, markers_only: bool = False, allow_code: bool = False, allow_outside: bool = False,
    alone: bool = False,
) -> RobotFile:  # fmt: skip
    """Reads a robot file, its model and its parameters.

    Args:
        path: Path of the file.
        markers_only: Read what tracking takes: the model, its markers and what a trial is. Hooks and [policy] are
            passed over, and so is a parameter that doesn't fit the model, whose numbers then stay the model's own.
        allow_code: Run the Python code that the file names, and remember that.
        allow_outside: Read the files outside of the model's folder that it names, and remember that.
        alone: As `read_mjcf` has it.

    Raises:
        RobotError: One can't be read, or a parameter doesn't fit the model.
        ConsentError: Something of this wasn't allowed.
    """
    place = Path(path)
    content = schema.read_content(place)
    where = f"robot file '{place}'"
    table = check(schema.RobotTable, _for_markers(content) if markers_only else content, where, RobotError)
    code = _request(content, table, place.parent, where)
    if code is not None:
        consent.require(code, allowed=allow_code)
    spec = _base(table, place.parent, where, allow_outside, alone)
    signals = None
    if table.recordings is not None:
        signals = {"control": list(table.recordings.controls), "sensor": list(table.recordings.sensors)}
    calibrated: dict[str, CalibratedParameter] = {}
    for i, entry in enumerate(table.parameters):
        try:
            parameter = _calibrated(entry, i, spec, signals, where)
            name = parameter.parameter.name
            if name in calibrated:
                raise RobotError(f"{where}: two parameters are named '{name}'; give each its own name")
        except RobotError:
            if not markers_only:
                raise
            continue
        calibrated[name] = parameter
    return RobotFile(place, where, table, spec, tuple(calibrated.values()))


def _for_markers(content: Mapping[str, Any]) -> dict[str, object]:
    """Content of a file without what only calibrations and policies take."""
    kept = {key: value for key, value in content.items() if key != "policy"}
    if isinstance(kept.get("swims"), Mapping):
        kept["swims"] = {key: value for key, value in kept["swims"].items() if key not in ("response", "fit_plan")}
    parameters = kept.get("parameters")
    listed = [entry for entry in parameters if isinstance(entry, Mapping)] if isinstance(parameters, list) else []
    kept["parameters"] = listed or [{}]  # none that fits is enough
    return kept


def read_mjcf(path: Path, where: str = "", *, allow_outside: bool = False, alone: bool = False) -> mujoco.MjSpec:
    """The model of an MJCF file. An actuator without a name gets that of what it acts on.

    Args:
        path: Path of the file.
        where: What a message begins with.
        allow_outside: Read the files outside of its folder that it names, and remember that.
        alone: Compile it first in a process of its own, whose time and memory are limited.

    Raises:
        RobotError: MuJoCo can't read it.
        ConsentError: It names files outside of its folder, which wasn't allowed.
    """
    asked = outside(path, where)
    if asked is not None:
        consent.require(asked, allowed=allow_outside)
    place = path.resolve()  # its meshes are found from any working directory
    if alone:
        compile_alone(path, where, confined=asked is None)

    def parsed() -> mujoco.MjSpec:
        spec = mujoco.MjSpec.from_file(str(place))
        if asked is None:
            _check_named(place, where)
            spec.copy().compile()  # which opens its meshes and pictures
        return spec

    try:
        spec = within(place.parent, parsed) if asked is None else parsed()
    except REFUSALS as error:
        raise RobotError(f"{where}MuJoCo can't read model '{path}': {one_line(error)}") from error
    taken = {actuator.name for actuator in spec.actuators}
    for i, actuator in enumerate(spec.actuators):
        if not actuator.name:
            named = actuator.target or "actuator"
            actuator.name = named if named not in taken else f"{named}_{i}"
            taken.add(actuator.name)
    return spec


def _check_named(path: Path, where: str) -> None:
    """Refuses a model in which MuJoCo's own parser finds files outside of its folder, in whatever form they are named.

    Raises:
        RobotError: There is one.
    """
    for file in mujoco.mju_getXMLDependencies(str(path)):
        real = Path(os.path.realpath(path.parent / file))
        if real.exists() and not real.is_relative_to(path.parent):
            raise RobotError(
                f"{where}model '{path}' reads '{real}' outside of its folder, in a form that can't be allowed; move it "
                f"into the folder, and name it in a plain element"
            )


class _Builder:
    """Makes specs for parameter values."""

    def __init__(
        self, file: RobotFile, space: ParameterSpace, markers: Mapping[str, str], prefix: str, markers_only: bool
    ) -> None:
        base = file.spec
        self._base, self._space, self._calibrated = base, space, file.calibrated
        self._path, self._markers_only = file.path.resolve(), markers_only
        if not prefix:  # only the markers' own
            for sensor in list(base.sensors):
                base.delete(sensor)
        for name, site in markers.items():
            base.add_sensor(
                name=f"{prefix}{name}", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=site,
            )  # fmt: skip

    def __reduce__(self) -> tuple[Any, ...]:
        """A spec can't go to another process; the file is read again there."""
        return _builder_of, (self._path, self._markers_only, consent.marks())

    def build(self, values: Values) -> mujoco.MjSpec:
        """A spec ready to compile.

        Raises:
            ParameterError: A value is missing, unknown, not finite or out of bounds.
        """
        checked = self._space.check(values)
        spec = self._base.copy()
        # all places are found before any is written, since a number may tell what kind of servo it is part of
        setters = [
            (target.setter(spec), checked[entry.parameter.name])
            for entry in self._calibrated for target in entry.targets
        ]  # fmt: skip
        for setter, value in setters:
            setter(value)
        return spec


def _builder_of(path: Path, markers_only: bool, allowed: tuple[str, ...]) -> _Builder:
    consent.trust(allowed)
    return robot_from_file(path, markers_only=markers_only).build.__self__  # type: ignore[attr-defined]


def _base(table: schema.RobotTable, folder: Path, where: str, allow_outside: bool, alone: bool) -> mujoco.MjSpec:
    """The model before anything is written to it."""
    if table.model.startswith(PREFIX):
        spec = _call(table.model, folder, f"{where}: 'model'")
        if not isinstance(spec, mujoco.MjSpec):
            raise RobotError(
                f"{where}: 'model' is '{table.model}'; it must return an MjSpec, not {type(spec).__name__}"
            )
        return spec.copy()  # it may be used again
    path = folder / table.model
    if not path.is_file():
        raise RobotError(f"{where}: model '{path}' is not there; give the MJCF file's path from the robot file")
    return read_mjcf(path, f"{where}: ", allow_outside=allow_outside, alone=alone)


def _call(hook: str, folder: Path, where: str) -> Any:
    """Calls a function that a robot file names. Permission to run it has been asked by then."""
    code = NamedCode.parse(hook, folder)
    if code is None:
        raise RobotError(f"{where} is '{hook}'; it must be {FORMS}")
    try:
        function = code.load()
    except Exception as error:  # whatever the user's code does
        raise RobotError(f"{where} '{hook}' can't be imported: {type(error).__name__}: {error}") from error
    if not callable(function):
        raise RobotError(f"{where} is '{hook}'; it must name a function")
    try:
        return function()
    except Exception as error:
        raise RobotError(f"{where} '{hook}' failed: {type(error).__name__}: {error}") from error


def _request(content: Mapping[str, Any], table: schema.RobotTable, folder: Path, where: str) -> consent.Request | None:
    """Request to run the Python code that a file names. It is remembered by all that the file says, and by the code."""
    swims = table.swims
    hooks = [table.model, *(() if swims is None else (swims.response, swims.fit_plan))]
    codes = [code for hook in hooks if hook and (code := NamedCode.parse(hook, folder)) is not None]
    return request(where, json.dumps(content, sort_keys=True, default=str).encode(), codes)


def _known(where: str, key: str, name: str, what: str, known: Sequence[str]) -> None:
    """Refuses a name that isn't among the known ones."""
    if name not in known:
        raise RobotError(f"{where}: '{key}' is '{name}'; it must be {what}: {', '.join(known) or 'there are none'}")


def _index(where: str, key: str, name: str, names: tuple[str, ...]) -> int:
    _known(where, key, name, "a marker", names)
    return names.index(name)


def _pair(file: RobotFile, key: str, pair: Sequence[str], names: tuple[str, ...]) -> tuple[int, int]:
    first, second = (_index(file.where, key, name, names) for name in pair)
    return first, second


def _markers(file: RobotFile) -> dict[str, str]:
    """The site of each marker, by the marker's name."""
    sites = [site.name for site in file.spec.sites if site.name]
    markers: dict[str, str] = {}
    for marker in file.table.markers:
        _known(file.where, "markers", marker.site, "a site of the model", sites)
        name = marker.name or marker.site
        if name in markers:
            raise RobotError(f"{file.where}: 'markers' has '{name}' twice; name each marker once")
        markers[name] = marker.site
    return markers


def _trials(file: RobotFile, markers: tuple[str, ...]) -> Trials:
    if file.table.swims is not None:
        return _swims(file, file.table.swims, markers)
    assert file.table.recordings is not None  # the schema has checked that there is one of the two
    return _recordings(file, file.table.recordings, markers)


def _swims(file: RobotFile, table: schema.SwimsTable, markers: tuple[str, ...]) -> Trials:
    spec, where, folder = file.spec, f"{file.where}, [swims]", file.path.parent
    joints = [joint.name for joint in spec.joints]
    motor = () if table.motor_joint is None else (("motor_joint", table.motor_joint),)
    for key, name in (*(("surge_joints", name) for name in table.surge_joints), *motor):
        _known(where, key, name, "a joint of the model", joints)
    if len(spec.actuators) != 1:
        raise RobotError(
            f"{where}: the model has {len(spec.actuators)} actuators; steady swims need one, which turns "
            f"motor_joint at the speed that it is given [rad/s], or swings with a servo; use [recordings] for other "
            f"robots"
        )
    if len(markers) < 2:
        raise RobotError(f"{where}: there is one marker; steady swims need two, the first two on the head")
    return SteadySwims(
        controls={spec.actuators[0].name: SPEED if table.servo is None else _drive(table.servo)},
        frame=(0, 1),
        score_progress=True,
        surge_joints=(table.surge_joints[0], table.surge_joints[1]),
        tail_markers=tuple(_index(where, "tail_markers", name, markers) for name in table.tail_markers),
        motor_joint=table.motor_joint,
        slow_mode=table.slow_mode,
        from_afar=table.from_afar,
        head_first=tuple(table.head_first),
        response=None if table.response is None else _call(table.response, folder, f"{where}: 'response'"),
        fit_plan=None if table.fit_plan is None else _call(table.fit_plan, folder, f"{where}: 'fit_plan'"),
    )


def _recordings(file: RobotFile, table: schema.RecordingsTable, markers: tuple[str, ...]) -> Trials:
    spec, where = file.spec, f"{file.where}, [recordings]"
    actuators = [actuator.name for actuator in spec.actuators]
    for name in table.controls:
        _known(where, "controls", name, "an actuator of the model", actuators)
    start = table.start or "rest"
    _known(where, "start", start, "one of", ["rest", "markers", "fitted", *(key.name for key in spec.keys)])
    return Trials(
        {name: _drive(entry) for name, entry in table.controls.items()},
        _sensors(file, table),
        start,
        None if table.frame is None else _pair(file, "frame", table.frame, markers),
        table.score_progress,
        start_named=table.start is not None,
    )


def _policy(file: RobotFile) -> PolicySetup | None:
    table, spec, where = file.table.policy, file.spec, f"{file.where}, [policy]"
    if table is None:
        return None
    actuators, sites = [actuator.name for actuator in spec.actuators], [site.name for site in spec.sites if site.name]
    for name in table.actuators:
        _known(where, "actuators", name, "an actuator of the model", actuators)
    for name in table.sites:
        _known(where, "sites", name, "a site of the model", sites)
    if table.rubbing_tendon is not None:
        tendons = [tendon.name for tendon in spec.tendons]
        _known(where, "rubbing_tendon", table.rubbing_tendon, "a tendon of the model", tendons)
    return PolicySetup(
        {name: CommandLimits(**entry.model_dump()) for name, entry in table.actuators.items()},
        tuple(table.sites), {task: tuple(parts) for task, parts in table.observe.items()}, table.rubbing_tendon,
    )  # fmt: skip


def _drive(entry: schema.ControlEntry) -> Drive:
    if isinstance(entry, schema.SineTable):
        return Drive(entry.amplitude, entry.phase, entry.offset)
    words = {"table": TABLE, "interpolated table": INTERPOLATED, "frequency": SPEED}
    return words[entry] if isinstance(entry, str) else Drive(offset=entry)


def _sensors(file: RobotFile, table: schema.RecordingsTable) -> tuple[Sensor, ...]:
    if not table.sensors:
        return ()
    model = compiled(file.spec.copy(), file.where)
    sizes = {model.sensor(i).name: int(model.sensor_dim[i]) for i in range(model.nsensor) if model.sensor(i).name}
    own, where = sensor_units(model), f"{file.where}, [recordings.sensors]"
    return tuple(
        _sensor(where, name, own[_check_sensor(where, name, sizes)], entry) for name, entry in table.sensors.items()
    )


def _sensor(where: str, name: str, own: str, entry: schema.SensorTable) -> Sensor:
    """A sensor whose own unit, that of the model, is known or `-`."""
    unit, wraps, turn, factor = entry.unit, entry.range is not None, None, 1.0
    if "-" not in (own, unit):
        try:
            factor = units.factor(own, unit)
        except ArgumentError as error:
            alike = [one for one, (kind, _) in units.UNITS.items() if kind == units.kind_of(own)]
            raise RobotError(
                f"{where}: 'unit' of sensor '{name}' is '{unit}', and what the model's sensor measures is in {own}; "
                f"allowed are {', '.join(alike) or own}, or '-' for the model's own"
            ) from error
    if own == "rad":
        turn = 2 * math.pi * factor
    if entry.range is not None:
        turn = entry.range[1] - entry.range[0]
    return Sensor(name, unit, entry.meters_per_unit, factor, turn, wraps)


def _check_sensor(where: str, name: str, sizes: Mapping[str, int]) -> str:
    """Checks a name, `NAME` or `"NAME[I]"` for one number of a vector; gives that of the sensor."""
    matched = re.fullmatch(r"(.*)\[(\d+)\]", name)
    stem, index = (name, None) if name in sizes or matched is None else (matched[1], int(matched[2]))
    if stem not in sizes:
        raise RobotError(f"{where}: the model has no sensor '{stem}'; there are {', '.join(sizes) or 'none'}")
    size = sizes[stem]
    if index is None and size > 1:
        raise RobotError(
            f'{where}: sensor \'{stem}\' has {size} values; say which one: "{stem}[0]" to "{stem}[{size - 1}]"'
        )
    if index is not None and index >= size:
        raise RobotError(f"{where}: sensor '{stem}' has {size} values, from [0]; there is no [{index}]")
    return stem


def _calibrated(
    entry: Mapping[str, Any], number: int, spec: mujoco.MjSpec, signals: Mapping[str, Sequence[str]] | None, where: str
) -> CalibratedParameter:
    label = f"{where}, parameter {entry.get('name', number + 1)!r}"
    table = check(schema.ParameterTable, entry, label, RobotError)
    try:
        delays = tuple(_delays(table, signals))
        lines = {delay.line for delay in delays}
        targets = tuple(
            Target(to.to, to.factor, to.offset, to.relative) for to in table.targets if to.to.strip() not in lines
        )
        for target in targets:
            for bound in (table.lower, table.upper):
                target.check_bound(spec, bound)
        value = _current(targets, delays, spec) if table.value is None else table.value
        parameter = Parameter(
            table.name, table.unit, table.lower, table.upper, " ".join(table.meaning.split()), value,
            table.log_offset if table.scale == "log" else None,
        )  # fmt: skip
        _check_value(parameter, own=table.value is None)
    except (RobotError, ParameterError) as error:
        raise RobotError(f"{label}: {error}") from error
    return CalibratedParameter(parameter, targets, delays)


def _delays(table: schema.ParameterTable, signals: Mapping[str, Sequence[str]] | None) -> Iterator[Delay]:
    """Delays that a parameter sets of recordings, whose controls and sensors are given by kind; None for swims."""
    for to in table.targets:
        delay = Delay.parse(to.to, to.factor, to.offset)
        if delay is None:
            continue
        if signals is None:
            raise RobotError(f"'{delay.line}': delays are of recordings, and the trials of this robot are steady swims")
        if to.relative:
            raise RobotError(f"'{delay.line}': a delay is in seconds, so it can't be relative")
        delay.check(signals)
        yield delay


def _check_value(parameter: Parameter, own: bool) -> None:
    try:
        parameter.check(parameter.published)
    except ParameterError as error:
        remedy = "widen the bounds, change it in the model, or say value = …"
        raise RobotError(f"{error}; this is the model's own value, so {remedy}" if own else str(error)) from error


def _current(targets: tuple[Target, ...], delays: tuple[Delay, ...], spec: mujoco.MjSpec) -> float:
    """The value at which the model stays as it is, and nothing is delayed."""
    values = [number for target in targets for number in target.current(spec)]
    values += [-delay.offset / delay.factor + 0.0 for delay in delays]
    if not np.isfinite(values).all():
        raise RobotError("the model sets no number there, so the parameter needs value = …")
    if not np.allclose(values, values[0], rtol=1e-9, atol=0.0):
        listed = ", ".join(f"{value:g}" for value in sorted(set(values)))
        raise RobotError(f"the model has several numbers there ({listed}), so the parameter needs value = …")
    return values[0]
