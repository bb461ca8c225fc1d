"""A simulated trial beside its real one as plain arrays, and the part of the plane in which trials are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

BEYOND = 0.5  # of the real trial's size, by which a simulated one may widen a box on each side


@dataclass(frozen=True)
class View:
    """One trial, real and simulated, as it is drawn.

    NaN where a position is unknown; a simulation that diverged is NaN all over.

    Attributes:
        name: Of the trial.
        times: Rising [s]. Shape (T,).
        seen: False where the real marker was lost; its position isn't drawn. Shape (T, M).
        real: In the frame of comparison [m]. Shape (T, M, 2).
        simulated: Likewise.
        marker_names: M names.
    """

    POSITIONS: ClassVar[tuple[str, ...]] = ("real", "simulated")

    name: str
    times: Array
    seen: Mask
    real: Array
    simulated: Array
    marker_names: tuple[str, ...]

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=float)
        if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise ArgumentError(f"view '{self.name}': times must be 2 or more finite numbers that rise")
        count = len(self.marker_names)
        seen = np.array(self.seen, dtype=bool)
        kept: dict[str, NDArray[np.generic]] = {"times": times, "seen": seen}
        for name in self.POSITIONS:
            if getattr(self, name) is not None:
                kept[name] = np.array(getattr(self, name), dtype=float)
        for name, array in kept.items():
            shape = {"times": times.shape, "seen": (times.size, count)}.get(name, (times.size, count, 2))
            if array.shape != shape:
                raise ArgumentError(
                    f"view '{self.name}': {name} has shape {array.shape}; for {times.size} times and {count} marker "
                    f"names it must have {shape}"
                )
        for name, array in kept.items():
            if name.endswith("real"):
                array[~seen] = np.nan
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def diverged(self) -> bool:
        """Whether there is nothing of the simulation."""
        return not np.isfinite(self.simulated).all(axis=2).any()

    @property
    def duration(self) -> float:
        """From the first to the last time [s]."""
        return float(self.times[-1] - self.times[0])

    def nearest(self, times: Array) -> Indices:
        """Index of the sample that is nearest to each time [s]. Shape (N,) to (N,)."""
        after = np.clip(np.searchsorted(self.times, times), 1, self.times.size - 1)
        before = after - 1
        return np.where(times - self.times[before] <= self.times[after] - times, before, after)


@dataclass(frozen=True)
class Box:
    """A part of the plane [m]."""

    left: float
    bottom: float
    right: float
    top: float

    def __post_init__(self) -> None:
        if not (self.left < self.right and self.bottom < self.top):
            raise ArgumentError(
                f"a box from ({self.left:g}, {self.bottom:g}) to ({self.right:g}, {self.top:g}) m holds nothing; left "
                "must be below right and bottom below top"
            )


def drawn_points(real: Sequence[Array], simulated: Sequence[Array]) -> Array:
    """All known positions, the simulated ones moved to within reach of the real ones [m]. Shape (N, 2).

    So a simulation that goes astray doesn't shrink everything else.

    Args:
        real: Of several trials. Shapes (..., 2).
        simulated: Likewise.
    """
    true, made = (np.concatenate([array.reshape(-1, 2) for array in arrays]) for arrays in (real, simulated))
    true, made = true[np.isfinite(true).all(axis=1)], made[np.isfinite(made).all(axis=1)]
    if len(true) and len(made):
        low, high = true.min(axis=0), true.max(axis=0)
        reach = BEYOND * float((high - low).max())
        made = np.clip(made, low - reach, high + reach)
    return np.concatenate([true, made])


def box_around(points: Array, margins: Array, least: float, most: float) -> Box:
    """A box around points.

    Args:
        points: One at least [m]. Shape (N, 2).
        margins: Beside, and above and below them [m]. Shape (2,).
        least: Of the box's height, as a share of its width.
        most: Likewise.
    """
    low, high = points.min(axis=0) - margins, points.max(axis=0) + margins
    middle, size = (low + high) / 2, high - low
    size[1] = max(size[1], least * size[0])
    size[0] = max(size[0], size[1] / most)
    left, bottom, right, top = *(middle - size / 2).tolist(), *(middle + size / 2).tolist()
    return Box(left, bottom, right, top)
