"""What the advisor believes: features of a swim, what the simulator would do elsewhere, and the loss that follows.

A swim is described by its forward speed and its beat, in the body frame or, where the whole motion is compared, in the
frame of its path. Speeds are compared on a scale that is logarithmic
for swimmers and linear around standstill, so that a fish that hardly moves, or moves backward, is nothing special. The
beat is taken relative to the last marker's phase, because the phase of a trial is free.

A Gaussian process predicts these features at other points. Its prior mean is the robot's measured response; what the
run has shown so far corrects it. The posterior knows where it is unsure, so a step into the unknown is judged as what
it is. The expected loss follows from predicted speeds and beats, in the terms of the motion error or of the aligned
error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares

Array = NDArray[np.float64]

SLOW = 0.01  # m/s, where the speed scale turns from linear to logarithmic
_LEAST_TRIALS = 4
_OUTLIER = 0.12  # on the speed scale, from a line over the logarithm of frequency
_INSTANTS = 6  # at which the growing difference in progress is looked at
_LEAST_SHAPE = 2e-3  # m


def to_speed_scale(speed: Array | float) -> Array:
    """Speed [m/s] on the advisor's scale."""
    return np.arcsinh(np.asarray(speed, dtype=float) / SLOW)


def from_speed_scale(value: Array) -> Array:
    """Speed [m/s] of a value on the advisor's scale."""
    return SLOW * np.sinh(value)


@dataclass(frozen=True)
class Swims:
    """The real or the simulated swims of all trials.

    Attributes:
        speed: Forward speed [m/s]. Shape (F,).
        beat: Real and imaginary parts of each marker's sideways fundamental, turned so that the last marker's phase is
            zero [m]; NaN for a marker that never counts. Shape (F, 2 M).
    """

    speed: Array
    beat: Array

    @property
    def features(self) -> Array:
        """Scaled speed, then the beat. Shape (F, 1 + 2 M)."""
        return np.concatenate([to_speed_scale(self.speed)[:, None], self.beat], axis=1)


def whole_motion(evidence: Mapping[str, Any]) -> bool:
    """Whether the evidence is of trials whose whole motion is compared."""
    return all("path_beat_real" in trial for trial in evidence["trials"].values())


def read_swims(evidence: Mapping[str, Any], side: str, frame: Literal["body", "path"] = "body") -> Swims:
    """Reads the `real` or the `simulated` side from the evidence of an evaluation, with beats in a frame."""
    trials = evidence["trials"].values()
    key = f"path_beat_{side}" if frame == "path" else f"beat_{side}"
    speed = np.array([trial[f"velocity_{side}"] for trial in trials], dtype=float)
    beats: list[Array] = []
    for trial in trials:
        content = trial[key]
        amplitude, phase = (np.array(content[key], dtype=float) for key in ("amplitude", "phase"))
        turned: NDArray[np.complex128] = amplitude * np.exp(
            1j * (phase - (phase[-1] if np.isfinite(phase[-1]) else 0.0))
        )
        beats.append(np.concatenate([turned.real, turned.imag]))
    return Swims(speed, np.array(beats))


def without_outliers(scaled: Array, frequencies: Array) -> Array:
    """Scaled speeds whose outliers are replaced by what the other frequencies suggest. Shape (F,).

    Close to a bound of stability a simulated swimmer may turn or stagger at one frequency and not at the next, for
    the slightest change of a parameter. Such a speed tells nothing of thrust and drag.
    """
    if len(scaled) < _LEAST_TRIALS:
        return scaled
    logs = np.log(frequencies)
    basis = np.column_stack([np.ones_like(logs), logs - logs.mean()])
    line = least_squares(lambda p: basis @ p - scaled, [np.median(scaled), 1.0], loss="soft_l1", f_scale=0.05).x
    rest = scaled - basis @ line
    limit = max(_OUTLIER, 4 * float(np.median(np.abs(rest))))
    return np.where(np.abs(rest) > limit, basis @ line, scaled)


def trial_frequencies(evidence: Mapping[str, Any]) -> Array:
    """Frequency of each trial [Hz]. Shape (F,)."""
    return np.array([trial["frequency"] for trial in evidence["trials"].values()], dtype=float)


