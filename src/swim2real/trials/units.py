"""Units in which other programs write their columns, and how many of a model's unit one of them is."""

from __future__ import annotations

import math
import re

from swim2real.checking import did_you_mean
from swim2real.errors import ArgumentError

_TURN = 2 * math.pi
_DEGREE = math.pi / 180
_IN_SI: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": _DEGREE, "°": _DEGREE, "rev": _TURN},
    "angular velocity": dict.fromkeys(("deg/s", "°/s", "dps"), _DEGREE)
    | {"rad/s": 1.0, "rev/s": _TURN, "rpm": _TURN / 60},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "acceleration": dict.fromkeys(("m/s²", "m/s^2", "m/s2"), 1.0)
    | dict.fromkeys(("mm/s²", "mm/s^2", "mm/s2"), 1e-3)
    | {"g": 9.80665, "mg": 9.80665e-3},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "torque": {"N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "mN·m": 1e-3, "mNm": 1e-3, "N·mm": 1e-3, "Nmm": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "mbar": 1e2, "bar": 1e5},
    "share": {"1": 1.0, "%": 1e-2},
}
_KINDS = {unit: kind for kind, units in _IN_SI.items() for unit in units}
UNITS = tuple(_KINDS)
"""Units that are known."""
_NONE = ("", "-")  # of what has no unit, or isn't said to have one
_ENDINGS = ("ms", "us", "ns", "deg", "dps", "rpm", "mm", "cm", "mN", "mNm", "mA", "mV")  # that mean nothing but a unit
_BRACKETS = re.compile(r"[\[({]([^\[\](){}]+)[\])}]\s*$")
_WORDS = {
    "s": "sec secs second seconds", "ms": "msec millisecond milliseconds", "us": "usec µs μs microsecond microseconds",
    "ns": "nsec nanosecond nanoseconds", "min": "minute minutes", "h": "hour hours", "d": "day days",
    "m": "meter meters metre metres", "mm": "millimeter millimeters millimetre millimetres",
    "cm": "centimeter centimeters centimetre centimetres", "deg": "degs degree degrees º", "rad": "rads radian radians",
    "deg/s": "º/s deg/sec", "N": "newton newtons", "V": "volt volts", "A": "ampere amperes", "um": "μm",
}  # fmt: skip
_SPELLED = {word: unit for unit, words in _WORDS.items() for word in words.split()}


def known_unit(text: str) -> str | None:
    """The unit that a text stands for, such as `mm` for `Millimeters`; None where it is none."""
    if text in _KINDS:
        return text
    return _SPELLED.get(text.lower()) or (text.lower() if len(text) > 2 and text.lower() in _KINDS else None)


def kind_of(unit: str) -> str:
    """What a known unit measures; empty for any other text."""
    return _KINDS.get(unit, "")


def unit_of_header(header: str) -> str | None:
    """The unit that a column's name ends in, such as `hip_deg`, `load [mN]` or `t (ms)`; None without one."""
    found = _BRACKETS.search(header)
    if found is not None:
        unit = found[1].strip()
        return None if unit.isdigit() else known_unit(unit)  # gyro[1] is one number of a vector
    ending = header.strip().rpartition("_")[2]
    return ending if ending in _ENDINGS and ending != header.strip() else None


def without_unit(header: str) -> str:
    """A column's name without the unit that it ends in."""
    name = header.strip()
    if unit_of_header(name) is None:
        return name.removesuffix("_s")
    return _BRACKETS.sub("", name).strip() if _BRACKETS.search(name) else name.rpartition("_")[0]


def alike(unit: str) -> list[str]:
    """Units of the same kind, or this one alone where it isn't known."""
    return list(_IN_SI.get(_KINDS.get(unit, ""), (unit,)))


def factor(unit: str, into: str = "") -> float:
    """How many of one unit another one is, such as 0.001 of mm in m.

    Args:
        unit: Unit of a column.
        into: Unit that is wanted; by default that of SI.

    Raises:
        ArgumentError: A unit isn't known, or they measure different things.
    """
    unit, into = known_unit(unit) or unit, known_unit(into) or into
    if unit == into:
        return 1.0
    for one in (unit, into):
        if one not in _KINDS and (one == unit or one not in _NONE):
            near = did_you_mean(one, UNITS) or f"; there are {', '.join(UNITS)}"
            raise ArgumentError(f"there is no unit '{one}'{near}")
    kind = _KINDS[unit]
    if into in _NONE:
        return _IN_SI[kind][unit]
    if _KINDS[into] != kind:
        raise ArgumentError(f"'{unit}' is a unit of {kind}, and '{into}' one of {_KINDS[into]}")
    return _IN_SI[kind][unit] / _IN_SI[kind][into]
