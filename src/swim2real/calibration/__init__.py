"""Calibration: the loop around an optimizer and a simulator, with its record."""

from swim2real.calibration.loop import Progress, calibrate
from swim2real.calibration.outcome import conclude
from swim2real.calibration.playback_problem import PlaybackProblem
from swim2real.calibration.posing import pose_problem, protocol_for
from swim2real.calibration.problem import Problem
from swim2real.calibration.provenance import commit, reference_fingerprint, versions
from swim2real.calibration.recording_pairs import RecordingPair, load_recordings
from swim2real.calibration.run_folder import RunFolder
from swim2real.calibration.sensitivity import Sensitivity, sensitivities
from swim2real.calibration.swim_pairs import SwimPair, load_swims
from swim2real.calibration.swim_problem import RealTrial, SwimProblem, examine, examined

__all__ = [
    "PlaybackProblem",
    "Problem",
    "Progress",
    "RealTrial",
    "RecordingPair",
    "RunFolder",
    "Sensitivity",
    "SwimPair",
    "SwimProblem",
    "calibrate",
    "commit",
    "conclude",
    "examine",
    "examined",
    "load_recordings",
    "load_swims",
    "pose_problem",
    "protocol_for",
    "reference_fingerprint",
    "sensitivities",
    "versions",
]
