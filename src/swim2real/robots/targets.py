"""Targets of parameters: numbers of MJCF elements, named in a line such as `geom "fin" fluidcoef[2]`, and delays.

    option density                  of the model as a whole
    joint "hip" damping             of one element
    joint "tail*" stiffness         of all whose names match
    joint "hip", "knee" damping     of those named
    geom class "wet" fluidcoef[0]   of all elements of a default class, whatever they set themselves
    body "fin" pos[2]               one of several numbers

Names, units and order are those of the MJCF file; an angle is in degrees where its compiler says so. `mass`,
`diaginertia` and `ipos` of a body are those of its <inertial>; `kp` and `kv` are those of position and velocity servos.
An MjSpec has other names for some attributes (`fluid_coefs` for `fluidcoef`), and spreads the gains of servos over
parameters of their laws.

Of recordings a parameter may be a delay. Names may be patterns; delays of the same thing add up, and one below 0 is an
advance:

    control "winch" delay           the actuator follows its commands later by so many seconds
    sensor "pull" delay             the readings show what was so many seconds ago
    trial "steps" delay             the trial's tables are on a clock that is behind: what they date happens later
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache, cached_property
from typing import Any, Literal

import mujoco
import numpy as np

from swimbase.checking import did_you_mean
from swimbase.errors import RobotError

KINDS = {
    "body": "bodies", "joint": "joints", "geom": "geoms", "site": "sites", "tendon": "tendons",
    "actuator": "actuators", "equality": "equalities", "mesh": "meshes",
}  # fmt: skip
_LINE = re.compile(
    r'\s*(?P<kind>\w+)\s*(?:(?P<by>class\s+)?(?P<names>"[^"]*"(?:\s*,\s*"[^"]*")*))?'
    r"\s+(?P<attribute>\w+)\s*(?:\[\s*(?P<index>\d+)\s*\])?\s*"
)
_OTHER_NAMES = {
    "diaginertia": "inertia", "fluidcoef": "fluid_coefs", "polycoef": "data", "user": "userdata",
}  # fmt: skip
_POLYNOMIALS = ("damping", "stiffness")  # since MuJoCo 3.7; the first coefficient is the number of the MJCF file
NOT_NEGATIVE = frozenset({
    "armature", "damping", "density", "diaginertia", "fluidcoef", "friction", "frictionloss", "kp", "kv", "mass",
    "size", "stiffness", "timestep", "viscosity",
})  # fmt: skip
"""Attributes in which a number below 0 has no physical sense."""


@dataclass(frozen=True)
class _Attribute:
    """Numbers of an element that can be read and written.

    Attributes:
        size: How many numbers there are; None for a single one, which needs no index.
        read: Gives the number at an index; NaN where the model sets none.
        write: Puts a number at an index.
    """

    size: int | None
    read: Callable[[int], float]
    write: Callable[[int, float], None]


@dataclass(frozen=True)
class Selection:
    """A line, parsed: which elements of a model, and which number of each.

    Attributes:
        kind: Kind of element, or `option`.
        names: Names or patterns of elements; names of default classes with `by_class`; empty for `option`.
        by_class: Whether the names are those of default classes.
        attribute: Name of the attribute in MJCF.
        index: Which of several numbers; None where the line gives none.
    """

    kind: str
    names: tuple[str, ...]
    by_class: bool
    attribute: str
    index: int | None

    @classmethod
    def parse(cls, line: str) -> Selection:
        """Reads a line.

        Raises:
            RobotError: The line can't be read; the message shows how to write it.
        """
        matched = _LINE.fullmatch(line)
        if matched is None:
            raise RobotError(
                f"'{line}' can't be read as a place in the model; write it as in: joint \"hip\" damping, "
                f'geom "fin" fluidcoef[2], geom class "wet" fluidcoef[0], option density'
            )
        kind, names, index = matched["kind"], matched["names"], matched["index"]
        if kind != "option" and kind not in KINDS:
            raise RobotError(f"there is no kind of element '{kind}'{_known(kind, ('option', *KINDS))}")
        if (kind == "option") != (names is None):
            need = "takes no name" if kind == "option" else 'needs a name, such as "hip"'
            raise RobotError(f"'{line}': {kind} {need}")
        listed = tuple(re.findall(r'"([^"]*)"', names or ""))
        return cls(kind, listed, bool(matched["by"]), str(matched["attribute"]), None if index is None else int(index))

    def elements(self, spec: mujoco.MjSpec) -> list[tuple[int, Any]]:
        """The elements of a model, each once, with their numbers among their kind.

        Raises:
            RobotError: The model has no such element; the message names those that exist.
        """
        if self.kind == "option":
            return [(0, spec.option)]
        every = list(enumerate(getattr(spec, KINDS[self.kind])))
        selected: dict[int, Any] = {}
        for name in self.names:
            if self.by_class:
                matching = [(i, element) for i, element in every if class_name(element) == name]
            else:
                matching = [(i, element) for i, element in every if element.name and _matches(element.name, name)]
            if not matching:
                raise RobotError(self._no_element(name, [element for _, element in every]))
            selected |= dict(matching)
        return list(selected.items())

    def numbers(self, spec: mujoco.MjSpec) -> list[tuple[_Attribute, int]]:
        """The numbers of a model that are selected, each with its index.

        Raises:
            RobotError: The model has no such element or number; the message names those that exist.
        """
        return [self._number(element) for _, element in self.elements(spec)]

    def label(self, element: Any) -> str:
        """An element as a message names it."""
        return "option" if self.kind == "option" else f"{self.kind} '{element.name}'"

    def _number(self, element: Any) -> tuple[_Attribute, int]:
        who, name, index = self.label(element), self.attribute, self.index
        numbers = attribute(element, name)
        if numbers is None:
            raise RobotError(f"{who} has no number '{name}'{_known(name, attribute_names(element))}")
        size = numbers.size
        if size is None and index:
            raise RobotError(f"{who} has one {name}; leave out [{index}]")
        if size is not None and index is None:
            raise RobotError(f"{name} of {who} has {size} values; say which one: {name}[0] to {name}[{size - 1}]")
        if size is not None and index is not None and index >= size:
            raise RobotError(f"{name} of {who} has {size} values, from [0]; there is no [{index}]")
        return numbers, index or 0

    def _no_element(self, name: str, every: Sequence[Any]) -> str:
        if self.by_class:
            classes = tuple(sorted({class_name(element) for element in every}))
            return f"the model has no {self.kind} of class '{name}'{_known(name, classes)}"
        known = tuple(element.name for element in every if element.name)
        count = len(every) - len(known)
        unnamed = f" ({count} of kind {self.kind} have no name; give them one in the MJCF file)" if count else ""
        return f"the model has no {self.kind} '{name}'{_known(name, known)}{unnamed}"


@dataclass(frozen=True)
class Target:
    """One place that a parameter sets.

    Attributes:
        line: The line of the robot file; it is parsed once.
        factor: Number by which the value is multiplied.
        offset: Number that is added then.
        relative: Whether the result multiplies the number that the model has, instead of replacing it.
    """

    line: str
    factor: float = 1.0
    offset: float = 0.0
    relative: bool = False

    def __str__(self) -> str:
        """Assignment in words, x being the value."""
        times = "x" if self.factor == 1 else f"{self.factor:g} x"
        number = times + (f" {self.offset:+g}".replace("+", "+ ").replace("-", "- ") if self.offset else "")
        if self.relative:
            return f"{self.line} *= {number}"
        return self.line if number == "x" else f"{self.line} = {number}"

    @cached_property
    def selection(self) -> Selection:
        """The line, parsed.

        Raises:
            RobotError: It can't be read.
        """
        return Selection.parse(self.line)

    def setter(self, spec: mujoco.MjSpec) -> Callable[[float], None]:
        """A function that sets the numbers of a model for a value of the parameter.

        Raises:
            RobotError: The model has no such place.
        """
        places = self.selection.numbers(spec)

        def write(value: float) -> None:
            number = self.factor * value + self.offset
            for numbers, index in places:
                numbers.write(index, number * numbers.read(index) if self.relative else number)

        return write

    def current(self, spec: mujoco.MjSpec) -> list[float]:
        """The values at which each place of the model stays as it is; NaN where it sets no number. Not empty."""
        places = self.selection.numbers(spec)
        present = [1.0] if self.relative else [numbers.read(index) for numbers, index in places]
        return [(number - self.offset) / self.factor for number in present]

    def check_bound(self, spec: mujoco.MjSpec, value: float) -> None:
        """Refuses a value that sets a number below 0 where the attribute has no sense there.

        Raises:
            RobotError: It has none.
        """
        self.selection.elements(spec)
        number = self.factor * value + self.offset
        if number < 0 and (self.relative or self.selection.attribute in NOT_NEGATIVE):
            what = f"{number:g} times its own" if self.relative else f"{number:g}"
            raise RobotError(
                f"{value:g} would write {what} to {self.line}, which can't be negative; change the bound, or the "
                f"factor and offset"
            )


_Kind = Literal["control", "sensor", "trial"]
_DELAY = re.compile(r'\s*(?P<kind>control|sensor|trial)\s+(?P<names>"[^"]*"(?:\s*,\s*"[^"]*")*)\s+(?P<what>\S+)\s*')


@dataclass(frozen=True)
class Delay:
    """Delays that a parameter sets.

    Attributes:
        line: The line of the robot file.
        kind: What is delayed.
        names: Names or patterns of those that are.
        factor: Number by which the parameter's value is multiplied.
        offset: Delay that is added then [s].
    """

    line: str
    kind: _Kind
    names: tuple[str, ...]
    factor: float = 1.0
    offset: float = 0.0

    def __str__(self) -> str:
        """The line, and what is set where it isn't the value itself, x being the value."""
        if self.factor == 1 and not self.offset:
            return self.line
        return f"{self.line} = {self.factor:g} x" + (f" {self.offset:+g}" if self.offset else "")

    @classmethod
    def parse(cls, line: str, factor: float = 1.0, offset: float = 0.0) -> Delay | None:
        """Reads a line; None for one of another kind.

        Raises:
            RobotError: It is about a control, a sensor or a trial, but not about its delay.
        """
        matched = _DELAY.fullmatch(line)
        if matched is None:
            return None
        if matched["what"] != "delay":
            raise RobotError(f"'{line}': a {matched['kind']} has a delay and nothing else that could be calibrated")
        kind: _Kind = (
            "control" if matched["kind"] == "control" else "sensor" if matched["kind"] == "sensor" else "trial"
        )
        return cls(line.strip(), kind, tuple(re.findall(r'"([^"]*)"', matched["names"])), factor, offset)

    def check(self, known: Mapping[str, Sequence[str]]) -> None:
        """Refuses a name that fits nothing.

        Args:
            known: Names of the controls and sensors of recordings, by kind; of what isn't listed any name goes.

        Raises:
            RobotError: There is nothing of this name.
        """
        if self.kind not in known:
            return
        for name in self.names:
            if not any(_matches(one, name) for one in known[self.kind]):
                there = ", ".join(known[self.kind]) or "none"
                raise RobotError(f"'{self.line}': recordings have no {self.kind} '{name}'; there are {there}")

    def of(self, kind: _Kind, name: str) -> bool:
        """True if it delays something."""
        return kind == self.kind and any(_matches(name, pattern) for pattern in self.names)


