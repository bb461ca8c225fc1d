"""The loss that the advisor expects of a point: from predicted speeds and beats, in the terms of the aligned error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.features import SLOW, from_scale
from swim2real.advisor.physics.surrogate import Surrogate

Array = NDArray[np.float64]

_INSTANTS = 6  # at which the growing difference in progress is looked at
_LEAST_SHAPE = 2e-3  # m


@dataclass(frozen=True)
class Expectation:
    """Predicts the loss from a surrogate of the features.

    Attributes:
        surrogate: Of the features of all trials, flattened from (F, 1 + 2 M).
        speed: Real speeds [m/s]. Shape (F,).
        beat: Real beats [m], NaN where unknown. Shape (F, 2 M).
        shape_floor: What of each trial's shape error the beats don't explain [m]. Shape (F,).
        horizon: Seconds compared in each trial. Shape (F,).
        caution: Weight of the surrogate's variance.
        stuck: What each trial loses beyond what its speed explains, because it swims backward or staggers at the
            incumbent while others don't [m]; expected to vanish as the thrust reserve grows. Shape (F,).
        reserve: Points (N, d) to the thrust reserve that is gained over the incumbent's, 1 when it is enough.
    """

    surrogate: Surrogate
    speed: Array
    beat: Array
    shape_floor: Array
    horizon: Array
    caution: float
    stuck: Array
    reserve: Callable[[Array], Array]

    def losses(self, points: Array) -> Array:
        """Expected loss of each point [m]. Shape (N, d) to (N,)."""
        mean, spread = self.surrogate.predict(points)
        count = len(self.speed)
        mean, spread = (part.reshape(len(points), count, -1) for part in (mean, spread))
        # along the swimming axis: the difference grows with time
        simulated = from_scale(mean[:, :, 0])
        unsure = np.hypot(simulated, SLOW) * spread[:, :, 0]
        difference = (simulated - self.speed) ** 2 + self.caution * unsure**2
        shape = self.shapes(mean[:, :, 1:], self.caution * spread[:, :, 1:] ** 2)
        instants = (np.arange(_INSTANTS) + 0.5) / _INSTANTS * self.horizon[:, None]
        squared = difference[:, :, None] * instants**2 + shape[:, :, None] ** 2
        losses = np.sqrt(squared).mean(axis=2).mean(axis=1)
        if not self.stuck.any():
            return losses
        return losses + self.stuck.mean() * (1 - np.clip(self.reserve(points), -1.0, 1.0))

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
