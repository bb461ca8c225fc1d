"""Simulated swims against real ones: at an aligned phase, markers registered, in frames that forget the place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from swim2real.errors import TrialError
from swim2real.objective.alignment import align, register, weighted_distance
from swim2real.objective.comparison import FAILED_LOSS, Comparison, Protocol
from swim2real.trials import MarkerTrack, Trial, TrialSet

Array = NDArray[np.float64]

MEANS = (
    "marker_error",
    "aligned_marker_error",
    "shape_error",
    "progress_error",
    "static_offset",
    "velocity_error",
    "left_out_share",
    "unweighted_error",
)


@dataclass(frozen=True)
class Target:
    """A real trial as it is compared: the whole swim, and which marker-frames count.

    Attributes:
        trial: Real.
        weights: 0 where tracking lost a marker. Shape (T, M).
        frequency: At which the simulated swim is driven [Hz].
        beat_frequency: At which the real one beats [Hz]; None for the same.
    """

    trial: Trial
    weights: Array
    frequency: float
    beat_frequency: float | None = None


@dataclass(frozen=True)
class TrialComparison:
    """One simulated swim against its real one, at the real time stamps.

    Attributes:
        name: Of the trial.
        frequency: Of the simulated motor [Hz].
        times: Since the first frame, within the horizon [s]. Shape (T,).
        weights: Shape (T, M).
        real: Body frame [m]. Shape (T, M, 2).
        simulated: Body frame, at the aligned phase, without registration [m]. Shape (T, M, 2).
        registration: Real minus simulated, static; zero under the paper's protocol [m]. Shape (M, 2).
        progress_real: Along the swimming axis [m]. Shape (T,).
        progress_simulated: Likewise. Shape (T,).
        swim_residual: Simulated minus real in the swim frame [m]. Shape (T, M, 2).
        course_real: In the world, turned so that the swim goes toward -x [m]. Shape (T, M, 2).
        course_simulated: Likewise, from the same time on. Shape (T, M, 2).
        phase: Motor angle at the first frame [rad]; 0 under the paper's protocol.
        velocity_real: Over the whole trial [m/s].
        velocity_simulated: Over the same time, negative when it swims tail first [m/s].
        static_offset: Mean length of the registration vectors, whether used or not [m].
        divergence: Why the simulation failed, or None.
        beat_frequency: Of the real beat [Hz]; None for that of the simulated motor.
    """

    name: str
    frequency: float
    times: Array
    weights: Array
    real: Array
    simulated: Array
    registration: Array
    progress_real: Array
    progress_simulated: Array
    swim_residual: Array
    course_real: Array
    course_simulated: Array
    phase: float
    velocity_real: float
    velocity_simulated: float
    static_offset: float
    divergence: str | None = None
    beat_frequency: float | None = None

    @cached_property
    def shape_residual(self) -> Array:
        """Simulated minus real in the body frame, registered [m]. Shape (T, M, 2)."""
        return self.simulated + self.registration - self.real

    @cached_property
    def residual(self) -> Array:
        """The shape residual and, along x, how much farther the simulation hasn't come [m]. Shape (T, M, 2)."""
        # the swimmer moves toward -x of its body frame
        behind = self.progress_real - self.progress_simulated
        return self.shape_residual + np.stack([behind, np.zeros_like(behind)], axis=1)[:, None]

    @property
    def _failed(self) -> bool:
        return self.divergence is not None

    @cached_property
    def marker_error(self) -> float:
        return FAILED_LOSS if self._failed else float(np.nanmean(np.linalg.norm(self.swim_residual, axis=2)))

    @cached_property
    def aligned_marker_error(self) -> float:
        return FAILED_LOSS if self._failed else weighted_distance(self.residual, self.weights)

    @cached_property
    def shape_error(self) -> float:
        return FAILED_LOSS if self._failed else weighted_distance(self.shape_residual, self.weights)

    @cached_property
    def progress_error(self) -> float:
        """Mean difference in progress: what thrust and drag explain [m]."""
        return FAILED_LOSS if self._failed else float(np.nanmean(np.abs(self.progress_simulated - self.progress_real)))

    @cached_property
    def unweighted_error(self) -> float:
        """The aligned error if lost tracks counted [m]."""
        seen = np.isfinite(self.residual).all(axis=2).astype(float)
        return FAILED_LOSS if self._failed else weighted_distance(self.residual, seen)

    def residual_vector(self, protocol: Protocol) -> Array:
        """What the loss is the mean length of, weighted such that the squares add up to their mean [m].

        Zero where nothing counts; of length `FAILED_LOSS` when the simulation diverged. Shape (2 T M,).
        """
        aligned = protocol == "aligned"
        residual = self.residual if aligned else self.swim_residual
        known = np.isfinite(residual).all(axis=2)
        weights = np.where(known, self.weights, 0.0) if aligned else known.astype(float)
        share = weights / max(float(weights.sum()), 1e-12)
        vectors = np.full(residual.shape, FAILED_LOSS / np.sqrt(2)) if self._failed else np.nan_to_num(residual)
        return (np.sqrt(share)[:, :, None] * vectors).ravel()

    def loss(self, protocol: Protocol) -> float:
        """What the trial adds to the loss, before the mean [m]."""
        return self.aligned_marker_error if protocol == "aligned" else self.marker_error

    @property
    def left_out_share(self) -> float:
        return float(1 - np.mean(self.weights > 0))

    def marker_errors(self, kind: Literal["marker", "aligned", "shape"]) -> Array:
        """One figure a marker [m], NaN for a marker that never counts. Shape (M,)."""
        if self._failed:
            return np.full(self.weights.shape[1], FAILED_LOSS)
        residual = {"marker": self.swim_residual, "aligned": self.residual, "shape": self.shape_residual}[kind]
        lengths = np.linalg.norm(residual, axis=2)
        weights = np.isfinite(lengths).astype(float) if kind == "marker" else self.weights
        total = weights.sum(axis=0)
        summed = np.where(weights > 0, lengths, 0.0).sum(axis=0, where=weights > 0)
        return np.where(total > 0, summed / np.where(total > 0, total, 1.0), np.nan)

    def figures(self) -> dict[str, Any]:
        """Every figure of the trial, in SI."""
        return {
            "marker_error": self.marker_error,
            "aligned_marker_error": self.aligned_marker_error,
            "shape_error": self.shape_error,
            "progress_error": self.progress_error,
            "static_offset": self.static_offset,
            "velocity_error": abs(self.velocity_simulated - self.velocity_real),
            "left_out_share": self.left_out_share,
            "unweighted_error": self.unweighted_error,
            "frequency": self.frequency,
            "phase": self.phase,
            "velocity_real": self.velocity_real,
            "velocity_simulated": self.velocity_simulated,
            "divergence": self.divergence,
        }

    @property
    def means(self) -> tuple[str, ...]:
        return MEANS

    def evidence(self) -> dict[str, Any]:
        """Errors of each marker, and the beat of each, real and simulated, as `beat` gives it."""
        return {
            "marker_errors": self.marker_errors("marker"),
            "aligned_marker_errors": self.marker_errors("aligned"),
            "shape_marker_errors": self.marker_errors("shape"),
            "beat_real": beat(self, self.real, self.beat_frequency or self.frequency),
            "beat_simulated": beat(self, self.simulated, self.frequency),
        }


