"""Real trials as they are compared: worked out once, not for every candidate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from markertrack import frames
from swim2real.objective.head import HeadMotion, head_motion
from swim2real.trials import Signals, Trial
from swimbase.arrays import Array, Mask
from swimbase.errors import TrialError, about

SHARPEST = np.deg2rad(10.0)  # RMS of a heading that neither the beat nor a slow turn explain


@dataclass(frozen=True)
class SensorTarget:
    """Real readings of a sensor that is compared.

    Attributes:
        name: Name of the sensor.
        meters_per_unit: Marker error that an error of one unit counts as [m/unit].
        times: Time stamps within the track [s]. Shape (R,).
        readings: Readings, NaN where nothing was read [unit]. Shape (R,).
    """

    name: str
    meters_per_unit: float
    times: Array
    readings: Array


@dataclass(frozen=True)
class Target:
    """The real side of a compared trial.

    Attributes:
        trial: The real trial.
        sample_times: Time stamps at which the simulated trial is read [s]. Shape (S,).
        times: The first of them, which are compared [s]. Shape (T,).
        weights: Weights, 0 where a marker doesn't count. Shape (T, M).
        real: Positions in the frame of comparison [m]. Shape (T, M, 2).
        path: Positions in the plane in which the path is drawn [m]. Shape (T, M, 2).
        frame: Indices of the markers that the frame of comparison stands on; None for the world.
        progress: Way along the line of travel [m]; None where it isn't scored. Shape (T,).
        velocity: Speed along it [m/s]; None where progress isn't scored.
        sensors: Sensors that are compared beside the markers.
        frequency: Frequency at which the simulated motor turns in a trial with a beat [Hz].
        beat_frequency: Frequency of the real beat [Hz]; None for the same.
        swim: Positions in the swim frame at all sample times [m]; None where there is none. Shape (S, M, 2).
        head: Motion of the head about its path, where it is compared; at the times that are compared.
    """

    trial: Trial
    sample_times: Array
    times: Array
    weights: Array
    real: Array
    path: Array
    frame: tuple[int, int] | None = None
    progress: Array | None = None
    velocity: float | None = None
    sensors: tuple[SensorTarget, ...] = ()
    frequency: float | None = None
    beat_frequency: float | None = None
    swim: Array | None = None
    head: HeadMotion | None = None

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.trial.name


def steady_target(
    trial: Trial, weights: Array, frequency: float, beat_frequency: float | None = None,
    horizon: float | None = None, whole_motion: bool = False,
) -> Target:  # fmt: skip
    """A steady swim, compared in the body frame. Its speed, its axis and its path are those of the whole trial.

    Args:
        trial: The real swim.
        weights: Weights, 0 where tracking lost a marker. Shape of the whole trial (S, M).
        frequency: Frequency at which the simulated motor turns [Hz].
        beat_frequency: Frequency of the real beat [Hz]; None for the same.
        horizon: Seconds that are compared, None for all.
        whole_motion: Whether the motion of the head about its path is compared as well.

    Raises:
        TrialError: The head's path can't be distinguished from its motion about it.
    """
    track = trial.track
    times, body = track.times - track.times[0], track.body
    kept = trial.cut(horizon).track.frame_count
    counted = np.where(np.isfinite(body).all(axis=2), weights, 0.0)[:kept]
    head = None
    if whole_motion:
        seen = np.where(framed(weights, frames.HEAD)[:, None, None], track.positions, np.nan)
        head = _path(trial.name, times, seen, beat_frequency or frequency).until(kept)
    return Target(
        trial, times, times[:kept], counted, body[:kept], track.course[:kept], frames.HEAD, track.progress[:kept],
        track.speed, (), frequency, beat_frequency, track.swim, head,
    )  # fmt: skip


def _path(name: str, times: Array, positions: Array, frequency: float) -> HeadMotion:
    """The motion of a real head about its path, if there is such a thing."""
    with about(f"trial '{name}'"):
        head = head_motion(times, positions, frequency)
    if head.wander > SHARPEST:
        raise TrialError(
            f"trial '{name}': its course turns sharply: beside the beat and a steady turn of "
            f"{np.rad2deg(head.turn_rate):.1f} deg/s its heading varies by {np.rad2deg(head.wander):.0f} deg, and "
            f"protocol motion allows {np.rad2deg(SHARPEST):.0f}; cut it to where it swims straight, or use protocol "
            f"aligned"
        )
    return head


def playback_target(
    trial: Trial, weights: Array, frame: tuple[int, int] | None = None, score_progress: bool = False,
    meters_per_unit: Mapping[str, float] | None = None,
) -> Target:  # fmt: skip
    """A recording, compared at its own time stamps in the world or in a frame on the robot.

    Args:
        trial: The recording, as long as it is compared.
        weights: Weights, 0 where tracking lost a marker. Shape (T, M).
        frame: Indices of the markers that the frame of comparison stands on; None for the world.
        score_progress: Whether the way along the frame's -x counts.
        meters_per_unit: Sensors that are compared, by name: marker error that an error of one unit counts as [m/unit].

    Raises:
        TrialError: A sensor has no readings within the track.
    """
    times, world = trial.track.times, trial.track.positions
    counted = np.where(np.isfinite(world).all(axis=2), weights, 0.0)
    progress = velocity = None
    real = world
    if frame is not None:
        counted = counted * framed(counted, frame)[:, None]  # without its frame no marker can be compared
        real = frames.to_body(world, frame)
        if score_progress:
            progress = framed_progress(times, world, counted, frame)
            velocity = frames.slope(times, progress)
    sensors = tuple(_sensor(trial, name, scale) for name, scale in (meters_per_unit or {}).items())
    return Target(trial, times, times, counted, real, world, frame, progress, velocity, sensors)


def framed(weights: Array, frame: tuple[int, int] | None) -> Mask:
    """Time stamps at which the markers of the frame of comparison count; all of them in the world. Shape (T,)."""
    return np.all(weights[:, frame or ()] > 0, axis=1)


def framed_progress(times: Array, world: Array, weights: Array, frame: tuple[int, int]) -> Array:
    """Way along the line of travel [m], NaN where the frame of comparison is lost. Shape (T,).

    Args:
        times: Time stamps [s]. Shape (T,).
        world: Positions, real or simulated [m]. Shape (T, M, 2).
        weights: Weights of the real markers. Shape (T, M).
        frame: Indices of the markers that the frame stands on.
    """
    return frames.progress(times, np.where(framed(weights, frame)[:, None, None], world, np.nan), frame)


def _sensor(trial: Trial, name: str, meters_per_unit: float) -> SensorTarget:
    """Readings of a sensor while the robot is filmed."""
    if trial.sensors is None:
        raise TrialError(
            f"trial '{trial.name}' has no sensors; add a table with a column '{name}', which is to be compared"
        )
    with about(f"trial '{trial.name}': sensor '{name}' can't be compared"):
        table: Signals = trial.sensors.between(trial.track.times[0], trial.track.times[-1])
        return SensorTarget(name, meters_per_unit, table.times, table.column(name))
