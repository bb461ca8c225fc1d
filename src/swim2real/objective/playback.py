"""Recordings against their playback: markers at the same time stamps, and sensors, weighed against them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.objective.alignment import weighted_distance
from swim2real.objective.comparison import FAILED_LOSS, Comparison, Protocol
from swim2real.objective.windows import main_amplitudes, mean, windowed, windows
from swim2real.trials import Signals, Trial, frames

Array = NDArray[np.float64]

_NO_MEANS = ("loss", "velocity_real", "velocity_simulated", "divergence")


@dataclass(frozen=True)
class PlaybackTarget:
    """A recording as it is compared.

    Attributes:
        trial: Real, as long as it is compared.
        weights: 0 where tracking lost a marker. Shape (T, M).
        frame: Markers that the frame of comparison stands on; None for the world.
        travels: Whether the way along that frame's -x counts.
        worths: Of the sensors that are compared, by name: marker error that an error of one unit counts as [m/unit].
    """

    trial: Trial
    weights: Array
    frame: tuple[int, int] | None = None
    travels: bool = False
    worths: Mapping[str, float] = field(default_factory=dict[str, float])

    def readings(self, name: str) -> Signals:
        """Of a sensor, while the robot is filmed.

        Raises:
            TrialError: The trial hasn't any.
        """
        trial, track = self.trial, self.trial.track
        if trial.sensors is None:
            raise TrialError(
                f"trial '{trial.name}' has no sensors; add a table with a column '{name}', which is to be compared"
            )
        try:
            found = trial.sensors.between(track.times[0], track.times[-1])
            return Signals(found.times, (name,), found.column(name)[:, None])
        except TrialError as error:
            raise TrialError(f"trial '{trial.name}': sensor '{name}' can't be compared: {error}") from error


@dataclass(frozen=True)
class SensorComparison:
    """One sensor's readings, real and simulated, at the real ones' time stamps.

    Attributes:
        name: Of the sensor.
        worth: Marker error that an error of one unit counts as [m/unit].
        times: [s]. Shape (R,).
        real: NaN where nothing was read [unit]. Shape (R,).
        simulated: NaN everywhere when the simulation diverged [unit]. Shape (R,).
    """

    name: str
    worth: float
    times: Array
    real: Array
    simulated: Array

    @property
    def residual(self) -> Array:
        """Simulated minus real [unit]. Shape (R,)."""
        return self.simulated - self.real

    @cached_property
    def error(self) -> float:
        """Mean absolute difference [unit]."""
        known = np.isfinite(self.residual)
        return float(np.abs(self.residual[known]).mean()) if known.any() else float("nan")


@dataclass(frozen=True)
class PlaybackComparison:
    """One recording against its playback, at the real time stamps.

    Attributes:
        name: Of the trial.
        times: [s]. Shape (T,).
        weights: 0 where a marker doesn't count. Shape (T, M).
        world_real: [m]. Shape (T, M, 2).
        world_simulated: NaN everywhere when the simulation diverged [m]. Shape (T, M, 2).
        frame: Markers that the frame of comparison stands on; None for the world.
        travels: Whether the way along that frame's -x counts.
        sensors: That are compared, too.
        divergence: Why the simulation failed, or None.
    """

    name: str
    times: Array
    weights: Array
    world_real: Array
    world_simulated: Array
    frame: tuple[int, int] | None = None
    travels: bool = False
    sensors: tuple[SensorComparison, ...] = ()
    divergence: str | None = None

    @cached_property
    def real(self) -> Array:
        """In the frame of comparison [m]. Shape (T, M, 2)."""
        return self.world_real if self.frame is None else frames.to_body(self.world_real, self.frame)

    @cached_property
    def simulated(self) -> Array:
        """In the frame of comparison [m]. Shape (T, M, 2)."""
        return self.world_simulated if self.frame is None else frames.to_body(self.world_simulated, self.frame)

    @cached_property
    def progress_real(self) -> Array | None:
        """Along the line of travel, NaN where the frame is lost [m]; None if it doesn't travel. Shape (T,)."""
        return self._progress(self.world_real)

    @cached_property
    def progress_simulated(self) -> Array | None:
        """Likewise."""
        return self._progress(self.world_simulated)

    @cached_property
    def residual(self) -> Array:
        """Simulated minus real and, along x, how much farther the playback hasn't come [m]. Shape (T, M, 2)."""
        residual = self.simulated - self.real
        if self.progress_real is None or self.progress_simulated is None:
            return residual
        behind = self.progress_real - self.progress_simulated
        return residual + np.stack([behind, np.zeros_like(behind)], axis=1)[:, None]

    @cached_property
    def marker_error(self) -> float:
        """Weighted mean distance in the frame of comparison, difference in progress included [m]."""
        return FAILED_LOSS if self.divergence else weighted_distance(self.residual, self.weights)

    def loss(self, protocol: Protocol = "playback") -> float:
        """Marker error and what the sensors' errors are worth [m]."""
        if self.divergence:
            return FAILED_LOSS
        return self.marker_error + sum(sensor.worth * sensor.error for sensor in self.sensors)

    def residual_vector(self, protocol: Protocol = "playback") -> Array:
        """Markers, then each sensor; the squares add up to the mean square of each [m].

        Zero where nothing counts; the markers' part is of length `FAILED_LOSS` and the sensors' zero when the
        simulation diverged. Shape (2 T M + sensors' rows,).
        """
        share = self.weights / max(float(self.weights.sum()), 1e-12)
        counted = np.where(self.weights[:, :, None] > 0, self.residual, 0.0)
        vectors = np.full(self.world_real.shape, FAILED_LOSS / np.sqrt(2)) if self.divergence else counted
        parts = [(np.sqrt(share)[:, :, None] * vectors).ravel()]
        for sensor in self.sensors:
            known = np.isfinite(sensor.residual)
            parts.append(sensor.worth * np.where(known, sensor.residual, 0.0) / np.sqrt(max(known.sum(), 1)))
        return np.concatenate(parts)

    @property
    def means(self) -> tuple[str, ...]:
        return tuple(name for name in self.figures() if name not in _NO_MEANS)

    def figures(self) -> dict[str, Any]:
        """Every figure of the trial, in SI; what there isn't is absent, and NaN what a diverged one hasn't."""
        found: dict[str, Any] = {"marker_error": self.marker_error}
        if self.frame is not None:
            shape = FAILED_LOSS if self.divergence else weighted_distance(self.simulated - self.real, self.weights)
            found |= {"shape_error": shape, "heading_error": self._heading_error()}
        if self.progress_real is not None and self.progress_simulated is not None:
            real = frames.slope(self.times, self.progress_real)
            simulated = frames.slope(self.times, self.progress_simulated)
            found |= {
                "velocity_error": abs(simulated - real), "velocity_real": real, "velocity_simulated": simulated
            }  # fmt: skip
        if self.sensors:
            found["sensor_errors"] = {sensor.name: sensor.error for sensor in self.sensors}
        left_out = float(1 - np.mean(self.weights > 0))
        return {**found, "loss": self.loss(), "left_out_share": left_out, "divergence": self.divergence}

    def evidence(self) -> dict[str, Any]:
        """Per marker: mean error, amplitude along its main axis, mean offset, and residuals in windows of time.

        Residuals and offsets are simulated minus real [m]; `windows` holds when each begins and ends [s], the mean
        residual of each marker along both axes, and that of each sensor [unit]. None where nothing counts.
        """
        residual = np.where(self.weights[:, :, None] > 0, self.residual, np.nan)
        errors = mean(np.linalg.norm(residual, axis=2))
        edges = windows(self.times)
        return {
            "marker_errors": np.full_like(errors, FAILED_LOSS) if self.divergence else errors,
            "offset": mean(residual),
            "amplitude_real": main_amplitudes(self.real, self.weights),
            "amplitude_simulated": main_amplitudes(self.simulated, self.weights),
            "windows": {
                "edges": edges,
                "markers": windowed(self.times, residual, edges),
                "sensors": {one.name: windowed(one.times, one.residual, edges) for one in self.sensors},
            },
        }

    def _progress(self, world: Array) -> Array | None:
        if self.frame is None or not self.travels:
            return None
        if self.divergence and not np.isfinite(world).any():
            return np.full(len(world), np.nan)
        return frames.progress(self.times, np.where(self._framed[:, None, None], world, np.nan), self.frame)

    def _heading_error(self) -> float:
        """Mean absolute difference of the turn since the first frame [rad]."""
        if self.frame is None or self.divergence or not self._framed.any():
            return float("nan")
        turns: list[Array] = []
        for world in (self.world_real, self.world_simulated):
            axes = frames.body_axes(world[self._framed], self.frame)
            angles = np.unwrap(np.arctan2(axes[:, 1], axes[:, 0]))
            turns.append(angles - angles[0])
        return float(np.abs(turns[1] - turns[0]).mean())

    @cached_property
    def _framed(self) -> NDArray[np.bool_]:
        """Frames in which the frame of comparison stands on what was seen. Shape (T,)."""
        return np.all(self.weights[:, self.frame or ()] > 0, axis=1)