class Delays:
    """The delays of a candidate."""

    def __init__(self, delays: Mapping[str, Sequence[Delay]], values: Mapping[str, float]) -> None:
        """Takes what each parameter delays, by the parameter's name, and the candidate's values."""
        self._set = [
            (delay, delay.factor * values[name] + delay.offset) for name, each in delays.items() for delay in each
        ]

    def control(self, actuator: str, trial: str) -> float | None:
        """By how much an actuator follows a trial's commands later [s]; None where no parameter says so."""
        found = [*self._found("control", actuator), *self._found("trial", trial)]
        return sum(found) if found else None

    def sensor(self, sensor: str, trial: str) -> float:
        """By how much readings of a trial's table are older than their time stamps say [s]."""
        return self.of("sensor", sensor) - self.of("trial", trial)

    def of(self, kind: _Kind, name: str) -> float:
        """By how much one actuator or sensor is late, whatever a trial's clock says [s]."""
        return sum(self._found(kind, name))

    def _found(self, kind: _Kind, name: str) -> list[float]:
        return [seconds for delay, seconds in self._set if delay.of(kind, name)]


def attribute(element: Any, name: str) -> _Attribute | None:
    """The numbers of an element under an MJCF name; None where it has none of this name."""
    if name in ("kp", "kv") and hasattr(element, "gainprm"):
        return _servo_gain(element, name)
    attr = _spec_name(type(element), name)
    if attr is None or not _is_numeric(element, attr):
        return None
    value = getattr(element, attr)
    if isinstance(value, float):
        return _Attribute(None, lambda _: float(getattr(element, attr)), lambda _, x: setattr(element, attr, x))

    def write(index: int, number: float) -> None:
        getattr(element, attr)[index] = number

    size = None if name in _POLYNOMIALS else len(value)
    return _Attribute(size, lambda index: float(getattr(element, attr)[index]), write)


