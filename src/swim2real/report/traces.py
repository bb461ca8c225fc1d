"""What figures of trials share, whatever a trial is: which trials are drawn, and positions as plotly takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
T = TypeVar("T")
Range = tuple[float, float]

MAX_TRIALS = 24  # drawn, so that the page stays of a size to send


def drawn(trials: Sequence[T]) -> tuple[T, ...]:
    """The trials that get figures: at most `MAX_TRIALS`, spread over all."""
    if len(trials) <= MAX_TRIALS:
        return tuple(trials)
    return tuple(trials[i] for i in (round(k * (len(trials) - 1) / (MAX_TRIALS - 1)) for k in range(MAX_TRIALS)))


def ranges_mm(points: Array, margin: float) -> tuple[Range, Range]:
    """Ranges of x and y that hold all points and a margin on each side [mm].

    Args:
        points: NaN where there is none [m]. Shape (n, 2).
        margin: [m].
    """
    there = points[np.isfinite(points).all(axis=1)]
    if not len(there):
        return (0.0, 100.0), (-50.0, 50.0)
    low, high = (there.min(axis=0) - margin) * 1e3, (there.max(axis=0) + margin) * 1e3
    return (round(float(low[0])), round(float(high[0]))), (round(float(low[1])), round(float(high[1])))


def points_mm(positions: Array, where: NDArray[np.bool_]) -> dict[str, list[float | None]]:
    """Coordinates [mm], None where they don't count. Shapes (T, 2) and (T,)."""
    shown = where & np.isfinite(positions).all(axis=1)
    rows = [
        (round(1e3 * x, 1), round(1e3 * y, 1)) if ok else (None, None)
        for ok, (x, y) in zip(shown, positions.tolist(), strict=True)
    ]
    return {"x": [x for x, _ in rows], "y": [y for _, y in rows]}
