"""What a parameter writes: numbers of MJCF elements, said in a line such as `geom "fin" fluidcoef[2]`.

    option density                  of the model as a whole
    joint "hip" damping             of one element
    joint "tail*" stiffness         of all whose names match
    joint "hip", "knee" damping     of those named
    geom class "wet" fluidcoef[0]   of all elements of a default class, whatever they set themselves
    body "fin" pos[2]               one of several numbers

Names, units and order are those of the MJCF file; an angle is in degrees where its compiler says so. `mass`,
`diaginertia` and `ipos` of a body are those of its <inertial>; `kp` and `kv` are those of position and velocity servos.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import mujoco

from swim2real.errors import RobotError
from swim2real.robots.attributes import NOT_NEGATIVE, Attribute, attribute, attribute_names, class_name

KINDS = {
    "body": "bodies", "joint": "joints", "geom": "geoms", "site": "sites", "tendon": "tendons",
    "actuator": "actuators", "equality": "equalities", "mesh": "meshes",
}  # fmt: skip
_LINE = re.compile(
    r'\s*(?P<kind>\w+)\s*(?:(?P<by>class\s+)?(?P<names>"[^"]*"(?:\s*,\s*"[^"]*")*))?'
    r"\s+(?P<attribute>\w+)\s*(?:\[\s*(?P<index>\d+)\s*\])?\s*"
)


@dataclass(frozen=True)
class Write:
    """One place that a parameter writes to.

    Attributes:
        line: As in the robot file.
        factor: By which the value is multiplied.
        offset: That is added then.
        relative: Whether the result multiplies the number that the model has, instead of replacing it.
    """

    line: str
    factor: float = 1.0
    offset: float = 0.0
    relative: bool = False

    def __str__(self) -> str:
        """What is written where, x being the value."""
        times = "x" if self.factor == 1 else f"{self.factor:g} x"
        number = times + (f" {self.offset:+g}".replace("+", "+ ").replace("-", "- ") if self.offset else "")
        if self.relative:
            return f"{self.line} *= {number}"
        return self.line if number == "x" else f"{self.line} = {number}"

    def into(self, spec: mujoco.MjSpec) -> Callable[[float], None]:
        """What writes a value into a model.

        Raises:
            RobotError: The model has no such place.
        """
        found = places(spec, self.line)

        def write(value: float) -> None:
            number = self.factor * value + self.offset
            for numbers, index in found:
                numbers.write(index, number * numbers.read(index) if self.relative else number)

        return write

    def current(self, spec: mujoco.MjSpec) -> list[float]:
        """The values at which each place of the model stays as it is; NaN where it sets no number. Not empty."""
        found = places(spec, self.line)
        there = [1.0] if self.relative else [numbers.read(index) for numbers, index in found]
        return [(number - self.offset) / self.factor for number in there]

    def check_sense(self, spec: mujoco.MjSpec, value: float) -> None:
        """Refuses a number below 0 where the attribute has no sense there.

        Raises:
            RobotError: It has none.
        """
        found = target(spec, self.line)
        number = self.factor * value + self.offset
        if number < 0 and (self.relative or found.attribute in NOT_NEGATIVE):
            what = f"{number:g} times its own" if self.relative else f"{number:g}"
            raise RobotError(
                f"{value:g} would write {what} to {self.line}, which can't be negative; change the bound, or the "
                f"factor and offset"
            )


@dataclass(frozen=True)
class Target:
    """What a line stands for.

    Attributes:
        kind: Of element.
        elements: Of the model, each with its number among its kind.
        attribute: Its MJCF name.
        index: Of several numbers; None where the line gives none.
    """

    kind: str
    elements: tuple[tuple[int, Any], ...]
    attribute: str
    index: int | None

    def named(self, element: Any) -> str:
        """An element as a message names it."""
        return "option" if self.kind == "option" else f"{self.kind} '{element.name}'"


def target(spec: mujoco.MjSpec, line: str) -> Target:
    """Elements and number that a line stands for.

    Raises:
        RobotError: The line can't be read, or the model has no such element; names those that exist.
    """
    matched = _parsed(line)
    kind, index = matched["kind"], matched["index"]
    elements = [(0, spec.option)] if kind == "option" else _elements(spec, matched)
    return Target(kind, tuple(elements), str(matched["attribute"]), None if index is None else int(index))


def places(spec: mujoco.MjSpec, line: str) -> list[tuple[Attribute, int]]:
    """The numbers of a model that a line stands for, each with its index.

    Raises:
        RobotError: The line can't be read, or the model has no such element or number; names those that exist.
    """
    found = target(spec, line)
    return [_place(found, element) for _, element in found.elements]


def _place(found: Target, element: Any) -> tuple[Attribute, int]:
    who, name, index = found.named(element), found.attribute, found.index
    numbers = attribute(element, name)
    if numbers is None:
        raise RobotError(f"{who} has no number '{name}'{_known(name, attribute_names(element))}")
    if numbers.size is None and index:
        raise RobotError(f"{who} has one {name}; leave out [{index}]")
    if numbers.size is not None and index is None:
        raise RobotError(
            f"{name} of {who} has {numbers.size} values; say which one: {name}[0] to {name}[{numbers.size - 1}]"
        )
    if numbers.size is not None and index is not None and index >= numbers.size:
        raise RobotError(f"{name} of {who} has {numbers.size} values, from [0]; there is no [{index}]")
    return numbers, index or 0


def _parsed(line: str) -> re.Match[str]:
    matched = _LINE.fullmatch(line)
    if matched is None:
        raise RobotError(
            f"'{line}' can't be read as a place in the model; write it as in: joint \"hip\" damping, "
            f'geom "fin" fluidcoef[2], geom class "wet" fluidcoef[0], option density'
        )
    kind, names = matched["kind"], matched["names"]
    if kind != "option" and kind not in KINDS:
        raise RobotError(f"there is no kind of element '{kind}'{_known(kind, ('option', *KINDS))}")
    if (kind == "option") != (names is None):
        need = "takes no name" if kind == "option" else 'needs a name, such as "hip"'
        raise RobotError(f"'{line}': {kind} {need}")
    return matched


def _elements(spec: mujoco.MjSpec, matched: re.Match[str]) -> list[tuple[int, Any]]:
    """Elements of a kind that are named, each once, with their numbers."""
    kind = matched["kind"]
    there = list(enumerate(getattr(spec, KINDS[kind])))
    found: dict[int, Any] = {}
    for name in re.findall(r'"([^"]*)"', matched["names"]):
        if matched["by"]:
            wanted = [one for one in there if class_name(one[1]) == name]
            known = tuple(sorted({class_name(element) for _, element in there}))
        else:
            wanted = [one for one in there if one[1].name and _matches(one[1].name, name)]
            known = tuple(element.name for _, element in there if element.name)
        if not wanted:
            what = f"{kind} of class '{name}'" if matched["by"] else f"{kind} '{name}'"
            unnamed = "" if matched["by"] else _unnamed(kind, sum(not element.name for _, element in there))
            raise RobotError(f"the model has no {what}{_known(name, known)}{unnamed}")
        found |= dict(wanted)
    return list(found.items())


def _matches(name: str, pattern: str) -> bool:
    return name == pattern or fnmatchcase(name, pattern)


def _unnamed(kind: str, count: int) -> str:
    return f" ({count} of kind {kind} have no name; give them one in the MJCF file)" if count else ""


def _known(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ";"
    listed = ", ".join(known) if known else "none"
    return f"{hint} there {'is' if len(known) == 1 else 'are'} {listed}"