def attribute_names(element: Any) -> tuple[str, ...]:
    """MJCF names of the numbers that an element has."""
    mjcf_names = {other: name for name, other in _OTHER_NAMES.items()}
    names = [mjcf_names.get(attr, attr.replace("_", "")) for attr in dir(element) if _is_numeric(element, attr)]
    gains = [name for name in ("kp", "kv") if hasattr(element, "gainprm") and _servo_gain(element, name) is not None]
    return tuple(sorted({*names, *gains}))


def class_name(element: Any) -> str:
    """The default class of an element."""
    default = element.classname if hasattr(element, "classname") else element.default()  # a tendon's
    return str(default.name)


@cache
def _spec_name(kind: type, name: str) -> str | None:
    for attr in dir(kind):
        if attr == _OTHER_NAMES.get(name, name) or attr.replace("_", "") == name:
            return attr
    return None


def _is_numeric(element: Any, attr: str) -> bool:
    if attr.startswith("_"):
        return False
    value = getattr(element, attr)
    if isinstance(value, float):
        return True
    return isinstance(value, np.ndarray) and value.dtype == np.float64 and value.ndim == 1 and value.size > 0


def _servo_gain(actuator: Any, name: str) -> _Attribute | None:
    """`kp` and `kv` of a position or velocity servo; None for an actuator that is neither."""
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED or actuator.biastype != mujoco.mjtBias.mjBIAS_AFFINE:
        return None
    gain, (_, by_length, by_velocity, *_) = actuator.gainprm[0], actuator.biasprm
    position = by_length == -gain != 0
    velocity = by_length == 0 and by_velocity == -gain != 0
    if not (position if name == "kp" else position or velocity):
        return None
    place = 1 if name == "kp" else 2
    leads = name == "kp" or not position  # the gain by which the control counts

    def read(_: int) -> float:
        number = float(actuator.biasprm[place])
        return float("nan") if place == 2 and number > 0 else abs(number)  # above 0 it is a damping ratio

    def write(_: int, number: float) -> None:
        if leads:
            actuator.gainprm[0] = number
        actuator.biasprm[place] = -number

    return _Attribute(None, read, write)


def _matches(name: str, pattern: str) -> bool:
    return name == pattern or fnmatchcase(name, pattern)


def _known(name: str, known: Sequence[str]) -> str:
    hint = did_you_mean(name, known) or ";"
    listed = ", ".join(known) if known else "none"
    return f"{hint} there {'is' if len(known) == 1 else 'are'} {listed}"
