"""Numbers and tables as a VLM reads them: few digits, plain minus signs, Markdown."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

UNKNOWN = "n/a"

Number = float | None

_PIECE = re.compile(r"[A-Za-z]+|[^\s]|\n")
_LETTERS = 6  # of a word that a token holds, on average


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


def pair(vector: Sequence[float] | None, digits: int) -> str:
    """Both parts of a difference of places, in millimeters."""
    return UNKNOWN if vector is None else ", ".join(mm(part, digits, signed=True) for part in vector)


def span(times: Sequence[float] | None) -> str:
    """A window of time [s]."""
    return UNKNOWN if times is None else f"{times[0]:.2f} to {times[1]:.2f}"


def degrees(angle: Number) -> str:
    """Radians as degrees."""
    return number(angle, 1, 180 / math.pi)


def reading(number: Number, signed: bool = False) -> str:
    """What a sensor reads, in its unit."""
    if number is None:
        return UNKNOWN
    return f"{'+' if signed and number > 0 else ''}{value(number, 3)}"


def shortened(text: str, longest: int) -> str:
    """A text on one line, cut at a word."""
    line = " ".join(text.split())
    if len(line) <= longest:
        return line
    cut = line[: longest - 1]
    return cut[: cut.rfind(" ")].rstrip(" ,;:") + "…" if " " in cut else cut + "…"


def estimate_tokens(text: str) -> int:
    """About how many tokens a text takes, rather too many than too few.

    A rule of thumb for today's tokenizers: one token for up to six letters of a word, and one for every digit, sign,
    line break and character beyond ASCII. Four characters a token, the usual rule, is for prose; tables of numbers take
    about twice as many, since several tokenizers split numbers into digits.
    """
    return sum(-(-len(piece) // _LETTERS) for piece in _PIECE.findall(text))
