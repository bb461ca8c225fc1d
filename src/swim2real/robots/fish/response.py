"""Response of the fish's swimming from rest to its parameters, learned from simulated swims over the whole box.

Four Gaussian processes, conditioned on a few thousand parameter sets that each swam at several frequencies from rest
(`experiments/fish_response`): whether the fish goes forward; how far it comes in a beat; how that grows with the
frequency; and the beat of its markers with the sway and the yaw of its head. Only their means are
here, so the file is small and NumPy is enough. They know nothing of any real swim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimbase.arrays import Array

PROCESSES = ("direction", "stride", "growth", "motion")
TABLES = ("basis", "average", "frequencies", "behind")
STEEPNESS = 3.0  # of the change from backward to forward, over the direction


@dataclass(frozen=True)
class _PosteriorMean:
    """Mean of a Gaussian process with a squared-exponential and a linear kernel, given what it was conditioned on.

    Attributes:
        points: Points that it was conditioned on, on a scale from -1 to 1. Shape (N, d).
        weights: Weights of their covariances. Shape (N, K).
        lengths: Length scale of each parameter. Shape (d,).
        bend: Variance of the nonlinear part.
        slope: Variance of the linear part.
        mean: Mean of each output. Shape (K,).
        scale: Standard deviation of each output. Shape (K,).
    """

    points: Array
    weights: Array
    lengths: Array
    bend: float
    slope: float
    mean: Array
    scale: Array

    def __call__(self, points: Array) -> Array:
        """Outputs at points of the logarithmic unit cube. Shape (N, d) to (N, K)."""
        here, (far, far_squared, weights, linear) = 2 * points - 1, self._prepared
        near = here / self.lengths
        halved = near @ far.T - 0.5 * ((near**2).sum(axis=1)[:, None] + far_squared)
        return self.mean + self.scale * (np.exp(halved, out=halved) @ weights + here @ linear)

    @cached_property
    def _prepared(self) -> tuple[Array, Array, Array, Array]:
        """Points in units of the lengths, their squares, weights, and the linear part with its weights."""
        far = self.points / self.lengths
        linear = self.slope / len(self.lengths) * (self.points.T @ self.weights)
        return far, (far**2).sum(axis=1), self.bend * self.weights, linear


@dataclass(frozen=True)
class _Corrected:
    """A process for more parameters than it was conditioned with: its outputs and a correction, which knows all.

    Attributes:
        plain: For the first parameters, d of them.
        correction: For all of them.
    """

    plain: _PosteriorMean
    correction: _PosteriorMean

    def __call__(self, points: Array) -> Array:
        return self.plain(points[:, : len(self.plain.lengths)]) + self.correction(points)

    @property
    def lengths(self) -> Array:
        """Length scales: for the first parameters the plain ones, for the others the correction's. Shape (d + e,)."""
        return np.append(self.plain.lengths, self.correction.lengths[len(self.plain.lengths) :])


@dataclass(frozen=True)
class _FishResponse:
    """Swims from rest, as Gaussian processes expect them.

    Attributes:
        direction: From -1, backward, to 1, forward, at each of the frequencies.
        stride: Logarithm of the way in a beat [m] at the middle of the logarithms of the frequencies.
        growth: Slope of that logarithm over the logarithm of the frequency.
        motion: Coordinates of the motion.
        basis: Fundamentals that a coordinate stands for: of each marker's sideways motion in the body frame, of the
            sway of the head [m] and of its yaw [rad], turned to the last marker's phase; real, then imaginary parts.
            Shape (C, G, 2 (M + 2)).
        average: The same of all of them on average. Shape (G, 2 (M + 2)).
        frequencies: Frequencies of these fundamentals [Hz]. Shape (G,).
        behind: How far each marker is behind the head [m]. Shape (M,).
    """

    direction: _PosteriorMean | _Corrected
    stride: _PosteriorMean | _Corrected
    growth: _PosteriorMean | _Corrected
    motion: _PosteriorMean | _Corrected
    basis: Array
    average: Array
    frequencies: Array
    behind: Array

    @property
    def lengths(self) -> Array:
        """Over which change of each parameter the beat changes, with a median of 1. Shape (d,)."""
        return self.motion.lengths / np.median(self.motion.lengths)

    def speeds(self, points: Array, frequencies: Array) -> tuple[Array, Array]:
        """Forward speeds [m/s], and whether swims go forward from rest, from -1 for surely not to 1 for surely.

        Args:
            points: Points in the logarithmic unit cube. Shape (N, d).
            frequencies: Frequencies of the beat [Hz]. Shape (F,).

        Returns:
            Shapes (N, F).
        """
        logs = np.log(frequencies) - np.log(self.frequencies).mean()
        strides = np.exp(self.stride(points) + self.growth(points) * logs)
        forward = self._at(self.direction(points).T, frequencies).T
        return np.tanh(STEEPNESS * forward) * strides * frequencies, forward

    def beats(self, points: Array, frequencies: Array, whole_motion: bool = False) -> Array:
        """Sideways fundamentals of the markers, real then imaginary parts [m].

        They are turned to the phase of the last marker in the body frame.

        Args:
            points: Points in the logarithmic unit cube. Shape (N, d).
            frequencies: Frequencies of the beat [Hz]. Shape (F,).
            whole_motion: Whether the markers are seen in the frame of the path, where they sway and yaw with the head,
                or in the body frame.

        Returns:
            Shape (N, F, 2 M).
        """
        average, basis = self._at(self.average, frequencies), self._at(self.basis.swapaxes(0, 1), frequencies)
        parts = average + np.einsum("nc,fck->nfk", self.motion(points), basis)
        half = parts.shape[-1] // 2
        motion = parts[..., :half] + 1j * parts[..., half:]
        markers = motion[..., :-2]
        if whole_motion:
            markers = markers + motion[..., -2:-1] + motion[..., -1:] * self.behind
        return np.concatenate([markers.real, markers.imag], axis=-1)

    def _at(self, table: Array, frequencies: Array) -> Array:
        """A table's rows at other frequencies, constant beyond its ends. Shape (G, ...) to (F, ...)."""
        place = np.interp(np.log(frequencies), np.log(self.frequencies), np.arange(len(self.frequencies)))
        low = np.minimum(place.astype(int), len(self.frequencies) - 2)
        share = (place - low).reshape(-1, *[1] * (table.ndim - 1))
        return (1 - share) * table[low] + share * table[low + 1]


