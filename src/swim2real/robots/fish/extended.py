"""How the fish with dry friction at the water's surface, robot `fish-extended`, responds to its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swim2real.robots.fish.response import fish_response
from swim2real.robots.robot import Response

Array = NDArray[np.float64]

PLAIN = 16  # parameters that the plain fish has; others come behind
DRAG = 20.0  # N s²/m², of random fish within a factor of about two (experiments/model_structure.py drag)


@dataclass(frozen=True)
class ExtendedResponse:
    """The plain fish's response, slowed by a dry friction; of other extra parameters it expects nothing.

    Thrust and drag balance at v |v| = T / D; a friction F leaves v |v| = (T - F) / D, and no motion where T is smaller.

    Attributes:
        plain: Response to the 16.
        friction: Column of the friction among the values [N]; None where there is none.
    """

    plain: Response
    friction: int | None

    def speeds(self, points: Array, values: Array, frequencies: Array) -> Array:
        plain = self.plain.speeds(_sixteen(points), _sixteen(values), frequencies)
        left = np.maximum(plain**2 - self._loss(values), 0.0)
        return np.sign(plain) * np.sqrt(left)

    def reserve(self, values: Array) -> Array:
        return self.plain.reserve(_sixteen(values))

    def adapted(self, points: Array, values: Array, speeds: Array, frequencies: Array) -> ExtendedResponse:
        without = np.sign(speeds) * np.sqrt(speeds**2 + self._loss(values))
        return replace(self, plain=self.plain.adapted(_sixteen(points), _sixteen(values), without, frequencies))

    def beats(self, points: Array, frequencies: Array) -> Array:
        return self.plain.beats(_sixteen(points), frequencies)

    def _loss(self, values: Array) -> Array:
        """By how much friction lowers the squared speed [m²/s²]. Shape (N, 1)."""
        force = 0.0 if self.friction is None else values[:, self.friction]
        return np.broadcast_to(force / DRAG, len(values))[:, None]


def extended_response() -> ExtendedResponse:
    """With the friction behind the 16."""
    return ExtendedResponse(fish_response(), PLAIN)


def _sixteen(table: Array) -> Array:
    return table[:, :PLAIN]
