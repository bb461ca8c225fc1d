"""Numbers over time that were recorded beside a film: commands of a controller, readings of sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # s


@dataclass(frozen=True)
class Signals:
    """Columns of numbers over time, on the clock of their trial's track.

    Attributes:
        times: Time stamps, rising [s]. Shape (R,).
        names: Of the columns, each in its own unit.
        values: NaN where nothing was recorded. Shape (R, K).
    """

    times: Array
    names: tuple[str, ...]
    values: Array

    def __init__(self, times: object, names: Sequence[str], values: object) -> None:
        stamps, columns = np.array(times, dtype=float), np.array(values, dtype=float)
        if stamps.ndim != 1 or columns.shape != (stamps.size, len(names)):
            raise TrialError(
                f"values have shape {columns.shape}, times {stamps.shape} and there are {len(names)} names; expected "
                f"(R, K), (R,) and K"
            )
        if not stamps.size:
            raise TrialError("a table of signals needs at least one row")
        if not np.all(np.isfinite(stamps)) or not np.all(np.diff(stamps) > 0):
            raise TrialError("time stamps must be finite and rise from row to row")
        if len(set(names)) < len(names) or not all(names):
            raise TrialError(f"columns are named {', '.join(map(repr, names))}; give each its own name")
        stamps.flags.writeable = columns.flags.writeable = False
        object.__setattr__(self, "times", stamps)
        object.__setattr__(self, "names", tuple(names))
        object.__setattr__(self, "values", columns)

    def column(self, name: str) -> Array:
        """The values of a name. Shape (R,).

        Raises:
            TrialError: There is no such column.
        """
        if name not in self.names:
            raise TrialError(f"there is no column '{name}'; there are {', '.join(self.names)}")
        return self.values[:, self.names.index(name)]

    def held(self, name: str, times: Array) -> Array:
        """A column at any times: each value holds until the next one, the first one also before its time.

        Args:
            name: Of the column.
            times: [s]. Shape (N,).

        Raises:
            TrialError: There is no such column, or no value in it.
        """
        values = self.column(name)
        known = np.isfinite(values)
        if not known.any():
            raise TrialError(f"column '{name}' has no value")
        rows = np.searchsorted(self.times[known], times + _ROUNDING, side="right") - 1
        return values[known][np.maximum(rows, 0)]

    def check_clock(self, first: float, last: float) -> None:
        """Whether the rows are on the clock of a track, as far as that can be told.

        Args:
            first: Time stamp of the track's first frame [s].
            last: Of its last.

        Raises:
            TrialError: All rows are after the track, or before it.
        """
        if self.times[0] <= last + _ROUNDING and self.times[-1] >= first - _ROUNDING:
            return
        raise TrialError(
            f"its rows are from {self.times[0]:.10g} s to {self.times[-1]:.10g} s, and the frames that are compared "
            f"from {first:.10g} s to {last:.10g} s; give time_s on the clock of the track, which `track` counts in "
            f"seconds since the video's first frame"
        )

    def between(self, first: float, last: float) -> Signals:
        """The rows from one time to another, both included [s].

        Raises:
            TrialError: There are none.
        """
        self.check_clock(first, last)
        kept = (self.times >= first - _ROUNDING) & (self.times <= last + _ROUNDING)
        if not kept.any():
            raise TrialError(
                f"there is no row between {first:g} s and {last:g} s; the rows are from {self.times[0]:g} s to "
                f"{self.times[-1]:g} s"
            )
        return Signals(self.times[kept], self.names, self.values[kept])
