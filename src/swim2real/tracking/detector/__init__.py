"""The default tracker: markers found anew in every frame, by color, shape and place along the body."""

from swim2real.tracking.detector.detection import DetectionTracker

__all__ = ["DetectionTracker"]
