"""Composes the rooms, for the command line and for scripts: videos to trials, and a reference to a calibrated run."""

from swim2real.pipeline.calibration import as_replayed, calibrate
from swim2real.pipeline.importing import Imported, export_tracks, import_recording, import_tracks
from swim2real.pipeline.methods import make_optimizer
from swim2real.pipeline.tracking import TRACKS, TrackedVideo, TrackingReport, track_video
from swim2real.pipeline.tracking_many import track_videos

__all__ = [
    "TRACKS", "Imported", "TrackedVideo", "TrackingReport", "as_replayed", "calibrate", "export_tracks",
    "import_recording", "import_tracks", "make_optimizer", "track_video", "track_videos",
]  # fmt: skip
