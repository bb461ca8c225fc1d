"""Composes the rooms, for the command line and for scripts: videos to trials, and a reference to a calibrated run."""

from swim2real.pipeline.calibration import run
from swim2real.pipeline.methods import make_optimizer
from swim2real.pipeline.tracking import TRACKS, Filmed, FrameProgress, check_lost, track_film
from swim2real.pipeline.tracking_many import track_films

__all__ = [
    "TRACKS",
    "Filmed",
    "FrameProgress",
    "check_lost",
    "make_optimizer",
    "run",
    "track_film",
    "track_films",
]
