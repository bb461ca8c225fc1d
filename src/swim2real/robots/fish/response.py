"""How the fish's swimming responds to its parameters, as measured over the whole box: a law and its coefficients.

A steady swimmer balances thrust and drag. With the beat given by the tendons, every fluid force is proportional to its
coefficient, so

    v |v| = f² A T / D,   T = t · (c, 1),   D = exp(d) · (c, 1),   A = exp(a · (1, z)),

with the five fluid coefficients c and the other eleven parameters z on a scale from -1 to 1. The coefficients t, d and
a were fitted to simulated swims of random parameters (`experiments/fish_response`); they tell signs and rough sizes,
and know nothing of any real swim. The beat of each marker is a linear function of all sixteen.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from swim2real.robots.robot import Response

Array = NDArray[np.float64]

FLUID = 5  # coefficients of the fluid, which come first
PLAIN = 16  # parameters that the plain fish has; others come behind
DRAG = 20.0  # N s²/m², of random fish within a factor of about two (experiments/model_structure.py drag)
_SLOW = 0.01  # m/s, below which speeds are compared on a linear scale
_LAW_ERROR = 0.5  # of the law, on that scale
_THRUST_SPREAD, _DRAG_SPREAD, _AMPLITUDE_SPREAD = 0.5, 0.7, 0.4  # by how much a robot's trials may bend the law


@dataclass(frozen=True)
class FishResponse:
    """The law's coefficients, and the beat's at G frequencies.

    Attributes:
        thrust: t. Shape (6,).
        drag: d. Shape (6,).
        amplitude: a. Shape (12,).
        frequencies: Frequencies of the beat's coefficients [Hz]. Shape (G,).
        beat: Real, then imaginary part of each marker's sideways fundamental, turned to the last marker's phase:
            constant, then slope per parameter on a scale from -1 to 1 [m]. Shape (G, 17, 2 M).
    """

    thrust: Array
    drag: Array
    amplitude: Array
    frequencies: Array
    beat: Array

    def speeds(self, points: Array, values: Array, frequencies: Array) -> Array:
        """Forward speeds [m/s].

        Args:
            points: In the logarithmic unit cube. Shape (N, 16).
            values: The same as physical values. Shape (N, 16).
            frequencies: [Hz]. Shape (F,).

        Returns:
            Shape (N, F).
        """
        fluid = np.column_stack([values[:, :FLUID], np.ones(len(values))])
        rest = np.column_stack([np.ones(len(points)), 2 * points[:, FLUID:] - 1])
        squared = np.exp(rest @ self.amplitude) * (fluid @ self.thrust) / (fluid @ np.exp(self.drag))
        return (np.sign(squared) * np.sqrt(np.abs(squared)))[:, None] * frequencies

    def reserve(self, values: Array) -> Array:
        """Share of the thrust that is left after what works against it. Shape (N, 16) to (N,), from -1 to 1.

        With little left, the swim hangs on small differences: at one frequency the fish may go backward.
        """
        terms = np.column_stack([values[:, :FLUID], np.ones(len(values))]) * self.thrust
        return terms.sum(axis=1) / np.abs(terms).sum(axis=1)

    def adapted(self, points: Array, values: Array, speeds: Array, frequencies: Array) -> FishResponse:
        """The law bent to what was seen: corrections of t, d and a that stay near zero.

        Args:
            points: In the logarithmic unit cube. Shape (N, 16).
            values: The same as physical values. Shape (N, 16).
            speeds: Simulated there [m/s]. Shape (N, F).
            frequencies: [Hz]. Shape (F,).
        """
        seen = np.arcsinh(speeds / _SLOW)

        def residual(correction: Array) -> Array:
            predicted = self._corrected(correction).speeds(points, values, frequencies)
            # neighboring frequencies err alike: all of a candidate count as a few
            misfit = (np.arcsinh(predicted / _SLOW) - seen) / (_LAW_ERROR * np.sqrt(max(len(frequencies) / 2, 1)))
            return np.concatenate([misfit.ravel(), correction])

        fit = least_squares(residual, np.zeros(24), loss="soft_l1", max_nfev=30)
        return self._corrected(fit.x)

    def _corrected(self, correction: Array) -> FishResponse:
        thrust, drag, amplitude = correction[:6], correction[6:12], correction[12:]
        return replace(
            self,
            thrust=self.thrust + _THRUST_SPREAD * thrust * (0.3 + np.abs(self.thrust)),
            drag=self.drag + _DRAG_SPREAD * drag,
            amplitude=self.amplitude + _AMPLITUDE_SPREAD * amplitude,
        )

    def beats(self, points: Array, frequencies: Array) -> Array:
        """Sideways fundamentals, real then imaginary parts [m]. Shape (N, F, 2 M)."""
        basis = np.column_stack([np.ones(len(points)), 2 * points - 1])
        return np.einsum("np,fpk->nfk", basis, self._at(self.beat, frequencies))

    def _at(self, table: Array, frequencies: Array) -> Array:
        """A table's rows at other frequencies, constant beyond its ends. Shape (G, ...) to (F, ...)."""
        place = np.interp(np.log(frequencies), np.log(self.frequencies), np.arange(len(self.frequencies)))
        low = np.minimum(place.astype(int), len(self.frequencies) - 2)
        share = (place - low).reshape(-1, *[1] * (table.ndim - 1))
        return (1 - share) * table[low] + share * table[low + 1]


@cache
def fish_response() -> FishResponse:
    """The measured response that is shipped with the package."""
    content = json.loads((resources.files("swim2real.robots.fish") / "response.json").read_text(encoding="utf-8"))
    return FishResponse(**{field.name: np.array(content[field.name], dtype=float) for field in fields(FishResponse)})


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
    """The law with the friction behind the 16."""
    return ExtendedResponse(fish_response(), PLAIN)


def _sixteen(table: Array) -> Array:
    return table[:, :PLAIN]
