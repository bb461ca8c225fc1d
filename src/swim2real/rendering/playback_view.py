"""A recording and its playback as plain arrays, and the limits within which several of them are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rendering.view import Box, Indices, View, box_around, drawn_points

Array = NDArray[np.float64]

MARGIN = 0.12  # of the size of what is drawn: names stand there
LEAST_SHARE, MOST_SHARE = 0.3, 0.9  # a box's height, as a share of its width
NOTHING = Box(-0.5, -0.3, 0.5, 0.3)  # where no position is known
TRAIL = 0.08  # of a trial: the way of each marker that is drawn behind it
GRID_LINES = 6  # to a box's width, about
MOVES = 0.02  # of the size of all places: a coordinate that varies less is still
MOST_OF_IT = 0.95  # of what moves, when its pace is told


@dataclass(frozen=True)
class PlaybackView(View):
    """One recording and its playback, as they are drawn.

    Attributes:
        error: Mean distance of the markers, as the loss has it; NaN where nothing is known [m].
        errors: The same at each time, of the markers that count then [m]. Shape (T,).
        links: Pairs of markers that are joined by a line.
        axes: Which way the picture lies, in a few words.
        course_real: As seen from the robot's first pose, for one that travels; else None [m]. Shape (T, M, 2).
        course_simulated: Likewise, from its own first pose.
    """

    POSITIONS: ClassVar[tuple[str, ...]] = (*View.POSITIONS, "course_real", "course_simulated")

    error: float
    errors: Array
    links: tuple[tuple[int, int], ...]
    axes: str
    course_real: Array | None = None
    course_simulated: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        errors = np.array(self.errors, dtype=float)
        if errors.shape != self.times.shape:
            raise ArgumentError(
                f"view '{self.name}': errors has shape {errors.shape}; for {self.times.size} times it must have "
                f"{self.times.shape}"
            )
        errors.flags.writeable = False
        object.__setattr__(self, "errors", errors)

    @property
    def lines(self) -> list[list[int]]:
        """The links, those that follow on one another joined to one line."""
        found: list[list[int]] = []
        for start, end in self.links:
            if found and found[-1][-1] == start:
                found[-1].append(end)
            else:
                found.append([start, end])
        return found

    @property
    def pace(self) -> float:
        """Below which rate lies most of what the real markers do [Hz]; 0 where they hardly move."""
        times, columns = (
            np.linspace(self.times[0], self.times[-1], self.times.size),
            self.real.reshape(len(self.real), -1),
        )
        known = [column for column in columns.T if np.count_nonzero(np.isfinite(column)) > 2]
        if not known:
            return 0.0
        size = float((np.nanmax(self.real, axis=(0, 1)) - np.nanmin(self.real, axis=(0, 1))).max())
        even = np.stack([np.interp(times, self.times[seen := np.isfinite(one)], one[seen]) for one in known])
        moved = even - even.mean(axis=1, keepdims=True)
        power = (np.abs(np.fft.rfft(moved[moved.std(axis=1) > MOVES * size])) ** 2).sum(axis=0)
        if not power.any():
            return 0.0
        reached = np.cumsum(power) / power.sum()
        return float(np.searchsorted(reached, MOST_OF_IT) / self.duration)

    def moments(self, count: int) -> Indices:
        """Samples that are spread evenly over the trial, the first and the last among them. Shape (count,)."""
        if count < 2:
            raise ArgumentError(f"count is {count}; it must be 2 moments of the trial or more")
        return self.nearest(np.linspace(self.times[0], self.times[-1], count))

    def trail(self, index: int) -> slice:
        """The samples just before this one, and itself."""
        first = int(np.searchsorted(self.times, self.times[index] - TRAIL * self.duration))
        return slice(first, index + 1)


@dataclass(frozen=True)
class PlaybackLimits:
    """What is shown.

    Attributes:
        plane: Of the plane of comparison.
        course: Of what is seen from the first pose; None where nothing travels.
        error: At the top of the chart of errors [m].
    """

    plane: Box
    course: Box | None
    error: float


def playback_limits(views: Sequence[PlaybackView]) -> PlaybackLimits:
    """Limits that hold all frames of all views, so that sizes can be compared from picture to picture.

    A playback that goes astray widens them no more than by half the size of the real recordings on each side.
    """
    if not views:
        raise ArgumentError("views is empty; limits need at least one view")
    courses = [(v.course_real, v.course_simulated) for v in views]
    known = [(real, made) for real, made in courses if real is not None and made is not None]
    errors = np.concatenate([view.errors[np.isfinite(view.errors)] for view in views])
    return PlaybackLimits(
        _box([view.real for view in views], [view.simulated for view in views]),
        _box([real for real, _ in known], [made for _, made in known]) if known else None,
        rounded_up(float(errors.max()) if errors.size else 0.0),
    )


def grid_step(box: Box) -> float:
    """1, 2 or 5 times a power of ten, such that some lines of a grid lie in a box [m]."""
    return rounded_up((box.right - box.left) / (2 * GRID_LINES))


def rounded_up(length: float) -> float:
    """The next 1, 2 or 5 times a power of ten; a millimeter for nothing."""
    if not length > 0:
        return 1e-3
    power = 10.0 ** math.floor(math.log10(length))
    return next(step * power for step in (1, 2, 5, 10) if length <= step * power * (1 + 1e-9))


def length_text(length: float) -> str:
    """A length as a person would say it."""
    return f"{length:g} m" if length >= 0.1 else f"{1e3 * length:g} mm"


def millimeters(distance: float) -> str:
    """A distance of markers [m], n/a where none is known."""
    return f"{1e3 * distance:.1f} mm" if math.isfinite(distance) else "n/a"


def _box(real: Sequence[Array], simulated: Sequence[Array]) -> Box:
    points = drawn_points(real, simulated)
    if not len(points):
        return NOTHING
    margin = MARGIN * max(float(np.ptp(points, axis=0).max()), 1e-6)
    return box_around(points, np.full(2, margin), LEAST_SHARE, MOST_SHARE)
