"""A simulated swim beside its real one as plain arrays, and the limits within which several of them are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rendering.view import Box, View, box_around, drawn_points
from swim2real.trials import frames

Array = NDArray[np.float64]

MARGINS = np.array([0.03, 0.05])  # m beside, and above and below what is drawn: names stand there
LEAST_SHARE, MOST_SHARE = 0.3, 0.7  # a box's height, as a share of its width
NOTHING = Box(-0.05, -0.15, 0.55, 0.15)  # where no position is known


@dataclass(frozen=True)
class SwimView(View):
    """One swim, real and simulated, as it is drawn; `real` and `simulated` are in the body frame, x toward the tail.

    Attributes:
        frequency: Of the beat [Hz].
        course_real: In the world, turned so that the swim goes toward -x, from the origin on [m]. Shape (T, M, 2).
        course_simulated: Likewise.
    """

    POSITIONS: ClassVar[tuple[str, ...]] = (*View.POSITIONS, "course_real", "course_simulated")

    frequency: float
    course_real: Array
    course_simulated: Array

    def __post_init__(self) -> None:
        if not (np.isfinite(self.frequency) and self.frequency > 0):
            raise ArgumentError(f"view '{self.name}': frequency is {self.frequency} Hz; it must be finite and above 0")
        if len(self.marker_names) < 2:
            raise ArgumentError(
                f"view '{self.name}': it has {len(self.marker_names)} marker names; at least 2 are needed"
            )
        super().__post_init__()

    @property
    def last_course(self) -> int:
        """The last sample at which it is known where the real head is; the last one if it never is."""
        known = np.flatnonzero(np.isfinite(heads(self.course_real)).all(axis=1))
        return int(known[-1]) if known.size else self.times.size - 1

    def last_beat(self, index: int) -> slice:
        """The samples of the beat that ends with this one."""
        first = int(np.searchsorted(self.times, self.times[index] - 1 / self.frequency))
        return slice(first, index + 1)

    def beat(self, count: int) -> tuple[Array, Array]:
        """Times evenly spread over one beat in the middle of the trial [s], and their shares of the beat.

        The beat begins where the last real marker is farthest to the left of the fish (toward +y) if it was seen for
        long enough, so that the beats of several trials can be compared; the last simulated one otherwise. In a trial
        of less than two beats, a time outside of it is moved by a beat; one of less than a beat is covered from its
        start to its end.

        Args:
            count: Of times. Shapes (count,).
        """
        if count < 1:
            raise ArgumentError(f"count is {count}; it must be 1 picture of the beat or more")
        shares, period = np.arange(count) / count, 1 / self.frequency
        if self.duration < period:
            shares = shares * self.duration / period
            return self.times[0] + shares * period, shares
        room = self.duration - period  # by which the beat may begin after the first time
        peak = (self._peak() - self.times[0] - room / 2) % period
        times = room / 2 + (peak if peak <= period / 2 else peak - period) + shares * period
        times = np.where(times < 0, times + period, np.where(times > self.duration, times - period, times))
        return self.times[0] + times, shares

    def _peak(self) -> float:
        """A time at which the last marker is farthest toward +y, by a sine of the beat's frequency [s]."""
        for positions in (self.real, self.simulated):
            known = np.isfinite(positions[:, -1, 1])
            if np.count_nonzero(known) * 2 > known.size:
                turn = 2 * np.pi * self.frequency * self.times[known]
                columns = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)
                cosine, sine, _ = np.linalg.lstsq(columns, positions[known, -1, 1])[0]
                return float(np.arctan2(sine, cosine) / (2 * np.pi * self.frequency))
        return float(self.times[0])


@dataclass(frozen=True)
class Limits:
    """What is shown.

    Attributes:
        body: Of the body frame.
        course: Of the world.
    """

    body: Box
    course: Box


def common_limits(views: Sequence[SwimView]) -> Limits:
    """Limits that hold all frames of all views, so that sizes can be compared from picture to picture.

    A simulated swim that goes astray widens them no more than by half the size of the real ones on each side.
    """
    if not views:
        raise ArgumentError("views is empty; limits need at least one view")
    body = _box([view.real for view in views], [view.simulated for view in views])
    course = _box([view.course_real for view in views], [view.course_simulated for view in views])
    return Limits(body, course)


def heads(course: Array) -> Array:
    """The head's way: the mean of markers 0 and 1 [m]. Shape (T, M, 2) to (T, 2)."""
    return frames.heads(course)


def _box(real: Sequence[Array], simulated: Sequence[Array]) -> Box:
    """Around all positions, with equal margins, neither flat nor tall."""
    points = drawn_points(real, simulated)
    return box_around(points, MARGINS, LEAST_SHARE, MOST_SHARE) if len(points) else NOTHING
