"""The parameters of a robot file: what they are called, and what they write."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from swim2real.errors import ParameterError, RobotError
from swim2real.parameters import Parameter
from swim2real.robots.table import Table
from swim2real.robots.writes import Write

_KEYS = ("name", "unit", "lower", "upper", "scale", "log_offset", "meaning", "value", "writes")


@dataclass(frozen=True)
class Calibrated:
    """A parameter and where it goes.

    Attributes:
        parameter: Its published value is the model's own, or what the file says.
        writes: At least one.
    """

    parameter: Parameter
    writes: tuple[Write, ...]


def read_calibrated(table: Table, spec: mujoco.MjSpec) -> tuple[Calibrated, ...]:
    """The parameters of a robot file, checked against its model.

    Raises:
        RobotError: One can't be read, writes to what isn't there, or its bounds make no sense there.
    """
    found = tuple(_calibrated(table, i, entry, spec) for i, entry in enumerate(table.list("parameters")))
    if not found:
        raise RobotError(f"{table.where}: there are no [[parameters]], so nothing could be calibrated")
    names = [one.parameter.name for one in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RobotError(f"{table.where}: two parameters are named '{twice}'; give each its own name")
    return found


def _calibrated(table: Table, index: int, entry: Any, spec: mujoco.MjSpec) -> Calibrated:
    if not isinstance(entry, dict):
        raise table.wrong("parameters", entry, "must be tables, [[parameters]]")
    part = Table(entry, f"{table.where}, parameter {entry.get('name', index + 1)!r}")
    part.allow(*_KEYS)
    name, lower, upper = part.text("name"), part.number("lower"), part.number("upper")
    writes = tuple(_write(part, one) for one in _lines(part))
    try:
        for write in writes:
            for bound in (lower, upper):
                write.check_sense(spec, bound)
        value = part.number("value") if "value" in entry else _current(writes, spec)
        log = part.one_of("scale", ("log", "linear"), "linear") == "log"
        parameter = Parameter(
            name, part.text("unit", "-"), lower, upper, " ".join(part.text("meaning").split()), value,
            part.number("log_offset", 0.0) if log else None,
        )  # fmt: skip
        if "value" in entry:
            parameter.check(value)
        else:
            _check_own(parameter)
    except (RobotError, ParameterError) as error:
        text = str(error)
        raise RobotError(text if text.startswith(part.where) else f"{part.where}: {text}") from error
    return Calibrated(parameter, writes)


def _check_own(parameter: Parameter) -> None:
    try:
        parameter.check(parameter.published)
    except ParameterError as error:
        raise RobotError(
            f"{error}; this is the model's own value, so widen the bounds, change it in the model, or say value = …"
        ) from error


def _current(writes: tuple[Write, ...], spec: mujoco.MjSpec) -> float:
    """The value at which the model stays as it is.

    Raises:
        RobotError: There is none.
    """
    found = [number for write in writes for number in write.current(spec)]
    if not np.isfinite(found).all():
        raise RobotError("the model sets no number there, so the parameter needs value = …")
    if not np.allclose(found, found[0], rtol=1e-9, atol=0.0):
        listed = ", ".join(f"{one:g}" for one in sorted(set(found)))
        raise RobotError(f"the model has several numbers there ({listed}), so the parameter needs value = …")
    return found[0]


def _lines(part: Table) -> list[Any]:
    lines = part.content.get("writes")
    if isinstance(lines, str | Mapping):
        return [lines]
    if not isinstance(lines, list) or not lines:
        raise part.wrong("writes", lines, "must say what the parameter writes, such as ['joint \"hip\" damping']")
    return lines


def _write(part: Table, entry: Any) -> Write:
    if isinstance(entry, str):
        return Write(entry)
    if not isinstance(entry, dict):
        raise part.wrong("writes", entry, "must be texts or tables with to, factor, offset and relative")
    one = Table(entry, f"{part.where}, writes")
    one.allow("to", "factor", "offset", "relative")
    factor = one.number("factor", 1.0)
    if factor == 0:
        raise one.wrong("factor", factor, "must not be 0, or the parameter changes nothing")
    return Write(one.text("to"), factor, one.number("offset", 0.0), one.truth("relative"))
