"""Delays of recordings that parameters set, in lines beside those of `targets.py`.

    control "winch" delay        the actuator follows its commands later by so many seconds
    sensor "pull" delay          the readings show what was so many seconds ago
    trial "steps" delay          the trial's tables are on a clock that is behind: what they date happens later

Names may be patterns, as in `control "*" delay`. Delays that apply to the same thing add up; one below 0 is an advance.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Literal

from swim2real.errors import RobotError

Kind = Literal["control", "sensor", "trial"]
_LINE = re.compile(r'\s*(?P<kind>control|sensor|trial)\s+(?P<names>"[^"]*"(?:\s*,\s*"[^"]*")*)\s+(?P<what>\S+)\s*')


@dataclass(frozen=True)
class Delay:
    """What a parameter delays.

    Attributes:
        line: The line of the robot file.
        kind: What is delayed.
        names: Names or patterns of those that are.
        factor: Number by which the parameter's value is multiplied.
        offset: Delay that is added then [s].
    """

    line: str
    kind: Kind
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
        matched = _LINE.fullmatch(line)
        if matched is None:
            return None
        if matched["what"] != "delay":
            raise RobotError(f"'{line}': a {matched['kind']} has a delay and nothing else that could be calibrated")
        kind: Kind = "control" if matched["kind"] == "control" else "sensor" if matched["kind"] == "sensor" else "trial"
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

    def of(self, kind: Kind, name: str) -> bool:
        """Whether it delays something."""
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
        return sum(self._found("sensor", sensor)) - sum(self._found("trial", trial))

    def _found(self, kind: Kind, name: str) -> list[float]:
        return [seconds for delay, seconds in self._set if delay.of(kind, name)]


def _matches(name: str, pattern: str) -> bool:
    return name == pattern or fnmatchcase(name, pattern)
