"""Trials: one swim at one frequency or one recording, real or simulated, with its time stamps."""

from markertrack.track import MarkerTrack
from swim2real.trials.reference import load_reference, save_reference
from swim2real.trials.signals import Signals
from swim2real.trials.trial import Actuation, Trial, TrialSet

__all__ = ["Actuation", "MarkerTrack", "Signals", "Trial", "TrialSet", "load_reference", "save_reference"]
