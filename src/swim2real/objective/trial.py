"""One simulated trial against its real one: residuals, figures, and the evidence that an advisor judges by.

There is one class for every kind of trial, with a part for each thing that only some of them have: a beat, a way that
it has come, a head that moves about its path, sensors. Figures in SI.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from markertrack import frames
from swim2real.objective.alignment import weighted_distance
from swim2real.objective.head import HeadMotion, Oscillation
from swim2real.objective.motion import beat, finite_mean, main_amplitudes, windowed_means, windows
from swim2real.objective.target import framed
from swimbase.arrays import Array, Mask

LossFigure = Literal["motion_error", "aligned_marker_error", "marker_error"]

FAILED_LOSS = 1.0  # m, the loss of a simulation that diverged: finite and of physical size
PROGRESS_SCALE = 0.01  # m, of a difference in progress; beyond it only its logarithm counts in a search's middle stage
_TURNING = 0.1  # of its yaw: a swim that turns by as much in a beat counts half where straight ones lead
LEAST_DISTANCE = 1e-3  # m, below which a distance counts by its square in a search's last stage
TAIL_FIRST_LOSS = 0.5  # m, more than the loss of anything that goes forward, whatever it is


@dataclass(frozen=True)
class ComparedSensor:
    """One sensor's readings, real and simulated, at the real ones' time stamps.

    Attributes:
        name: Name of the sensor.
        meters_per_unit: Marker error that an error of one unit counts as [m/unit].
        times: Time stamps [s]. Shape (R,).
        real: Real readings, NaN where nothing was read [unit]. Shape (R,).
        simulated: Simulated readings, NaN everywhere when the simulation diverged [unit]. Shape (R,).
    """

    name: str
    meters_per_unit: float
    times: Array
    real: Array
    simulated: Array

    @property
    def residual(self) -> Array:
        """Simulated minus real [unit]. Shape (R,)."""
        return self.simulated - self.real

    @cached_property
    def error(self) -> float:
        """Mean absolute difference [unit]; NaN where nothing is known."""
        known = np.isfinite(self.residual)
        return float(np.abs(self.residual[known]).mean()) if known.any() else float("nan")


@dataclass(frozen=True)
class ComparedBeat:
    """Data that only steady swims have.

    Attributes:
        frequency: Frequency of the simulated motor [Hz].
        real_frequency: Frequency of the real beat [Hz].
        phase: Motor angle at the first frame [rad].
        static_offset: Mean length of the registration vectors, whether they are used or not [m].
        swim_residual: Simulated minus real in the swim frame [m]. Shape (T, M, 2).
    """

    frequency: float
    real_frequency: float
    phase: float
    static_offset: float
    swim_residual: Array


@dataclass(frozen=True)
class ComparedProgress:
    """The way along the line of travel, of a trial that is scored by it.

    Attributes:
        real: Real way [m]. Shape (T,).
        simulated: Simulated way [m]. Shape (T,).
        velocity_real: Real speed along the line of travel [m/s].
        velocity_simulated: Simulated speed, negative when it goes tail first [m/s].
        first_beats: Simulated speed over the first two beats from rest [m/s]; None for another start. As the parameters
            change it passes smoothly through about 0 where the settled swim jumps from head first to tail first.
    """

    real: Array
    simulated: Array
    velocity_real: float
    velocity_simulated: float
    first_beats: float | None = None


@dataclass(frozen=True)
class ComparedHead:
    """The motion of the head about its path, where the whole motion is compared.

    Attributes:
        real: Real motion.
        simulated: Simulated motion; None when the simulation diverged.
    """

    real: HeadMotion
    simulated: HeadMotion | None = None

    def figures(self) -> dict[str, float]:
        """Figures of yaw, sway and turn; those of the simulated head are NaN when the simulation diverged."""
        figures: dict[str, float] = {}
        nothing = Oscillation(float("nan"), float("nan"), float("nan"))
        for name in ("yaw", "sway"):
            real: Oscillation = getattr(self.real, f"{name}_beat")
            simulated: Oscillation = getattr(self.simulated, f"{name}_beat", nothing)
            figures[f"{name}_error"] = abs(simulated.amplitude - real.amplitude)
            figures[f"{name}_real"], figures[f"{name}_simulated"] = real.amplitude, simulated.amplitude
            figures[f"{name}_real_std"], figures[f"{name}_simulated_std"] = real.std, simulated.std
            figures[f"{name}_lag"] = float(np.angle(np.exp(1j * (simulated.phase - real.phase))))
        figures["turn_rate_real"] = self.real.turn_rate
        figures["turn_rate_simulated"] = getattr(self.simulated, "turn_rate", float("nan"))
        return figures


@dataclass(frozen=True)
class ComparedTrial:
    """One simulated trial against its real one, at the real time stamps that are compared.

    Simulated positions are NaN everywhere when the simulation diverged.

    Attributes:
        name: Name of the trial.
        loss_figure: The figure that is the loss, apart from sensors.
        times: Time stamps [s]. Shape (T,).
        weights: Weights, 0 where a marker doesn't count. Shape (T, M).
        real: Real positions in the frame of comparison [m]. Shape (T, M, 2).
        simulated: Simulated positions in the frame of comparison, in phase, before registration [m]. Shape (T, M, 2).
        registration: Real minus simulated, static, 0 where nothing is registered [m]. Shape (M, 2).
        path_real: Real positions in the plane in which its path is drawn: the world, of steady swims turned so that
            the swim goes toward -x [m]. Shape (T, M, 2).
        path_simulated: Simulated positions in the same plane [m]. Shape (T, M, 2).
        frame: Indices of the markers that the frame of comparison stands on; None for the world.
        sensors: Sensors that are compared beside the markers.
        divergence: Why the simulation failed, or None.
        beat: Its beat, of a steady swim.
        progress: The way that it has come, where the trial is scored by it.
        head: Motion of the head about its path, where it is compared.
    """

    name: str
    loss_figure: LossFigure
    times: Array
    weights: Array
    real: Array
    simulated: Array
    registration: Array
    path_real: Array
    path_simulated: Array
    frame: tuple[int, int] | None = None
    sensors: tuple[ComparedSensor, ...] = ()
    divergence: str | None = None
    beat: ComparedBeat | None = None
    progress: ComparedProgress | None = None
    head: ComparedHead | None = None

    @property
    def frequency(self) -> float | None:
        """Frequency of the simulated motor [Hz]; None without a beat."""
        return None if self.beat is None else self.beat.frequency

    @cached_property
    def shape_residual(self) -> Array:
        """Simulated minus real in the frame of comparison, registered [m]. Shape (T, M, 2)."""
        return self.simulated + self.registration - self.real

    @cached_property
    def residual(self) -> Array:
        """Shape residual plus the lag in progress along x [m]. Shape (T, M, 2)."""
        if self.progress is None:
            return self.shape_residual
        behind = self.progress.real - self.progress.simulated  # a robot moves toward -x of its frame
        return self.shape_residual + np.stack([behind, np.zeros_like(behind)], axis=1)[:, None]

    @cached_property
    def motion_residual(self) -> Array:
        """Simulated minus real in the frame of the path, registered [m]; NaN without one. Shape (T, M, 2).

        It is the sum of the shape residual, turned by the simulated yaw, of the recoil residual, and of the difference
        in progress. The registration turns with the body.
        """
        if self.head is None or self.head.simulated is None:
            return np.full_like(self.real, np.nan)
        return self.head.simulated.to_path(self.simulated + self.registration) - self.head.real.to_path(self.real)

    @cached_property
    def recoil_residual(self) -> Array:
        """Real markers moved by the difference in yaw and sway alone [m]; NaN without a path. (T, M, 2)."""
        if self.head is None or self.head.simulated is None:
            return np.full_like(self.real, np.nan)
        swayed = replace(self.head.simulated, progress=self.head.real.progress)
        return swayed.to_path(self.real) - self.head.real.to_path(self.real)

    @property
    def tail_first(self) -> bool:
        """True if a trial whose whole motion is compared is simulated tail first."""
        return self._backward > 0

    @property
    def _backward(self) -> float:
        """Speed at which a trial whose whole motion is compared is simulated tail first [m/s]; 0 where it isn't."""
        if self.head is None or self.head.simulated is None or self.progress is None:
            return 0.0
        return max(-self.progress.velocity_simulated, 0.0)

    @property
    def loss(self) -> float:
        """Part of the trial in the loss, before the mean over trials [m]; never negative.

        Where the whole motion is compared, the mean way that the simulation goes tail first is added once more.
        """
        if self.divergence is not None:
            return FAILED_LOSS
        markers: float = getattr(self, self.loss_figure)
        if self.tail_first:
            markers += self._backward * float(self.times[-1] - self.times[0]) / 2
        return markers + sum(sensor.meters_per_unit * sensor.error for sensor in self.sensors)

    def residual_vector(self) -> Array:
        """Residuals of the markers, then of each sensor, weighted such that the squares add up to mean squares [m].

        Zero where nothing counts. When the simulation diverged the markers' part is of length `FAILED_LOSS` and the
        sensors' part zero. Shape (2 T M + sensors' rows,), the same for every candidate.
        """
        return np.concatenate([self._weighted(*self._scored), *self._sensor_residuals()])

    @property
    def _scored(self) -> tuple[Array, Array]:
        """Residual (T, M, 2) and weights (T, M) of the markers whose weighted mean distance is the loss [m]."""
        if self.loss_figure == "motion_error":
            return self.motion_residual, self.weights
        if self.loss_figure == "marker_error" and self.beat is not None:
            return self.beat.swim_residual, np.ones_like(self.weights)
        return self.residual, self.weights

    def residual_stages(self) -> tuple[tuple[Array, Array], ...]:
        """The residual in the stages in which a search lowers it best [m], each with the weights that it has here.

        Where progress is scored: what is without it, shape and recoil, which change smoothly whichever way the robot
        goes; this and the difference in progress, weighted such that its length q counts as `PROGRESS_SCALE`
        log(1 + q / `PROGRESS_SCALE`), so that a trial that goes the wrong way hides nothing else. Then, for every
        trial, the residual vector, and the same weighted such that its squares add up to the trial's loss, as long as
        it isn't tail first. Sensors are in all of them.
        """
        whole = self.residual_vector()
        ends = ((whole, np.ones_like(whole)), (whole, self._root_weights(whole)))
        if self.progress is None or self.loss_figure == "marker_error":
            return ends
        recoil = [] if self.head is None else [self._weighted(self.recoil_residual, self.weights)]
        body = np.concatenate([self._weighted(self.shape_residual, self.weights), *recoil, *self._sensor_residuals()])
        behind = self.progress.real - self.progress.simulated
        along = self._weighted(behind[:, None, None], self.weights.sum(axis=1, keepdims=True))
        length = float(np.linalg.norm(along))
        easing = PROGRESS_SCALE / length * np.log1p(length / PROGRESS_SCALE) if length > 0 else 1.0
        weights = np.concatenate([np.ones_like(body), np.full_like(along, easing)])
        return (body, np.ones_like(body)), (np.concatenate([body, along]), weights), *ends

    @property
    def straightness(self) -> float:
        """Weight of a trial by how little of its yaw it turns in a beat; 1 where that isn't known."""
        if self.head is None or self.frequency is None:
            return 1.0
        turn = abs(self.head.real.turn_rate) / self.frequency
        return 1 / (1 + (turn / (_TURNING * self.head.real.yaw_beat.amplitude)) ** 2)

    def residual_parts(self) -> list[tuple[str, int]]:
        """Part and number of entries of what follows one another in the stage before the last two, or in the first."""
        sensors = [(sensor.name, len(sensor.times)) for sensor in self.sensors]
        if self.progress is None or self.loss_figure == "marker_error":
            return [("markers", 2 * self.weights.size), *sensors]
        recoil = [] if self.head is None else [("recoil", 2 * self.weights.size)]
        return [("shape", 2 * self.weights.size), *recoil, *sensors, ("progress", len(self.times))]

    def _root_weights(self, whole: Array) -> Array:
        """Weights of the residual vector with which its squares add up to mean distances."""
        markers = 2 * self.weights.size
        lengths = np.repeat(np.sqrt(np.square(whole[:markers].reshape(-1, 2)).sum(axis=1)), 2)
        lengths = np.concatenate([lengths, np.abs(whole[markers:])])
        known = [np.isfinite(sensor.residual).sum() for sensor in self.sensors]
        shares = [np.repeat(self._shares(*self._scored).ravel(), 2)]
        shares += [np.full(len(one.times), 1 / max(count, 1)) for one, count in zip(self.sensors, known, strict=True)]
        distances = lengths / np.sqrt(np.maximum(np.concatenate(shares), 1e-30))
        return 1 / np.sqrt(np.maximum(distances, LEAST_DISTANCE))

    def _weighted(self, residual: Array, weights: Array) -> Array:
        """Distances of the markers in a row, weighted such that the squares add up to the mean square [m]."""
        failed = np.full(residual.shape, FAILED_LOSS / np.sqrt(2))
        vectors = np.nan_to_num(residual) if self.divergence is None else failed
        return (np.sqrt(self._shares(residual, weights))[:, :, None] * vectors).ravel()

    def _shares(self, residual: Array, weights: Array) -> Array:
        """Share of each marker and frame in a weighted mean over what is known. Shape (T, M)."""
        if self.divergence is None:
            weights = np.where(np.isfinite(residual).all(axis=2), weights, 0.0)
        return weights / max(float(weights.sum()), 1e-12)

    def _sensor_residuals(self) -> list[Array]:
        """Residuals of each sensor, weighted in the same way [m]."""
        parts: list[Array] = []
        for sensor in self.sensors:
            known = np.isfinite(sensor.residual)
            readings = np.where(known, sensor.residual, 0.0)
            parts.append(sensor.meters_per_unit * readings / np.sqrt(max(known.sum(), 1)))
        return parts

    @cached_property
    def marker_error(self) -> float:
        """The paper's Eq. 1 [m]: mean distance in the swim frame, without registration and weights.

        NaN where there is no swim frame.
        """
        if self.divergence is not None:
            return FAILED_LOSS
        if self.beat is None:
            return float("nan")
        return float(np.nanmean(np.linalg.norm(self.beat.swim_residual, axis=2)))

    @cached_property
    def motion_error(self) -> float:
        """Weighted mean distance in the frame of the path, registered: shape, recoil and progress together [m]."""
        return self._distance(self.motion_residual, self.weights)

    @cached_property
    def recoil_error(self) -> float:
        """Weighted mean distance that differences in yaw and sway make [m]."""
        return self._distance(self.recoil_residual, self.weights)

    @cached_property
    def aligned_marker_error(self) -> float:
        """Weighted mean distance in the frame of comparison, registered, difference in progress included [m]."""
        return self._distance(self.residual, self.weights)

    @cached_property
    def shape_error(self) -> float:
        """The same without the difference in progress [m]."""
        return self._distance(self.shape_residual, self.weights)

    @cached_property
    def unweighted_error(self) -> float:
        """The aligned error if lost markers counted [m]."""
        return self._distance(self.residual, np.isfinite(self.residual).all(axis=2).astype(float))

    @cached_property
    def progress_error(self) -> float:
        """Mean difference in progress, which thrust and drag explain [m]; NaN where progress isn't scored."""
        if self.progress is None:
            return float("nan")
        if self.divergence is not None:
            return FAILED_LOSS
        return float(np.nanmean(np.abs(self.progress.simulated - self.progress.real)))

    @cached_property
    def heading_error(self) -> float:
        """Mean absolute difference of the turn since the first frame [rad]; NaN without a frame of comparison."""
        if self.frame is None or self.divergence is not None or not self.framed.any():
            return float("nan")
        turns: list[Array] = []
        for path in (self.path_real, self.path_simulated):
            axes = frames.body_axes(path[self.framed], self.frame)
            angles = np.unwrap(np.arctan2(axes[:, 1], axes[:, 0]))
            turns.append(angles - angles[0])
        return float(np.abs(turns[1] - turns[0]).mean())

    @property
    def framed(self) -> Mask:
        """Time stamps at which the markers of the frame of comparison count. Shape (T,)."""
        return framed(self.weights, self.frame)

    @property
    def left_out_share(self) -> float:
        """Share of marker positions that don't count; 0 where there are no markers."""
        return float(1 - np.mean(self.weights > 0)) if self.weights.size else 0.0

    def marker_errors(self, kind: Literal["motion", "marker", "aligned", "shape"]) -> Array:
        """Mean error of each marker [m], NaN for a marker that never counts. Shape (M,).

        Args:
            kind: `motion`, `aligned` and `shape` are the markers' parts of the figures of these names, `marker` of
                Eq. 1.
        """
        if self.divergence is not None:
            return np.full(self.weights.shape[1], FAILED_LOSS)
        match kind:
            case "motion":
                residual = self.motion_residual
            case "marker":
                residual = np.full_like(self.real, np.nan) if self.beat is None else self.beat.swim_residual
            case "aligned":
                residual = self.residual
            case "shape":
                residual = self.shape_residual
        lengths = np.linalg.norm(residual, axis=2)
        weights = np.isfinite(lengths).astype(float) if kind == "marker" else self.weights
        total = weights.sum(axis=0)
        summed = np.where(weights > 0, lengths, 0.0).sum(axis=0, where=weights > 0)
        return np.where(total > 0, summed / np.where(total > 0, total, 1.0), np.nan)

    def figures(self) -> dict[str, Any]:
        """Every figure that the trial has; those of a simulation that diverged are `FAILED_LOSS` or NaN."""
        figures: dict[str, Any] = {}
        if self.head is not None:
            figures |= {"motion_error": self.motion_error, "recoil_error": self.recoil_error, **self.head.figures()}
        if self.beat is not None:
            figures["marker_error"] = self.marker_error
        if self.weights.size:
            figures["aligned_marker_error"] = self.aligned_marker_error
        if self.frame is not None:
            figures["shape_error"] = self.shape_error
        if self.progress is not None:
            figures["progress_error"] = self.progress_error
        if self.beat is not None:
            figures["static_offset"] = self.beat.static_offset
        elif self.frame is not None:  # on the real clock the turn can be compared
            figures["heading_error"] = self.heading_error
        if self.progress is not None:
            real, simulated = self.progress.velocity_real, self.progress.velocity_simulated
            figures |= {"velocity_error": abs(simulated - real), "velocity_real": real, "velocity_simulated": simulated}
        if self.sensors:
            figures["sensor_errors"] = {sensor.name: sensor.error for sensor in self.sensors}
        if self.beat is not None:
            figures |= {"frequency": self.beat.frequency, "phase": self.beat.phase}
        if self.weights.size:
            figures |= {"left_out_share": self.left_out_share, "unweighted_error": self.unweighted_error}
        return {**figures, "loss": self.loss, "divergence": self.divergence}

    def evidence(self) -> dict[str, object]:
        """Evidence beyond the figures: errors of each marker, and motion of real and simulated markers.

        `seen_shares` are each marker's shares of frames that count.
        A trial with a beat has `beat_real` and `beat_simulated`, as `beat` gives them, and `path_beat_real` and
        `path_beat_simulated` in the frame of its path where the whole motion is compared. Another one has `offset`, the
        mean residual of each marker [m], `amplitude_real` and `amplitude_simulated` along its main axis [m], and
        `windows`: the `edges` of windows of time [s], the mean residual in them of all `markers` along both axes [m]
        and of all `sensors` [unit].
        """
        evidence: dict[str, object] = {}
        if self.head is not None:
            evidence["motion_marker_errors"] = self.marker_errors("motion")
        if self.beat is not None:
            evidence["marker_errors"] = self.marker_errors("marker")
        evidence["aligned_marker_errors"] = self.marker_errors("aligned")
        evidence["seen_shares"] = (self.weights > 0).mean(axis=0)
        if self.frame is not None:
            evidence["shape_marker_errors"] = self.marker_errors("shape")
        if self.beat is not None:
            if self.progress is not None and self.progress.first_beats is not None:
                evidence["first_beats"] = self.progress.first_beats
            evidence |= self._beats("beat", self.beat, self.real, self.simulated)
            if self.head is not None:
                real, simulated = self.head.real.to_path(self.real), self.simulated
                if self.head.simulated is not None:  # of a diverged trial nothing is known
                    simulated = self.head.simulated.to_path(simulated)
                evidence |= self._beats("path_beat", self.beat, real, simulated)
            return evidence
        residual = np.where(self.weights[:, :, None] > 0, self.residual, np.nan)
        edges = windows(self.times)
        evidence["offset"] = finite_mean(residual)
        evidence["amplitude_real"] = main_amplitudes(self.real, self.weights)
        evidence["amplitude_simulated"] = main_amplitudes(self.simulated, self.weights)
        evidence["windows"] = {
            "edges": edges,
            "markers": windowed_means(self.times, residual, edges),
            "sensors": {sensor.name: windowed_means(sensor.times, sensor.residual, edges) for sensor in self.sensors},
        }
        return evidence

    def _beats(self, name: str, compared: ComparedBeat, real: Array, simulated: Array) -> dict[str, object]:
        """The fundamental of each marker's motion on both sides, each at its own frequency."""
        return {
            f"{name}_real": beat(self.times, real, self.weights, compared.real_frequency),
            f"{name}_simulated": beat(self.times, simulated, self.weights, compared.frequency),
        }

    def _distance(self, residual: Array, weights: Array) -> float:
        return FAILED_LOSS if self.divergence is not None else weighted_distance(residual, weights)
