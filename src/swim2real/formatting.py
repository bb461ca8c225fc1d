"""Numbers and lists as short texts, in the units that a person reads; values are in SI."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

NOTHING, PLAIN_NOTHING = "–", "n/a"
_ZERO = 1e-12

Number = float | None


def number(
    value: Number, digits: int | None = 1, factor: float = 1.0, signed: bool = False, plain: bool = False
) -> str:
    """A number, never a negative zero; a dash for None, NaN and infinity.

    Args:
        value: The number.
        digits: Digits after the point; None for three significant ones.
        factor: Factor to the unit that is shown.
        signed: Whether a positive number has its sign.
        plain: Whether the minus is ASCII and nothing is `n/a`, as models and programs read them.
    """
    if value is None or not math.isfinite(value):
        return PLAIN_NOTHING if plain else NOTHING
    shown = f"{factor * value:{'+' if signed else ''}{'.3g' if digits is None else f'.{digits}f'}}"
    if float(shown) == 0:
        shown = shown.lstrip("+-")
    return shown if plain else shown.replace("-", "−")


def mm(value: Number, digits: int = 1, signed: bool = False, plain: bool = False) -> str:
    """Meters as millimeters, or m/s as mm/s, without the unit."""
    return number(value, digits, 1e3, signed, plain)


def degrees(value: Number, digits: int = 0, signed: bool = False, plain: bool = False) -> str:
    """Radians as degrees, without the unit."""
    return number(value, digits, 180 / math.pi, signed, plain)


def percent(value: Number, digits: int = 1) -> str:
    """A share as percent, with its sign."""
    shown = number(value, digits, 1e2)
    return shown if shown == NOTHING else f"{shown} %"


def significant(value: Number) -> str:
    """Four significant digits; what rounding left of a zero is zero."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return "0" if abs(value) < _ZERO else f"{value:.4g}".replace("-", "−")


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
        return f"{number(seconds)} s" if seconds < 10 else f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600:,} h {whole % 3600 // 60} min"


def spread(value: Number, std: Number) -> str:
    """Value ± standard deviation to the digits that the deviation supports."""
    if value is None or std is None or not math.isfinite(std) or std <= 0:
        return number(value, 3)
    digits = min(6, max(1, 1 - math.floor(math.log10(std))))
    return f"{number(value, digits)} ± {number(std, digits)}"


def listed(names: Sequence[object], most: int = 12) -> str:
    """`a`, `a and b`, `a, b and c`, or the first few `and 9 more`."""
    texts = [str(name) for name in names]
    if len(texts) > most:
        texts = [*texts[:most], f"{len(texts) - most} more"]
    return " and ".join((", ".join(texts[:-1]), texts[-1])) if len(texts) > 1 else "".join(texts)


def html_table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table for a notebook."""
    head = "".join(f"<th>{escape(one)}</th>" for one in headings)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<p>{escape(title)}</p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def shortened(text: str, longest: int = 300) -> str:
    """A text that others wrote, cut off where it gets long."""
    return text if len(text) <= longest else text[: longest - 1] + "…"