def compare_playback(target: PlaybackTarget, simulated: Trial) -> PlaybackComparison:
    """Compares a playback with its recording.

    Args:
        target: The recording.
        simulated: With its track at the recording's time stamps, and its sensors at those of the recording's sensors
            that lie within the track.

    Raises:
        TrialError: It is at other times.
    """
    trial, track = target.trial, target.trial.track
    if not np.array_equal(track.times, simulated.track.times):
        raise TrialError(f"trial '{simulated.name}': it wasn't simulated at the recording's time stamps")
    weights = np.where(np.isfinite(track.positions).all(axis=2), target.weights, 0.0)
    if target.frame is not None:  # without its frame no marker can be compared
        weights = weights * (weights[:, target.frame] > 0).all(axis=1, keepdims=True)
    return PlaybackComparison(
        trial.name, track.times, weights, track.positions, simulated.track.positions, target.frame, target.travels,
        tuple(_sensor(target, simulated, name) for name in target.worths),
        simulated.divergence,
    )  # fmt: skip


def _sensor(target: PlaybackTarget, simulated: Trial, name: str) -> SensorComparison:
    real = target.readings(name)
    readings = np.full(len(real.times), np.nan)
    if simulated.divergence is None:
        if simulated.sensors is None or not np.array_equal(simulated.sensors.times, real.times):
            raise TrialError(f"trial '{simulated.name}': its sensors weren't simulated at the recording's time stamps")
        readings = simulated.sensors.column(name)
    return SensorComparison(name, target.worths[name], real.times, real.column(name), readings)


def playbacks_of(comparison: Comparison) -> tuple[PlaybackComparison, ...]:
    """The trials of a comparison of recordings.

    Raises:
        TrialError: It compares something else.
    """
    found = tuple(trial for trial in comparison.trials if isinstance(trial, PlaybackComparison))
    if len(found) < len(comparison.trials):
        raise TrialError("this needs recordings, and the trials that are compared are swims")
    return found
