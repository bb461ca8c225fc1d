"""Candidates of what to calibrate, and what they are called."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T", bound=Hashable)

SPREAD = 5.0  # by which bounds lie below and above a value
_TWINS = re.compile(r"\d+|left|right", re.IGNORECASE)


@dataclass(frozen=True)
class Candidate:
    """A parameter that a robot file may have.

    Attributes:
        name: As it would like to be called.
        kind: Of element, to tell it from another one of this name.
        unit: SI.
        lower: Smallest value [unit].
        upper: Largest value [unit].
        log_offset: Of its logarithmic scale [unit].
        meaning: What more of it does.
        writes: Lines.
        relative: Whether it multiplies what the model has.
        group: Elements that it writes to alike; empty for one.
        aside: Why it is only suggested, in a comment; None where it is calibrated.
    """

    name: str
    kind: str
    unit: str
    lower: float
    upper: float
    log_offset: float
    meaning: str
    writes: tuple[str, ...]
    relative: bool = False
    group: tuple[str, ...] = ()
    aside: str | None = None


def grouped(elements: Sequence[Any], value: Callable[[Any], T]) -> list[tuple[T, tuple[Any, ...]]]:
    """Named elements whose names differ in numbers and sides only, and whose values are the same."""
    found: dict[tuple[str, T], list[Any]] = {}
    for element in elements:
        if element.name:
            found.setdefault((_TWINS.sub("#", element.name), value(element)), []).append(element)
    return [(own, tuple(members)) for (_, own), members in found.items()]


def base_name(kind: str, members: Sequence[Any]) -> str:
    """What one element is called, or several that differ in numbers and sides."""
    name = members[0].name if len(members) == 1 else _TWINS.sub("", members[0].name)
    return re.sub(r"\W+|_+", "_", name).strip("_").lower() or kind


def line(kind: str, members: Sequence[Any], attribute: str) -> str:
    """What writes to elements."""
    return f"{kind} {', '.join(quoted(member.name) for member in members)} {attribute}"


def names(members: Sequence[Any]) -> tuple[str, ...]:
    """Of a group; none for a single element."""
    return tuple(member.name for member in members) if len(members) > 1 else ()


def quoted(name: str) -> str:
    """A name as a line has it."""
    return f'"{name}"'


def around(value: float, spread: float = SPREAD) -> tuple[float, float]:
    """Bounds below and above a value above 0."""
    return rounded(value / spread, math.floor), rounded(value * spread, math.ceil)


def rounded(value: float, by: Callable[[float], int] = round, digits: int = 2) -> float:
    """A number above 0 with few digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{by(round(value / step, 6)) * step:.{digits}g}")
