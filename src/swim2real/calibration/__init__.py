"""Calibration: the loop around an optimizer and a simulator, with its record."""

from swim2real.calibration.loop import Progress, calibrate
from swim2real.calibration.outcome import SwimPair, conclude, examined, load_swims
from swim2real.calibration.problem import HORIZON, Problem, RealTrial, examine
from swim2real.calibration.provenance import commit, reference_fingerprint, versions
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.sensitivity import Sensitivity, sensitivities

__all__ = [
    "HORIZON",
    "Problem",
    "Progress",
    "RealTrial",
    "RunFolder",
    "Sensitivity",
    "SwimPair",
    "calibrate",
    "commit",
    "conclude",
    "examine",
    "examined",
    "load_swims",
    "reference_fingerprint",
    "sensitivities",
    "versions",
]
