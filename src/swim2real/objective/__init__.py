"""Distance of simulated trials from real ones. Arrays only: knows no simulator and no optimizer."""

from swim2real.objective.alignment import Alignment, align
from swim2real.objective.comparison import Comparison, evidence, rounded
from swim2real.objective.matching import compare_playback, compare_steady
from swim2real.objective.target import SensorTarget, Target, playback_target, steady_target
from swim2real.objective.trial import (
    FAILED_LOSS,
    TAIL_FIRST_LOSS,
    ComparedBeat,
    ComparedHead,
    ComparedProgress,
    ComparedSensor,
    ComparedTrial,
)

__all__ = [
    "FAILED_LOSS", "TAIL_FIRST_LOSS", "Alignment", "ComparedBeat", "ComparedHead", "ComparedProgress", "ComparedSensor",
    "ComparedTrial", "Comparison", "SensorTarget", "Target", "align", "compare_playback", "compare_steady", "evidence",
    "playback_target", "rounded", "steady_target",
]  # fmt: skip
