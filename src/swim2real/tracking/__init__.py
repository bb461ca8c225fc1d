"""From what a camera saw to what can be trusted: track quality and what drove a trial."""

from swim2real.tracking.beat import Beat, identify_beat
from swim2real.tracking.quality import (
    LostMarkers,
    TrackQuality,
    check_bodies,
    check_plausible,
    check_track,
    doubled_rate,
)

__all__ = [
    "Beat",
    "LostMarkers",
    "TrackQuality",
    "check_bodies",
    "check_plausible",
    "check_track",
    "doubled_rate",
    "identify_beat",
]
