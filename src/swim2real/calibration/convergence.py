"""How the lowest loss of a run fell, and whether it was still falling when the budget was spent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

_FALLING = 0.05  # of the loss, by which the last quarter of the budget may lower it in a run that has converged


def best_losses(entries: Sequence[Mapping[str, Any]]) -> list[float]:
    """Loss of the incumbent after each evaluation [m]; that of a failure as long as all failed."""
    found: list[float] = []
    best: float | None = None
    for entry in entries:
        if not entry["failed"]:
            best = entry["loss"] if best is None else min(best, entry["loss"])
        found.append(entry["loss"] if best is None else best)
    return found


def still_falling(entries: Sequence[Mapping[str, Any]], settings: Mapping[str, Any]) -> str | None:
    """A warning that a run hadn't converged: its last quarter lowered the loss by more than 5 %.

    Args:
        entries: Of the record.
        settings: Of the run; `budget` and `method` are read.

    Returns:
        None for a run that converged, hasn't spent its budget, or is shorter than four evaluations.
    """
    budget = settings.get("budget", 0)
    if budget < 4 or len(entries) < budget:
        return None
    losses = best_losses(entries)
    before, end = losses[len(losses) - len(losses) // 4 - 1], losses[-1]
    if end >= (1 - _FALLING) * before:
        return None
    more = "begin a new run with a higher --budget"  # its stages are planned by the budget
    if settings.get("method") != "staged":
        more = "raise --budget and add --resume"
    return (
        f"the loss was still falling: {100 * (1 - end / before):.0f} % lower in the last quarter of the budget; {more}"
    )
