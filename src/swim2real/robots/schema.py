"""Schema of a robot file: its tables as pydantic models. The keys are explained in docs/robot-file.md.

```
format = 1
name = "finger"
description = "..."                    for a person or a VLM who has never seen it
model = "finger.xml"                   MJCF beside this file, or "python:module:function" that returns an MjSpec
camera = "side"                        above (x right, y up), side (x right, z up) or front (y right, z up)
markers = ["base", "knuckle", "tip"]   sites, in the order in which they are tracked
links = [["base", "knuckle"]]          lines of pictures; by default from each marker to the next

[recordings]                           or [swims], for a motor that turns at a constant speed
start = "fitted"                       rest, markers, fitted or the name of a keyframe; left out: what suits each
frame = ["base", "knuckle"]            compare in the frame of two markers; left out: in the world
score_progress = false                 whether how far it comes is compared, too
[recordings.controls]
tendon = "table"                       held from row to row; or "interpolated table", "frequency", a number, or
                                       {amplitude = 1.0, phase = 0.0, offset = 0.0}
[recordings.sensors]
load = {unit = "N", meters_per_unit = 0.01}    an error of 1 N counts as much as 10 mm
crank = {unit = "deg", meters_per_unit = 1e-4, range = [0, 360]}    begins anew at 360

[policy]                               only to train policies
sites = ["nail"]                       what a policy sees beside the markers
rubbing_tendon = "cable"               that `train --tendon-friction` takes tension from
[policy.actuators]
winch = {lower = 0.0, upper = 0.05, rate = 0.2, unit = "m"}    the command's limits, and its greatest change a second
[policy.observe]
forward = ["velocity", "joint_angles"] parts of the observation; left out: what the task asks for

[[parameters]]
name = "knuckle_damping"
unit = "N·m·s/rad"
lower = 1e-4
upper = 1e-1
scale = "log"                          or linear; log_offset moves the logarithm's zero
meaning = "..."
value = 1e-3                           by default what the model has
targets = ['joint "knuckle" damping']  or {to = ..., factor = 1.0, offset = 0.0, relative = true}
```

A file that says `extends = "OTHER.toml"` takes over what it doesn't say itself, and adds its parameters; with these a
`response` that was measured without them isn't taken over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator

from swim2real.robots.named_code import FORMS, PREFIX, NamedCode
from swimbase.checking import Label
from swimbase.errors import RobotError
from swimbase.parsing import from_toml
from swimbase.store import MOST_TEXT, read_bytes

FORMAT = 1


def _not_blank(text: str) -> str:
    if not text.strip():
        raise ValueError("it is blank; it must be a text")
    return text


def _hook(text: str) -> str:
    if NamedCode.parse(text, Path()) is None:
        raise ValueError(f"it is '{text}'; it must be {FORMS}")
    return text


def _rising(limits: list[float]) -> list[float]:
    if not limits[0] < limits[1]:
        raise ValueError(f"it is {limits}; the first number must be below the second")
    return limits


def _table_of(key: str) -> Callable[[Any], Any]:
    """Makes a table with this key of a text that stands for it alone."""
    return lambda value: {key: value} if isinstance(value, str) else value


def _lines(value: Any) -> Any:
    return [value] if isinstance(value, str | Mapping) else value


def _kind_of_control(value: Any) -> str:
    return "<sine>" if isinstance(value, Mapping) else "<word>" if isinstance(value, str) else "<number>"


Text = Annotated[str, AfterValidator(_not_blank)]
Hook = Annotated[Text, AfterValidator(_hook)]
Pair = Annotated[list[Label], Field(min_length=2, max_length=2)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class MarkerTable(_Table):
    """A marker; the name of its site alone stands for a table with nothing else."""

    site: Label
    name: Label | None = None
    rest: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None


class SineTable(_Table):
    """A control that swings at a trial's frequency."""

    amplitude: float
    phase: float = 0.0
    offset: float = 0.0


