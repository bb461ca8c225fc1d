"""Motion of a swimmer's head about its path: the way that it has come, its sway and its yaw.

A beating tail pushes the head about. The body frame can't show it, since it stands on the head, and the world shows it
only together with the course. The path is what is left of the head's motion without its oscillation at the beat and the
beat's harmonic: a straight line, or a slow turn. Of the path's frame x points from head to tail, so that the swim goes
toward -x, as in the body frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from markertrack import frames
from swimbase.arrays import Array
from swimbase.errors import TrialError

_HARMONICS = 2  # of the beat that an oscillation is described by
_FEWEST_FRAMES = 12


class Oscillation(NamedTuple):
    """The fundamental of an oscillation at the frequency of the beat.

    Attributes:
        amplitude: Its amplitude [m or rad].
        phase: Phase at the first frame, of a cosine [rad].
        std: Standard error of the amplitude, from what the fit leaves unexplained [m or rad].
    """

    amplitude: float
    phase: float
    std: float


@dataclass(frozen=True)
class HeadMotion:
    """The head's motion about its path; NaN in frames in which it isn't seen.

    Attributes:
        progress: Way along the path, from where the path begins [m]. Shape (T,).
        sway: Deviation to the left of the path's x axis [m]. Shape (T,).
        yaw: Heading relative to the path, without its mean [rad]. Shape (T,).
        sway_beat: Sway at the frequency of the beat [m].
        yaw_beat: Yaw at the frequency of the beat [rad].
        turn_rate: Slow turn of the course, which is removed [rad/s].
        wander: RMS of the heading that neither the beat nor the slow turn explain [rad].
    """

    progress: Array
    sway: Array
    yaw: Array
    sway_beat: Oscillation
    yaw_beat: Oscillation
    turn_rate: float
    wander: float

    def until(self, count: int) -> HeadMotion:
        """The first frames; the oscillations stay those of the whole trial."""
        return replace(self, progress=self.progress[:count], sway=self.sway[:count], yaw=self.yaw[:count])

    @cached_property
    def axes(self) -> Array:
        """Unit vectors of the body frame's x axis in the frame of the path. Shape (T, 2)."""
        return np.column_stack([np.cos(self.yaw), np.sin(self.yaw)])

    @property
    def place(self) -> Array:
        """Position of the head in the frame of the path [m]. Shape (T, 2)."""
        return np.column_stack([-self.progress, self.sway])

    def to_path(self, body: Array) -> Array:
        """Positions in the body frame, in the frame of the path [m]. Shape (T, M, 2)."""
        return frames.composed(body - frames.heads(body)[:, None], self.axes[:, None]) + self.place[:, None]


def head_motion(times: Array, positions: Array, frequency: float) -> HeadMotion:
    """Divides the motion of a swimmer's head into its path and its recoil.

    The course turns at a constant rate, the slope of the heading beside the beat. Steps of the head are turned back by
    it and added up; the path's axis is the direction of the velocity that is left beside the beat. Of the way to the
    side a slow drift, quadratic in time, is taken off as well. A constant angle between the head and the path is no
    recoil: markers are placed by hand.

    Args:
        times: Time stamps [s]. Shape (T,).
        positions: Positions in the world [m]. Shape (T, M, 2).
        frequency: Frequency of the beat [Hz].

    Raises:
        TrialError: The head is seen for less than a beat, or in too few frames.
    """
    head, axes = frames.heads(positions), frames.body_axes(positions)
    seen = np.flatnonzero(np.isfinite(head).all(axis=1) & np.isfinite(axes).all(axis=1))
    _check_length(times[seen], frequency)
    t = times[seen] - times[0]
    slow = np.column_stack([np.ones_like(t), t])
    angles = 2 * np.pi * frequency * np.outer(t, np.arange(1, _HARMONICS + 1))
    beats = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(t), -1)
    heading = np.unwrap(np.arctan2(axes[seen, 1], axes[seen, 0]))
    turning = _Fit(np.column_stack([slow, beats]), heading)
    turn_rate = float(turning.coefficients[1])
    way = np.zeros((len(t), 2))
    back = np.column_stack([np.cos(turn_rate * t), np.sin(turn_rate * t)])
    way[1:] = np.cumsum(frames.components(np.diff(head[seen], axis=0), (back[1:] + back[:-1]) / 2), axis=0)
    velocity = _Fit(np.column_stack([slow, beats]), way).coefficients[1]
    backward = np.array([np.cos(turning.coefficients[0]), np.sin(turning.coefficients[0])])
    way = frames.components(way, _axis(velocity, backward))
    start = _Fit(np.column_stack([slow, beats]), way[:, 0]).coefficients[0]
    drifting = np.column_stack([slow, t**2])
    sideways = _Fit(np.column_stack([drifting, beats]), way[:, 1])

    def spread(values: Array) -> Array:
        every = np.full(len(times), np.nan)
        every[seen] = values
        return every

    return HeadMotion(
        progress=spread(start - way[:, 0]),
        sway=spread(way[:, 1] - drifting @ sideways.coefficients[:3]),
        yaw=spread(heading - slow @ turning.coefficients[:2]),
        sway_beat=sideways.oscillation(3),
        yaw_beat=turning.oscillation(2),
        turn_rate=turn_rate,
        wander=turning.rms,
    )


def _check_length(times: Array, frequency: float) -> None:
    if len(times) < _FEWEST_FRAMES:
        raise TrialError(
            f"its head is seen in {len(times)} frames, and protocol motion needs {_FEWEST_FRAMES}; mend the track, or "
            f"use protocol aligned"
        )
    if times[-1] - times[0] < 1 / frequency:
        raise TrialError(
            f"its head is seen for {times[-1] - times[0]:.2f} s, less than a beat of {1 / frequency:.2f} s; protocol "
            f"motion needs a whole beat, protocol aligned doesn't"
        )


def _axis(velocity: Array, backward: Array) -> Array:
    """Unit vector of the line of travel, the way that the tail points; the tail's own direction where nothing moves."""
    speed = np.linalg.norm(velocity)
    if not speed > 0:
        return backward
    return velocity / (speed if velocity @ backward >= 0 else -speed)


class _Fit:
    """A least-squares fit to one or more columns, with errors for residuals that hang together in time."""

    def __init__(self, basis: Array, values: Array) -> None:
        self.coefficients = np.linalg.lstsq(basis, values, rcond=None)[0].astype(float)
        self._basis, self._left = basis, values - basis @ self.coefficients

    @property
    def rms(self) -> float:
        """Root mean square of the part that the fit leaves unexplained."""
        return float(np.sqrt(np.square(self._left).mean()))

    def oscillation(self, column: int) -> Oscillation:
        """The cosine at a column of the basis and the sine after it."""
        (cosine, sine), (count, known) = self.coefficients[column : column + 2], self._basis.shape
        power = float(self._left @ self._left)
        memory = float(self._left[1:] @ self._left[:-1]) / power if power > 0 else 0.0
        memory = min(max(memory, 0.0), 0.99)  # of a residual that decays from frame to frame
        variance = power / max(count - known, 1) * (1 + memory) / (1 - memory)
        spread = np.linalg.pinv(self._basis.T @ self._basis)[column : column + 2, column : column + 2]
        amplitude = float(np.hypot(cosine, sine))
        along = np.array([cosine, sine]) / amplitude if amplitude > 0 else np.array([1.0, 0.0])
        std = float(np.sqrt(max(float(along @ spread @ along), 0.0) * variance))
        return Oscillation(amplitude, float(np.arctan2(-sine, cosine)), std)