def compare(targets: Sequence[Target], simulated: TrialSet, protocol: Protocol, horizon: float | None) -> Comparison:
    """Compares simulated swims with real ones.

    Args:
        targets: Real trials.
        simulated: One trial a target, in the same order, starting at motor angle 0. Under the aligned protocol each
            covers its target's duration and one period more.
        protocol: `aligned`: phase, registration and weights. `paper`: none of them.
        horizon: Seconds to compare, None for all.
    """
    pairs = zip(targets, simulated, strict=True)
    return Comparison(tuple(compare_trial(t, s, protocol, horizon) for t, s in pairs), protocol, horizon)


def compare_trial(target: Target, simulated: Trial, protocol: Protocol, horizon: float | None) -> TrialComparison:
    """One trial of `compare`."""
    track = target.trial.track
    times = track.times - track.times[0]
    kept = target.trial.cut(horizon).track.frame_count
    real = track.body
    weights = np.where(np.isfinite(real).all(axis=2), target.weights, 0.0)[:kept]
    if simulated.divergence is not None:
        nothing = np.zeros_like(real[:kept])
        return TrialComparison(
            target.trial.name, target.frequency, times[:kept], weights, real[:kept], nothing, nothing[0],
            track.progress[:kept], np.zeros(kept), nothing, track.course[:kept], nothing, 0.0, track.speed, 0.0, 0.0,
            simulated.divergence, target.beat_frequency,
        )  # fmt: skip
    lead = 1 / target.frequency if protocol == "aligned" else 0.0
    sim_times = simulated.track.times - simulated.track.times[0]
    if sim_times[-1] + 1e-6 < times[-1] + lead:
        raise TrialError(
            f"trial '{simulated.name}': simulated for {sim_times[-1]:.2f} s, {times[-1] + lead:.2f} s are compared"
        )
    shift, registration = 0.0, np.zeros(real.shape[1:])
    if protocol == "aligned":
        body = CubicSpline(sim_times, simulated.track.body.reshape(len(sim_times), -1))
        alignment = align(
            lambda t: body(t).reshape(len(t), *real.shape[1:]), real[:kept], times[:kept], weights, 1 / target.frequency
        )
        shift, registration = alignment.shift, alignment.registration
    positions = CubicSpline(sim_times, simulated.track.positions)(times + shift)
    sampled = MarkerTrack(times, positions)
    body_real, body_simulated = real[:kept], sampled.body[:kept]
    offsets = registration if protocol == "aligned" else register(body_real - body_simulated, weights)
    return TrialComparison(
        name=target.trial.name,
        frequency=target.frequency,
        times=times[:kept],
        weights=weights,
        real=body_real,
        simulated=body_simulated,
        registration=registration,
        progress_real=track.progress[:kept],
        progress_simulated=sampled.progress[:kept],
        swim_residual=(sampled.swim - track.swim)[:kept],
        course_real=track.course[:kept],
        course_simulated=sampled.course[:kept],
        phase=2 * np.pi * target.frequency * shift,
        velocity_real=track.speed,
        velocity_simulated=sampled.speed,
        static_offset=float(np.linalg.norm(offsets, axis=1).mean()),
        beat_frequency=target.beat_frequency,
    )


def beat(trial: TrialComparison, positions: Array, frequency: float) -> dict[str, Array]:
    """Amplitude [m], phase [rad] and mean [m] of each marker's sideways motion at a frequency [Hz].

    It is the fundamental of the motion in the body frame: the phase is relative to the motor, the mean before
    registration. Each of shape (M,).
    """
    angles = 2 * np.pi * frequency * trial.times
    basis = np.column_stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    count = positions.shape[1]
    out = np.full((3, count), np.nan)
    for m in range(count):
        good = trial.weights[:, m] > 0
        if np.count_nonzero(good) > 8:
            out[:, m] = np.linalg.lstsq(basis[good], positions[good, m, 1], rcond=None)[0]
    mean, cosine, sine = out
    return {"amplitude": np.hypot(cosine, sine), "phase": np.arctan2(-sine, cosine), "mean": mean}


def swims_of(comparison: Comparison) -> tuple[TrialComparison, ...]:
    """The trials of a comparison of swims.

    Raises:
        TrialError: It compares something else.
    """
    found = tuple(trial for trial in comparison.trials if isinstance(trial, TrialComparison))
    if len(found) < len(comparison.trials):
        raise TrialError("this needs swims, and the trials that are compared are recordings")
    return found
