"""Numbers and tables as a VLM reads them: few digits, plain minus signs, Markdown."""

from __future__ import annotations

from collections.abc import Sequence

UNKNOWN = "n/a"

Number = float | None


def number(value: Number, digits: int = 0, factor: float = 1.0, signed: bool = False) -> str:
    """A number with fixed digits, never a negative zero."""
    if value is None:
        return UNKNOWN
    shown = f"{value * factor:{'+' if signed else ''}.{digits}f}"
    return shown.lstrip("+-") if float(shown) == 0 else shown


def mm(value: Number, digits: int = 0, signed: bool = False) -> str:
    """Meters as millimeters, or m/s as mm/s, without the unit."""
    return number(value, digits, 1e3, signed)


def value(number: float, digits: int = 4) -> str:
    """A parameter's value. To four digits, who repeats it changes nothing."""
    return f"{number:.{digits}g}"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
