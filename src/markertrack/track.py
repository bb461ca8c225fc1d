"""The class that carries marker tracks: one for filmed and simulated markers alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markertrack import frames
from swimbase.arrays import Array, Mask
from swimbase.errors import TrialError


def _frozen(array: object) -> Array:
    copy = np.array(array, dtype=float)
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True)
class MarkerTrack:
    """Markers over time, in the plane of the water.

    Attributes:
        times: Time stamps, rising [s]. Shape (T,).
        positions: World positions, NaN where a marker was not seen [m]. Shape (T, M, 2).
        confidence: Confidence from 0 (lost) to 1, by frame and marker. Shape (T, M).
    """

    times: Array
    positions: Array
    confidence: Array

    def __init__(self, times: object, positions: object, confidence: object = None) -> None:
        stamps, points = _frozen(times), _frozen(positions)
        if points.ndim != 3 or points.shape[2] != 2 or points.shape[0] != stamps.size or stamps.ndim != 1:
            raise TrialError(
                f"positions have shape {points.shape} and times {stamps.shape}; expected (T, M, 2) and (T,)"
            )
        if stamps.size < 2:
            raise TrialError(f"a track needs at least 2 frames, this one has {stamps.size}")
        if not np.all(np.isfinite(stamps)) or not np.all(np.diff(stamps) > 0):
            raise TrialError("time stamps must be finite and rise from frame to frame")
        seen = np.isfinite(points).all(axis=2)
        given = np.ones(seen.shape) if confidence is None else np.array(confidence, dtype=float)
        if given.shape != seen.shape:
            raise TrialError(f"confidence has shape {given.shape}; expected (T, M) = {seen.shape}")
        if np.any((given < 0) | (given > 1)):
            raise TrialError("confidence must lie within 0 and 1")
        confidences = _frozen(np.where(seen, np.nan_to_num(given), 0.0))
        vars(self).update(times=stamps, positions=points, confidence=confidences)

    @classmethod
    def without_markers(cls, times: Array) -> MarkerTrack:
        """A track of nothing but time stamps, of a trial that wasn't filmed."""
        return cls(times, np.zeros((len(times), 0, 2)))

    def frames(self, kept: slice | Mask | list[bool]) -> MarkerTrack:
        """Some of its frames, by a slice or a mask."""
        return MarkerTrack(self.times[kept], self.positions[kept], self.confidence[kept])

    @property
    def frame_count(self) -> int:
        return int(self.times.size)

    @property
    def marker_count(self) -> int:
        return int(self.positions.shape[1])

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def heads(self) -> Array:
        """Mean of the first two markers [m]. Shape (T, 2)."""
        return frames.heads(self.positions)

    @property
    def body(self) -> Array:
        """Positions in the body frame: origin at marker 0, x toward marker 1 [m]. Shape (T, M, 2)."""
        return frames.to_body(self.positions)

    @property
    def swim(self) -> Array:
        """Positions in the swim frame, as far as the fish has come [m]. Shape (T, M, 2)."""
        return frames.to_swim(self.positions)

    @property
    def course(self) -> Array:
        """Positions in the world, turned so that the swim goes toward -x from the origin [m]. Shape (T, M, 2)."""
        return frames.to_course(self.times, self.positions)

    @property
    def progress(self) -> Array:
        """Displacement of the head along the swimming axis since the first frame [m]. Shape (T,)."""
        return frames.progress(self.times, self.positions)

    @property
    def speed(self) -> float:
        """Slope of a straight-line fit to the progress [m/s]."""
        return frames.slope(self.times, self.progress)
