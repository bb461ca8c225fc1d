"""The edge: SI numbers become short texts in the units that a person reads."""

from __future__ import annotations

import math

NOTHING = "–"
_ZERO = 1e-12

Number = float | None


def text(value: Number, digits: int, factor: float = 1.0, signed: bool = False) -> str:
    """A number with fixed digits and a real minus sign; a dash for None and NaN."""
    if value is None or not math.isfinite(value):
        return NOTHING
    shown = f"{value * factor:{'+' if signed else ''}.{digits}f}"
    if float(shown) == 0:
        shown = shown.lstrip("+-")
    return shown.replace("-", "−")


def mm(value: Number, digits: int = 1, signed: bool = False) -> str:
    """Meters as millimeters, or m/s as mm/s, without the unit."""
    return text(value, digits, 1e3, signed)


def percent(value: Number, digits: int = 1) -> str:
    """A share as percent, with its sign."""
    shown = text(value, digits, 1e2)
    return shown if shown == NOTHING else f"{shown} %"


def degrees(value: Number) -> str:
    """Radians as whole degrees, without the unit."""
    return text(value, 0, 180 / math.pi)


def significant(value: Number) -> str:
    """Four significant digits; what rounding left of a zero is zero."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if abs(value) < _ZERO:
        return "0"
    return f"{value:.4g}".replace("-", "−")


def spread(value: Number, std: Number) -> str:
    """Value ± standard deviation to the digits that the deviation supports."""
    if value is None or std is None or not math.isfinite(std) or std <= 0:
        return text(value, 3)
    digits = min(6, max(1, 1 - math.floor(math.log10(std))))
    return f"{text(value, digits)} ± {text(std, digits)}"


def to_mm(value: Number) -> float | None:
    """Meters as millimeters to a tenth, for a figure; None for None and NaN."""
    return None if value is None or not math.isfinite(value) else round(value * 1e3, 1)
