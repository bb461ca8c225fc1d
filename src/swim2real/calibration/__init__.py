"""Calibration: the loop around an optimizer and a simulator, with its record."""

from swim2real.calibration.file_models import Outcome, Verdict
from swim2real.calibration.loop import Progress, minimize
from swim2real.calibration.problem import Problem
from swim2real.calibration.protocols import RealSwim, examine_swims, protocol_for
from swim2real.calibration.provenance import made_by, reference_fingerprint, versions
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.run_settings import SEARCH, RunSettings
from swim2real.calibration.saved_trials import SavedTrial, conclude, load_trials
from swim2real.calibration.sensitivity import Sensitivity, Slopes, sensitivities
from swim2real.calibration.verdict import sizes_of

__all__ = [
    "SEARCH", "Outcome", "Problem", "Progress", "RealSwim", "RunFolder", "RunSettings", "SavedTrial",
    "Sensitivity", "Slopes", "Verdict", "conclude", "examine_swims", "load_trials", "made_by", "minimize",
    "protocol_for", "reference_fingerprint", "sensitivities", "sizes_of", "versions",
]  # fmt: skip
