"""Calibration: the loop around an optimizer and a simulator, with its record."""

from swim2real.calibration.loop import Progress, calibrate
from swim2real.calibration.problem import HORIZON, Problem, RealTrial, examine
from swim2real.calibration.provenance import commit, reference_fingerprint, versions
from swim2real.calibration.run_folder import RunFolder

__all__ = [
    "HORIZON",
    "Problem",
    "Progress",
    "RealTrial",
    "RunFolder",
    "calibrate",
    "commit",
    "examine",
    "reference_fingerprint",
    "versions",
]
