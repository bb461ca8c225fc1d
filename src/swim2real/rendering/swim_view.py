"""A simulated swim beside its real one as plain arrays, and the limits within which several of them are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.trials import frames

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

MARGINS = np.array([0.03, 0.05])  # m beside, and above and below what is drawn: names stand there
LEAST_SHARE, MOST_SHARE = 0.3, 0.7  # a box's height, as a share of its width
BEYOND = 0.5  # of the real swim's size, by which a simulated one may widen the limits on each side


@dataclass(frozen=True)
class SwimView:
    """One trial, real and simulated, as it is drawn.

    NaN where a position is unknown; a simulation that diverged is NaN all over.

    Attributes:
        name: Of the trial.
        frequency: Of the beat [Hz].
        times: Rising [s]. Shape (T,).
        seen: False where the real marker was lost; its position isn't drawn. Shape (T, M).
        real: Body frame: marker 0 at the origin, x from head to tail [m]. Shape (T, M, 2).
        simulated: Likewise.
        course_real: In the world, turned so that the swim goes toward -x, from the origin on [m]. Shape (T, M, 2).
        course_simulated: Likewise.
        marker_names: Head to tail.
    """

    name: str
    frequency: float
    times: Array
    seen: Mask
    real: Array
    simulated: Array
    course_real: Array
    course_simulated: Array
    marker_names: tuple[str, ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.frequency) and self.frequency > 0):
            raise ArgumentError(f"view '{self.name}': frequency is {self.frequency} Hz; it must be finite and above 0")
        times = np.array(self.times, dtype=float)
        if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise ArgumentError(f"view '{self.name}': times must be 2 or more finite numbers that rise")
        count = len(self.marker_names)
        if count < 2:
            raise ArgumentError(f"view '{self.name}': it has {count} marker names; at least 2 are needed")
        seen = np.array(self.seen, dtype=bool)
        kept: dict[str, NDArray[np.generic]] = {"times": times, "seen": seen}
        for name in ("real", "simulated", "course_real", "course_simulated"):
            kept[name] = np.array(getattr(self, name), dtype=float)
        for name, array in kept.items():
            shape = {"times": times.shape, "seen": (times.size, count)}.get(name, (times.size, count, 2))
            if array.shape != shape:
                raise ArgumentError(
                    f"view '{self.name}': {name} has shape {array.shape}; for {times.size} times and {count} marker "
                    f"names it must have {shape}"
                )
        for name in ("real", "course_real"):
            kept[name][~seen] = np.nan
        for name, array in kept.items():
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

    @property
    def last_course(self) -> int:
        """The last sample at which it is known where the real head is; the last one if it never is."""
        known = np.flatnonzero(np.isfinite(heads(self.course_real)).all(axis=1))
        return int(known[-1]) if known.size else self.times.size - 1

    def nearest(self, times: Array) -> Indices:
        """Index of the sample that is nearest to each time [s]. Shape (N,) to (N,)."""
        after = np.clip(np.searchsorted(self.times, times), 1, self.times.size - 1)
        before = after - 1
        return np.where(times - self.times[before] <= self.times[after] - times, before, after)

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
    true, made = (np.concatenate([array.reshape(-1, 2) for array in arrays]) for arrays in (real, simulated))
    true, made = true[np.isfinite(true).all(axis=1)], made[np.isfinite(made).all(axis=1)]
    if not len(true) and not len(made):
        return Box(-0.05, -0.15, 0.55, 0.15)
    if len(true) and len(made):
        low, high = true.min(axis=0), true.max(axis=0)
        reach = BEYOND * float((high - low).max())
        made = np.clip(made, low - reach, high + reach)
    points = np.concatenate([true, made])
    low, high = points.min(axis=0) - MARGINS, points.max(axis=0) + MARGINS
    middle, size = (low + high) / 2, high - low
    size[1] = max(size[1], LEAST_SHARE * size[0])
    size[0] = max(size[0], size[1] / MOST_SHARE)
    left, bottom, right, top = *(middle - size / 2).tolist(), *(middle + size / 2).tolist()
    return Box(left, bottom, right, top)