@dataclass(frozen=True)
class _OfFirst:
    """The response for a fish with further parameters, of which it knows nothing, and with narrower bounds.

    Attributes:
        plain: The response for the first parameters.
        name: Name of the fish that has more.
    """

    plain: _FishResponse
    name: str

    @cached_property
    def _ends(self) -> tuple[Array, Array, int]:
        """Where the bounds of the first parameters lie between the plain fish's. Shapes (d,); number of the others."""
        from swim2real.robots import load_robot  # whose files name this response

        ours, theirs = load_robot(self.name).space, replace(load_robot("fish").space, scale="log")
        own = [ours[name] for name in theirs.names]
        low, high = ({one.name: getattr(one, side) for one in own} for side in ("lower", "upper"))
        return theirs.to_cube(low), theirs.to_cube(high), len(ours) - len(theirs)

    def _plain(self, points: Array) -> Array:
        low, high, _ = self._ends
        return low + points[:, : len(low)] * (high - low)

    @property
    def lengths(self) -> Array:
        """Length scales, of the other parameters 1. Shape (d + e,)."""
        return np.append(self.plain.lengths, np.ones(self._ends[2]))

    def speeds(self, points: Array, frequencies: Array) -> tuple[Array, Array]:
        """As the plain fish's."""
        return self.plain.speeds(self._plain(points), frequencies)

    def beats(self, points: Array, frequencies: Array, whole_motion: bool = False) -> Array:
        """As the plain fish's."""
        return self.plain.beats(self._plain(points), frequencies, whole_motion)


def _processes(content: Mapping[str, NDArray[Any]]) -> dict[str, _PosteriorMean]:
    points = 2 * content["points"].astype(float) - 1

    def table(name: str) -> Array:
        return content[name].astype(float)

    def mean_of(name: str) -> _PosteriorMean:
        rows, kernel = content[f"{name}_rows"].astype(int), table(f"{name}_kernel")
        mean, scale = table(f"{name}_scales")
        return _PosteriorMean(
            points[rows], table(f"{name}_weights"), kernel[:-2], float(kernel[-2]), float(kernel[-1]), mean, scale
        )

    return {name: mean_of(name) for name in PROCESSES}


def read_response(content: Mapping[str, NDArray[Any]]) -> _FishResponse:
    """The response of an array file, as `experiments/fish_response/fit.py` writes it."""
    tables: dict[str, Any] = {name: content[name].astype(float) for name in TABLES}
    return _FishResponse(**_processes(content), **tables)


def read_correction(content: Mapping[str, NDArray[Any]], plain: _FishResponse) -> _FishResponse:
    """The response for more parameters than the plain one has, from an array file with its correction."""
    corrections = _processes(content)
    return replace(plain, **{name: _Corrected(getattr(plain, name), corrections[name]) for name in PROCESSES})


@cache
def fish_response() -> _FishResponse:
    """The learned response that is shipped with the package."""
    return read_response(_read("response.npz"))


@cache
def extended_response() -> _FishResponse:
    """The learned response of the fish with parameters behind the 16: the plain fish's, corrected."""
    return read_correction(_read("response-extended.npz"), fish_response())


@cache
def rolling_response() -> _OfFirst:
    """The plain fish's response for the fish that rolls: wrong in size, but it knows what thrust and drag do."""
    return _OfFirst(fish_response(), "fish-rolling")


def _read(name: str) -> dict[str, NDArray[Any]]:
    with (resources.files("swim2real.robots.fish") / name).open("rb") as file, np.load(file) as content:
        return dict(content)