ControlEntry = Annotated[
    Annotated[SineTable, Tag("<sine>")]
    | Annotated[Literal["table", "interpolated table", "frequency"], Tag("<word>")]
    | Annotated[float, Tag("<number>")],
    Discriminator(_kind_of_control),
]


class SensorTable(_Table):
    """A sensor that is compared beside the markers."""

    unit: Label = "-"
    meters_per_unit: Annotated[float, Field(gt=0)]
    range: Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_rising)] | None = None


class RecordingsTable(_Table):
    """[recordings]: trials that are played back."""

    controls: dict[Label, ControlEntry] = {}
    sensors: dict[Label, SensorTable] = {}
    start: Label | None = None
    frame: Pair | None = None
    score_progress: bool = False

    @model_validator(mode="after")
    def _progress_needs_a_frame(self) -> RecordingsTable:
        if self.frame is not None and self.frame[0] == self.frame[1]:
            raise ValueError(f"'frame' is {self.frame}; it must be two different markers")
        if self.score_progress and self.frame is None:
            raise ValueError(
                "'score_progress' is true; it needs 'frame', the two markers that say where the robot points"
            )
        return self


class SwimsTable(_Table):
    """[swims]: trials in which a motor turns at a constant speed, or a servo swings."""

    surge_joints: Pair
    motor_joint: Label | None = None
    servo: SineTable | None = None
    tail_markers: Annotated[list[Label], Field(min_length=1)]
    slow_mode: bool = False
    from_afar: bool = False
    head_first: list[Annotated[float, Field(gt=0, le=50)]] = Field(default_factory=list)
    response: Hook | None = None
    fit_plan: Hook | None = None

    @model_validator(mode="after")
    def _motor_or_servo(self) -> SwimsTable:
        if (self.motor_joint is None) == (self.servo is None):
            given = "neither" if self.servo is None else "both"
            raise ValueError(
                f"there must be 'motor_joint', which turns at a constant speed, or 'servo', the sine that a tail "
                f"follows; the file has {given}"
            )
        return self


class CommandTable(_Table):
    """Commands of a policy to an actuator."""

    lower: float
    upper: float
    rate: Annotated[float, Field(gt=0)]
    unit: Label

    @model_validator(mode="after")
    def _limits_in_order(self) -> CommandTable:
        if not self.lower < self.upper:
            raise ValueError(
                f"'lower' is {self.lower:g} and 'upper' {self.upper:g}; the first must be below the second"
            )
        if not self.lower <= 0 <= self.upper:
            raise ValueError(f"the limits are {self.lower:g} to {self.upper:g}; 0, the command at rest, must be within")
        return self


class PolicyTable(_Table):
    """[policy]: what a policy commands and sees."""

    actuators: Annotated[dict[Label, CommandTable], Field(min_length=1)]
    sites: list[Label] = []
    observe: dict[Label, list[Label]] = {}
    rubbing_tendon: Label | None = None


class TargetTable(_Table):
    """A place that a parameter sets; the line alone stands for a table with nothing else."""

    to: Text
    factor: float = 1.0
    offset: float = 0.0
    relative: bool = False

    @model_validator(mode="after")
    def _factor_counts(self) -> TargetTable:
        if self.factor == 0:
            raise ValueError("'factor' is 0; it must not be, or the parameter changes nothing")
        return self


class ParameterTable(_Table):
    """[[parameters]]: what is calibrated."""

    name: Label
    unit: Label = "-"
    lower: float
    upper: float
    scale: Literal["log", "linear"] = "linear"
    log_offset: float = 0.0
    meaning: Text
    value: float | None = None
    targets: Annotated[
        list[Annotated[TargetTable, BeforeValidator(_table_of("to"))]], Field(min_length=1), BeforeValidator(_lines)
    ]


