"""Averages over what is known, and figures of a simulation that diverged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np


def mean(values: Iterable[float | None]) -> float | None:
    """Of those that are known; None where none is."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def median(values: Iterable[float | None]) -> float | None:
    """Likewise."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def without_errors(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of a simulation that diverged: only those that need no simulation are known."""
    return {name: value if name in ("frequency", "left_out_share") else None for name, value in figures.items()}
