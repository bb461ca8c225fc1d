"""Units in which other programs write their columns, and how many of a model's unit one of them is."""

from __future__ import annotations

import math
import re

from swimbase.checking import did_you_mean
from swimbase.errors import ArgumentError

_PREFIXES = {"": 1.0, "k": 1e3, "h": 1e2, "c": 1e-2, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9}
_SI = {
    "time": "s", "angle": "rad", "angular velocity": "rad/s", "length": "m", "velocity": "m/s",
    "acceleration": "m/s² m/s^2 m/s2", "force": "N", "torque": "N·m Nm N*m", "voltage": "V", "current": "A",
    "pressure": "Pa", "share": "1",
}  # fmt: skip
_OTHERS = {
    "min": ("time", 60.0), "h": ("time", 3600.0), "d": ("time", 86400.0), "rpm": ("angular velocity", math.tau / 60),
    "N·mm": ("torque", 1e-3), "Nmm": ("torque", 1e-3), "g": ("acceleration", 9.80665),
    "mg": ("acceleration", 9.80665e-3), "mbar": ("pressure", 1e2), "bar": ("pressure", 1e5), "%": ("share", 1e-2),
    "rev": ("angle", math.tau), "rev/s": ("angular velocity", math.tau),
    **dict.fromkeys(("deg", "°"), ("angle", math.pi / 180)),
    **dict.fromkeys(("deg/s", "°/s", "dps"), ("angular velocity", math.pi / 180)),
}  # fmt: skip
UNITS: dict[str, tuple[str, float]] = _OTHERS | {
    f"{prefix}{unit}": (kind, scale)
    for kind, units in _SI.items()
    for unit in units.split()
    for prefix, scale in _PREFIXES.items()
    if scale <= (1e-3 if unit[0] in "sr" and prefix else 1e3)  # no kiloseconds
}
"""Quantities that the known units measure, and how many of the one of SI each is."""
_NONE = ("", "-")  # of what has no unit, or isn't said to have one
_ENDINGS = ("ms", "us", "ns", "deg", "dps", "rpm", "mm", "cm", "mN", "mNm", "mA", "mV")  # that mean nothing but a unit
_BRACKETS = re.compile(r"[\[({]([^\[\](){}]+)[\])}]\s*$")
_WORDS = {
    "s": "sec secs second seconds", "ms": "msec millisecond milliseconds", "us": "usec µs μs microsecond microseconds",
    "ns": "nsec nanosecond nanoseconds", "min": "minute minutes", "h": "hour hours", "d": "day days", "um": "μm",
    "mm": "millimeter millimeters millimetre millimetres", "cm": "centimeter centimeters centimetre centimetres",
    "m": "meter meters metre metres", "deg": "degs degree degrees º", "rad": "rads radian radians",
    "deg/s": "º/s deg/sec", "N": "newton newtons", "V": "volt volts", "A": "ampere amperes",
}  # fmt: skip
_SPELLED = {word: unit for unit, words in _WORDS.items() for word in words.split()}


def known_unit(text: str) -> str | None:
    """The unit that a text stands for, such as `mm` for `Millimeters`; None where it is none."""
    if text in UNITS:
        return text
    return _SPELLED.get(text.lower()) or (text.lower() if len(text) > 2 and text.lower() in UNITS else None)


def kind_of(unit: str) -> str:
    """The quantity that a known unit measures; empty for any other text."""
    return UNITS.get(unit, ("",))[0]


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


def factor(unit: str, into: str = "") -> float:
    """Number of one unit that another one is, such as 0.001 of mm in m.

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
        if one not in UNITS and (one == unit or one not in _NONE):
            near = did_you_mean(one, list(UNITS)) or f"; there are {', '.join([*_OTHERS, *_SI.values()])}"
            raise ArgumentError(f"there is no unit '{one}'{near}")
    (kind, size), (wanted, one) = UNITS[unit], UNITS.get(into, (kind_of(unit), 1.0))
    if wanted != kind:
        raise ArgumentError(f"'{unit}' is a unit of {kind}, and '{into}' one of {wanted}")
    return size / one
