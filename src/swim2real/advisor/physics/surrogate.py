"""What the advisor believes the simulator would do elsewhere: a Gaussian process over the features of a swim.

Its prior mean is the robot's measured response, where there is one; what the run has shown so far corrects it. The
posterior knows where it is unsure, so a step into the unknown is judged as what it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kernel:
    """Covariance of the deviation from the prior mean, for features of unit scale.

    Attributes:
        offset: Standard deviation of a constant deviation.
        slope: Of its linear part, per unit of the cube.
        bend: Of its nonlinear part.
        length: Length scale of the nonlinear part, in the cube.
        noise: Of an observation.
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
            kernel: For features of unit scale.
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
