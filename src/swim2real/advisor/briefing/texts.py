"""Numbers and tables as a VLM reads them: few digits, plain minus signs, Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swim2real import formatting
from swim2real.formatting import PLAIN_NOTHING as NOTHING
from swim2real.objective import rounded


def number(value: float | None, digits: int | None = 1, factor: float = 1.0, signed: bool = False) -> str:
    """A number as on record, so that a processor's last digits don't decide what is read; `n/a` for None."""
    return formatting.number(rounded(value), digits, factor, signed, plain=True)


def mm(value: float | None, digits: int = 1, signed: bool = False) -> str:
    """Meters as millimeters, or m/s as mm/s, without the unit."""
    return number(value, digits, 1e3, signed)


def degrees(angle: float | None, digits: int = 1, signed: bool = False) -> str:
    """Radians as degrees."""
    return number(angle, digits, 180 / math.pi, signed)


def reading(value: float | None, signed: bool = False) -> str:
    """Quantity that a sensor reads, in its unit."""
    return number(value, None, signed=signed)


def significant(value: float, digits: int = 4) -> str:
    """A parameter's value. To four digits, who repeats it changes nothing."""
    return f"{value:.{digits}g}"


def pair(place: Sequence[float] | None, digits: int) -> str:
    """Both parts of a difference of places, in millimeters."""
    return NOTHING if place is None else ", ".join(mm(part, digits, signed=True) for part in place)


def span(times: tuple[float, float] | None) -> str:
    """A window of time [s]."""
    return NOTHING if times is None else f"{times[0]:.2f} to {times[1]:.2f}"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [columns, ["-"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)


def shortened(text: str, longest: int) -> str:
    """A text on one line, cut at a word."""
    line = " ".join(text.split())
    if len(line) <= longest:
        return line
    cut = line[: longest - 1]
    return cut[: cut.rfind(" ")].rstrip(" ,;:") + "…" if " " in cut else cut + "…"
