"""Simulator parameters: what they are called, what they mean, and how the unit cube maps to them.

Optimizers see the unit cube only; everything else sees named values. The cube is linear in the value (the paper's)
or logarithmic with a small offset, which spreads out the low end where a parameter still matters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim2real.settings import Scale
from swimbase.checking import did_you_mean, shown
from swimbase.errors import ParameterError
from swimbase.names import quoted

Values = Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """One number of the simulator that is calibrated.

    Attributes:
        name: Identifier, as in parameters files.
        unit: SI unit; `-` for a number without one.
        lower: Smallest allowed value [unit].
        upper: Largest allowed value [unit].
        meaning: One or two sentences on what it does, for a person or a VLM.
        published: Value that the prior work publishes for this robot [unit].
        log_offset: Offset c of the logarithmic scale log(value + c) [unit]; None keeps this parameter linear.
    """

    name: str
    unit: str
    lower: float
    upper: float
    meaning: str
    published: float
    log_offset: float | None = None

    def __post_init__(self) -> None:
        bounds = f"parameter '{self.name}': lower bound {self.lower:g}"
        if not (np.isfinite(self.lower) and np.isfinite(self.upper)):
            raise ParameterError(f"{bounds} and upper bound {self.upper:g} must be finite numbers")
        if self.lower > self.upper:
            raise ParameterError(f"{bounds} is above upper bound {self.upper:g}; swap them")
        if self.lower == self.upper:
            raise ParameterError(f"{bounds} is the upper bound, too; give a range, or leave the parameter out")
        if self.log_offset is not None and self.lower + self.log_offset <= 0:
            raise ParameterError(
                f"parameter '{self.name}': lower bound {self.lower} plus log offset {self.log_offset} must be above 0"
            )

    def check(self, value: object, where: str = "") -> float:
        """The value as a float.

        Raises:
            ParameterError: The value is not a number, not finite, or out of bounds.
        """
        place = f" in {where}" if where else ""
        allowed = f"allowed is {self.lower:g} to {self.upper:g} {self.unit}".removesuffix(" -")
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise ParameterError(f"parameter '{self.name}'{place} is {shown(value)}, not a number; {allowed}")
        try:
            number = float(value)
        except OverflowError:  # a whole number beyond any float
            number = float("inf")
        if not np.isfinite(number):
            raise ParameterError(f"parameter '{self.name}'{place} is {number}; it must be finite, {allowed}")
        if not self.lower <= number <= self.upper:
            raise ParameterError(f"parameter '{self.name}'{place} is {number:g}, out of bounds; {allowed}")
        return number


@dataclass(frozen=True)
class ParameterSpace:
    """An ordered set of parameters and the scale on which the unit cube maps to them."""

    parameters: tuple[Parameter, ...]
    scale: Scale = "log"

    def __post_init__(self) -> None:
        if self.scale not in ("log", "linear"):
            raise ParameterError(f"scale is {self.scale!r}; allowed are 'log' and 'linear'")
        if len(set(self.names)) != len(self.parameters):
            raise ParameterError(f"parameter names must differ: {', '.join(self.names)}")

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def published(self) -> dict[str, float]:
        """The values that the prior work publishes."""
        return {parameter.name: parameter.published for parameter in self.parameters}

    def __getitem__(self, name: str) -> Parameter:
        try:
            return self.parameters[self.names.index(name)]
        except ValueError:
            raise ParameterError(unknown_name(name, self.names)) from None

    def check(self, values: Mapping[str, object], where: str = "") -> dict[str, float]:
        """All values as floats, in the order of the space.

        Raises:
            ParameterError: A name is unknown or missing, or a value isn't finite and within bounds.
        """
        place = f" in {where}" if where else ""
        for name in values:
            if name not in self.names:
                raise ParameterError(unknown_name(name, self.names) + place)
        missing = [name for name in self.names if name not in values]
        if missing:
            raise ParameterError(f"missing parameter{'s' if len(missing) > 1 else ''}{place}: {', '.join(missing)}")
        return {parameter.name: parameter.check(values[parameter.name], where) for parameter in self}

    def to_values(self, point: ArrayLike) -> dict[str, float]:
        """Physical values at a point of the unit cube.

        Args:
            point: Coordinates, each in [0, 1]. Shape (d,).

        Raises:
            ParameterError: The point has another length, isn't finite, or lies outside the cube.
        """
        cube = np.asarray(point, dtype=float)
        if cube.shape != (len(self),):
            raise ParameterError(f"a point of this space has {len(self)} coordinates, got shape {cube.shape}")
        if not np.all((cube >= 0) & (cube <= 1)):
            raise ParameterError(f"a point of the unit cube must lie within 0 and 1, got {cube.min()} to {cube.max()}")
        return {name: float(value) for name, value in zip(self.names, self.to_array(cube), strict=True)}

    def to_array(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Physical values at points of the unit cube, as arrays and unchecked. Shape (..., d) to (..., d)."""
        low, high = self._coordinate_bounds
        raw = self._from_coordinates(low + points * (high - low))
        lower, upper = self._bounds
        return np.where(points <= 0, lower, np.where(points >= 1, upper, np.clip(raw, lower, upper)))

    def to_cube(self, values: Values) -> NDArray[np.float64]:
        """The point of the unit cube that stands for physical values. Shape (d,)."""
        checked = self.check(values)
        low, high = self._coordinate_bounds
        coordinates = self._to_coordinates(np.array([checked[name] for name in self.names]))
        return np.clip((coordinates - low) / (high - low), 0.0, 1.0)

    @cached_property
    def _offsets(self) -> NDArray[np.float64]:
        """Log offset per parameter, NaN where the coordinate is linear."""
        if self.scale == "linear":
            return np.full(len(self), np.nan)
        return np.array([np.nan if p.log_offset is None else p.log_offset for p in self])

    @cached_property
    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return np.array([p.lower for p in self]), np.array([p.upper for p in self])

    @cached_property
    def _coordinate_bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self._to_coordinates(self._bounds[0]), self._to_coordinates(self._bounds[1])

    def _to_coordinates(self, raw: NDArray[np.float64]) -> NDArray[np.float64]:
        logarithmic = np.isfinite(self._offsets)
        return np.where(logarithmic, np.log(np.where(logarithmic, raw + self._offsets, 1.0)), raw)

    def _from_coordinates(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        logarithmic = np.isfinite(self._offsets)
        return np.where(logarithmic, np.exp(np.where(logarithmic, coordinates, 0.0)) - self._offsets, coordinates)


def unknown_name(name: str, known: tuple[str, ...]) -> str:
    """A sentence on an unknown parameter, with the nearest known name."""
    return f"unknown parameter {quoted(name)}" + (did_you_mean(name, known) or f"; known are {', '.join(known)}")