class RobotTable(_Table):
    """The whole file, with what it takes over from others. Each of the parameters is a `ParameterTable`."""

    format: int
    name: Label
    description: Text
    model: Text
    camera: Literal["above", "side", "front"] = "above"
    markers: list[Annotated[MarkerTable, BeforeValidator(_table_of("site"))]] = []
    links: list[Pair] | None = None
    recordings: RecordingsTable | None = None
    swims: SwimsTable | None = None
    policy: PolicyTable | None = None
    parameters: Annotated[list[dict[str, object]], Field(min_length=1)]

    @model_validator(mode="after")
    def _one_kind_of_trials(self) -> RobotTable:
        if (self.recordings is None) == (self.swims is None):
            given = "neither" if self.recordings is None else "both"
            raise ValueError(
                f"there must be [recordings], for trials that are played back, or [swims], for a motor or servo "
                f"that beats at one frequency; the file has {given}"
            )
        return self

    @model_validator(mode="after")
    def _something_to_compare(self) -> RobotTable:
        if not self.markers and not (self.recordings is not None and self.recordings.sensors):
            raise ValueError(
                "there are neither 'markers' nor [recordings.sensors]; name the sites that carry markers, or the "
                "sensors that were recorded"
            )
        return self


def read_content(path: Path, extended_by: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Reads a robot file and those that it includes, with their places as seen from this file; not yet checked.

    Raises:
        RobotError: It or one of them can't be read, they go round in circles, or the format is another version's.
    """
    where = f"robot file '{path}'"
    content = _read_toml(path)
    extended = content.pop("extends", None)
    if extended is not None:
        other = path.parent / str(extended)
        if other.resolve() in (path.resolve(), *extended_by):
            raise RobotError(f"{where}: 'extends' is '{extended}'; it must not lead back to the file itself")
        base = _moved(read_content(other, (path.resolve(), *extended_by)), Path(str(extended)).parent)
        merged = {**base, **content}
        for key in ("swims", "recordings"):
            if isinstance(base.get(key), dict) and isinstance(content.get(key), dict):
                merged[key] = {**base[key], **content[key]}
        lists = base.get("parameters", []), content.get("parameters", [])
        if lists[1] and "response" not in content.get("swims", {}) and isinstance(merged.get("swims"), dict):
            merged["swims"] = {key: value for key, value in merged["swims"].items() if key != "response"}
        if all(isinstance(parameters, list) for parameters in lists):
            merged["parameters"] = _joined(*lists)
        content = merged
    if content.get("format") != FORMAT:
        raise RobotError(f"{where}: 'format' is {content.get('format')}; it must be {FORMAT} for this version")
    return content


def _joined(extended: Sequence[Any], own: Sequence[Any]) -> list[Any]:
    """Parameters of an extended file, in which those of the same name change key by key, and further ones."""
    further = list(own)

    def changed(entry: Any) -> Any:
        for k, one in enumerate(further):
            if isinstance(one, dict) and isinstance(entry, dict) and one.get("name") == entry.get("name"):
                return {**entry, **further.pop(k)}
        return entry

    return [*map(changed, extended), *further]


def hook_file(text: object) -> str | None:
    """The file that a function named `python:FILE.py:NAME` is in; None for one of a module, or for anything else."""
    code = NamedCode.parse(text, Path()) if isinstance(text, str) else None
    return None if code is None else code.file


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return from_toml(read_bytes(path, MOST_TEXT))
    except FileNotFoundError:
        raise RobotError(f"robot file '{path}' is not there; `swim2real init MODEL.xml` writes one") from None
    except (OSError, ValueError) as error:
        raise RobotError(f"robot file '{path}' can't be read as TOML: {error}") from error


def _moved(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Content of a file, with the places that it names seen from another folder."""

    def moved(value: Any) -> Any:
        file = hook_file(value)
        return value if file is None else f"python:{(folder / file).as_posix()}:{value.rpartition(':')[2]}"

    there = dict(content)
    model = there.get("model")
    if isinstance(model, str):
        there["model"] = moved(model) if model.startswith(PREFIX) else (folder / model).as_posix()
    if isinstance(there.get("swims"), dict):
        there["swims"] = {key: moved(value) for key, value in there["swims"].items()}
    return there