@dataclass(frozen=True)
class Kernel:
    """Covariance of the deviation from the prior mean, for features of unit scale.

    Attributes:
        offset: Standard deviation of a constant deviation.
        slope: Scale of its linear part, per unit of the cube.
        bend: Scale of its nonlinear part.
        length: Length scale of the nonlinear part, in the cube.
        noise: Noise of an observation.
    """

    offset: float
    slope: float
    bend: float
    length: float
    noise: float

    def __call__(self, a: Array, b: Array) -> Array:
        """Covariance between points. Shapes (N, d), (K, d) to (N, K)."""
        squared = np.maximum((a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T, 0.0)
        linear = self.offset**2 + self.slope**2 * ((a - 0.5) @ (b - 0.5).T)
        return linear + self.bend**2 * np.exp(-squared / (2 * self.length**2))

    def variance(self, points: Array) -> Array:
        """Prior variance. Shape (N, d) to (N,)."""
        return self.offset**2 + self.slope**2 * ((points - 0.5) ** 2).sum(1) + self.bend**2


class Surrogate:
    """Posterior mean and standard deviation of the features at any point."""

    def __init__(
        self, kernel: Kernel, prior: Callable[[Array], Array], spread: Array, points: Array, features: Array
    ) -> None:
        """Conditions the prior on what was seen.

        Args:
            kernel: Kernel for features of unit scale.
            prior: Points (N, d) to features (N, K).
            spread: Standard deviation of each feature's deviation from the prior, in units of the kernel's. Shape (K,).
            points: Evaluated points. Shape (N, d).
            features: As seen there. Shape (N, K).
        """
        self._kernel, self._prior, self._spread, self._points = kernel, prior, spread, points
        covariance = kernel(points, points) + kernel.noise**2 * np.eye(len(points))
        self._factor = cho_factor(covariance, lower=True)
        self._weights = np.asarray(cho_solve(self._factor, features - prior(points)))

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Mean and standard deviation of every feature. Shape (N, d) to (N, K) and (N, K)."""
        cross = self._kernel(points, self._points)
        mean = self._prior(points) + cross @ self._weights
        explained = (cross.T * np.asarray(cho_solve(self._factor, cross.T))).sum(axis=0)
        spread = np.sqrt(np.maximum(self._kernel.variance(points) - explained, 0.0))
        return mean, spread[:, None] * self._spread


@dataclass(frozen=True)
class Expectation:
    """Predicts the loss from a surrogate of the features.

    Attributes:
        surrogate: Surrogate of the features of all trials, flattened from (F, 1 + 2 M).
        speed: Real speeds [m/s]. Shape (F,).
        beat: Real beats [m], NaN where unknown. Shape (F, 2 M).
        shape_floor: What of each trial's shape error the beats don't explain [m]. Shape (F,).
        horizon: Seconds compared in each trial. Shape (F,).
        caution: Weight of the surrogate's variance.
        stuck: What each trial loses beyond what its speed explains, because it swims backward or staggers at the
            incumbent while others don't [m]; expected to vanish the surer a point is forward. Shape (F,).
        surer: Points (N, d) to how much surer they are to go forward than the incumbent, 1 when it is enough.
    """

    surrogate: Surrogate
    speed: Array
    beat: Array
    shape_floor: Array
    horizon: Array
    caution: float
    stuck: Array
    surer: Callable[[Array], Array]

    def losses(self, points: Array) -> Array:
        """Expected loss of each point [m]. Shape (N, d) to (N,)."""
        mean, spread = self.surrogate.predict(points)
        count = len(self.speed)
        mean, spread = (part.reshape(len(points), count, -1) for part in (mean, spread))
        # along the swimming axis: the difference grows with time
        simulated = from_speed_scale(mean[:, :, 0])
        unsure = np.hypot(simulated, SLOW) * spread[:, :, 0]
        difference = (simulated - self.speed) ** 2 + self.caution * unsure**2
        shape = self.shapes(mean[:, :, 1:], self.caution * spread[:, :, 1:] ** 2)
        instants = (np.arange(_INSTANTS) + 0.5) / _INSTANTS * self.horizon[:, None]
        squared = difference[:, :, None] * instants**2 + shape[:, :, None] ** 2
        losses = np.sqrt(squared).mean(axis=2).mean(axis=1)
        if not self.stuck.any():
            return losses
        return losses + self.stuck.mean() * (1 - np.clip(self.surer(points), -1.0, 1.0))

    def shapes(self, beat: Array, variance: Array | float = 0.0) -> Array:
        """Expected shape errors [m]. Shape (N, F, 2 M) to (N, F)."""
        return np.sqrt(self.shape_floor**2 + mean_square(beat, self.beat, variance))


def mean_square(simulated: Array, real: Array, variance: Array | float = 0.0) -> Array:
    """Mean squared distance over a cycle and the markers that count [m²]. Shapes (..., 2 M) to (...)."""
    known = np.isfinite(real)
    squared = np.where(known, (simulated - np.nan_to_num(real)) ** 2 + variance, 0.0)
    # half the squared amplitude is the mean over a cycle; a marker has two parts
    return squared.sum(axis=-1) / 2 / np.maximum(known.sum(axis=-1) / 2, 1)


def shape_floor(measured: Array, simulated: Array, real: Array) -> Array:
    """What of the measured shape errors the beats leave unexplained [m]. Shape (F,)."""
    return np.sqrt(np.maximum(measured**2 - mean_square(simulated, real), _LEAST_SHAPE**2))
