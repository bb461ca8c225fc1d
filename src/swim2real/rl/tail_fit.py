"""Angles of the tail's joints from the markers behind them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SPREAD = 0.1  # rad, of a joint's angle, as believed before any marker is seen
_LEAST_NOISE = 0.0002  # m: markers above the tail move that much when the robot rolls
_ITERATIONS = 2


class TailFit:
    """The most likely angles: small ones that put the markers where they are seen.

    Markers alone tell them badly. Each stands so close behind its joint, and joints are so close to one another, that
    half a millimeter makes the five angles zigzag by 0.1 rad. So small angles are believed in to start with.
    """

    def __init__(self, hinges: Array, markers: Array, noise: float) -> None:
        """Prepares the fit.

        Args:
            hinges: Of the straight tail [m]. Shape (J,).
            markers: Of the straight tail, one behind each hinge, and a last one behind the last [m]. Shape (J + 1,).
            noise: Standard deviation of a marker's position [m].
        """
        count, lengths = len(hinges), np.diff(hinges)
        self._levers = np.zeros((count + 1, count))  # of each segment's direction in each marker's place
        for i in range(count + 1):
            segment = min(i, count - 1)
            self._levers[i, :segment] = lengths[:segment]
            self._levers[i, segment] = markers[i] - hinges[segment]
        self._noise = max(noise, _LEAST_NOISE)
        self._joints = np.eye(count) - np.eye(count, k=-1)  # from directions to angles
        self._prior = self._joints.T @ self._joints / _SPREAD**2

    def angles(self, markers: Array, hinge: Array, heading: float, guess: Array) -> Array:
        """Fits.

        Args:
            markers: Of the tail [m]. Shape (J + 1, 2).
            hinge: The first one's place [m]. Shape (2,).
            heading: Of the body in front of it [rad].
            guess: Angles to begin at [rad]. Shape (J,).

        Returns:
            Shape (J,).
        """
        levers, ahead = self._levers, np.zeros(len(guess))
        ahead[0] = heading
        direction = heading + np.cumsum(guess)
        for _ in range(_ITERATIONS):
            cosine, sine = np.cos(direction), np.sin(direction)
            off = np.concatenate([markers[:, 0] - hinge[0] - levers @ cosine, markers[:, 1] - hinge[1] - levers @ sine])
            slope = np.concatenate([-levers * sine, levers * cosine]) / self._noise
            pull = self._joints.T @ (ahead - self._joints @ direction) / _SPREAD**2
            direction = direction + np.linalg.solve(slope.T @ slope + self._prior, slope.T @ off / self._noise + pull)
        return self._joints @ direction - ahead
