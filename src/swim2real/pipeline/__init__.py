"""Composes the rooms, for the command line and for scripts: videos to trials, and a reference to a calibrated run."""

from swim2real.pipeline.calibration import as_replayed, calibrate
from swim2real.pipeline.methods import make_optimizer
from swim2real.pipeline.tracking import (
    AUTO,
    TRACKS,
    FrameProgress,
    TrackedVideo,
    TrackingReport,
    check_lost,
    track_video,
)
from swim2real.pipeline.tracking_many import track_videos

__all__ = [
    "AUTO",
    "TRACKS",
    "FrameProgress",
    "TrackedVideo",
    "TrackingReport",
    "as_replayed",
    "calibrate",
    "check_lost",
    "make_optimizer",
    "track_video",
    "track_videos",
]
