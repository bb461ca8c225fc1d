"""How well trials determine a parameter: the one definition, for terminal, pages and files."""

from __future__ import annotations

from typing import Literal, TypeAlias

Known: TypeAlias = Literal["determined", "roughly", "undetermined"]

_DETERMINED, _UNDETERMINED = 0.25, 0.8


def known(width: float, sure: bool = True) -> Known:
    """Name of how well a parameter is known.

    *Determined*: its interval spans a quarter of its bounds at most. *Undetermined*: it spans four fifths of them or
    more, so the value may be nearly any. *Roughly*: between these, or where something is wrong with the fit.

    Args:
        width: Width of the interval, as a share of the bounds on the scale of the search.
        sure: Whether the fit is good enough for an interval to be believed.
    """
    if width >= _UNDETERMINED:
        return "undetermined"
    return "determined" if width <= _DETERMINED and sure else "roughly"
