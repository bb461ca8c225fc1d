"""The numbers that a person, a VLM or the physics advisor judges a candidate by: compact and ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from swim2real.objective.comparison import Comparison

_DIGITS = 9


def evidence(comparison: Comparison) -> dict[str, Any]:
    """All figures of a candidate and, per trial, its markers' errors and motions, as the trial's own evidence says.

    Numbers are rounded to nine digits, so that a record read back gives exactly the same.
    """
    figures = comparison.figures()
    for trial in comparison.trials:
        figures["trials"][trial.name].update(trial.evidence())
    return rounded(figures)


def rounded(value: Any) -> Any:
    """Plain lists and numbers for JSON, None for NaN."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, np.ndarray | list | tuple):
        return [rounded(inner) for inner in value]  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.{_DIGITS}g}") if np.isfinite(value) else None
    return value
