"""How far simulated swims are from real ones. Arrays only: knows no simulator and no optimizer."""

from swim2real.objective.alignment import Alignment, align
from swim2real.objective.comparison import (
    FAILED_LOSS,
    Comparison,
    Protocol,
    Target,
    TrialComparison,
    compare,
    compare_trial,
)
from swim2real.objective.evidence import evidence

__all__ = [
    "FAILED_LOSS",
    "Alignment",
    "Comparison",
    "Protocol",
    "Target",
    "TrialComparison",
    "align",
    "compare",
    "compare_trial",
    "evidence",
]
