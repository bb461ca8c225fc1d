"""The edge: SI numbers become short texts in the units that a person reads."""

from __future__ import annotations

import math
from collections.abc import Sequence

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


def count(value: int | None) -> str:
    """A whole number with its thousands apart; a dash for None."""
    return NOTHING if value is None else f"{value:,}"


def dollars(value: float) -> str:
    """An amount in USD, to the cent from ten cents on."""
    return f"{value:,.{2 if value >= 0.1 else 4}f} USD"


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    whole = round(seconds)
    if whole < 60:
        return f"{text(seconds, 1)} s" if seconds < 10 else f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600:,} h {whole % 3600 // 60} min"


def listed(names: Sequence[object], most: int = 12) -> str:
    """`a`, `a and b`, `a, b and c`, or the first few `and 9 more`."""
    texts = [str(name) for name in names]
    if len(texts) > most:
        texts = [*texts[:most], f"{len(texts) - most} more"]
    return " and ".join((", ".join(texts[:-1]), texts[-1])) if len(texts) > 1 else "".join(texts)


def shortened(said: str, longest: int = 300) -> str:
    """A text that others wrote, cut off where it gets long."""
    return said if len(said) <= longest else said[: longest - 1] + "…"


def spread(value: Number, std: Number) -> str:
    """Value ± standard deviation to the digits that the deviation supports."""
    if value is None or std is None or not math.isfinite(std) or std <= 0:
        return text(value, 3)
    digits = min(6, max(1, 1 - math.floor(math.log10(std))))
    return f"{text(value, digits)} ± {text(std, digits)}"


def to_mm(value: Number) -> float | None:
    """Meters as millimeters to a tenth, for a figure; None for None and NaN."""
    return None if value is None or not math.isfinite(value) else round(value * 1e3, 1)
