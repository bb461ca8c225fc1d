"""swim2real: marker tracks of a swimming robot in, a calibrated MuJoCo simulator out.

What is offered here is imported when it is used, so `import swim2real` is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swim2real.api import Run, compare, evaluate, open_run, simulate
    from swim2real.calibration import Outcome
    from swim2real.comparison import ComparisonResults
    from swim2real.demo import SyntheticCamera, synthetic_reference
    from swim2real.errors import Swim2RealError
    from swim2real.objective import Comparison
    from swim2real.pipeline import calibrate, track_video, track_videos
    from swim2real.pipeline.training import train
    from swim2real.report import write_report
    from swim2real.robots import load_robot
    from swim2real.robots.robot import Robot
    from swim2real.settings import (
        BriefingSettings,
        CalibrationSettings,
        ComparisonSettings,
        EvaluationSettings,
        TrackingSettings,
        TrainingSettings,
        VlmAccess,
    )
    from swim2real.trials import MarkerTrack, Trial, TrialSet, load_reference, save_reference

__version__ = "0.1.0"

__all__ = [
    "BriefingSettings",
    "CalibrationSettings",
    "Comparison",
    "ComparisonResults",
    "ComparisonSettings",
    "EvaluationSettings",
    "MarkerTrack",
    "Outcome",
    "Robot",
    "Run",
    "Swim2RealError",
    "SyntheticCamera",
    "TrackingSettings",
    "TrainingSettings",
    "Trial",
    "TrialSet",
    "VlmAccess",
    "calibrate",
    "compare",
    "evaluate",
    "load_reference",
    "load_robot",
    "open_run",
    "save_reference",
    "simulate",
    "synthetic_reference",
    "track_video",
    "track_videos",
    "train",
    "write_report",
]

_MODULES = {
    "api": ("Run", "compare", "evaluate", "open_run", "simulate"),
    "calibration": ("Outcome",),
    "comparison": ("ComparisonResults",),
    "demo": ("SyntheticCamera", "synthetic_reference"),
    "errors": ("Swim2RealError",),
    "objective": ("Comparison",),
    "pipeline": ("calibrate", "track_video", "track_videos"),
    "pipeline.training": ("train",),
    "report": ("write_report",),
    "robots": ("load_robot",),
    "robots.robot": ("Robot",),
    "settings": (
        "BriefingSettings", "CalibrationSettings", "ComparisonSettings", "EvaluationSettings", "TrackingSettings",
        "TrainingSettings", "VlmAccess",
    ),
    "trials": ("MarkerTrack", "Trial", "TrialSet", "load_reference", "save_reference"),
}  # fmt: skip
_PLACES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'swim2real' has no attribute '{name}'")
    return getattr(importlib.import_module(f"swim2real.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
