"""How far simulated trials are from real ones. Arrays only: knows no simulator and no optimizer."""

from swim2real.objective.alignment import Alignment, align
from swim2real.objective.comparison import FAILED_LOSS, ComparedTrial, Comparison, Protocol
from swim2real.objective.evidence import evidence
from swim2real.objective.playback import (
    PlaybackComparison,
    PlaybackTarget,
    SensorComparison,
    compare_playback,
    playbacks_of,
)
from swim2real.objective.swims import Target, TrialComparison, compare, compare_trial, swims_of

__all__ = [
    "FAILED_LOSS",
    "Alignment",
    "ComparedTrial",
    "Comparison",
    "PlaybackComparison",
    "PlaybackTarget",
    "Protocol",
    "SensorComparison",
    "Target",
    "TrialComparison",
    "align",
    "compare",
    "compare_playback",
    "compare_trial",
    "evidence",
    "playbacks_of",
    "swims_of",
]
