"""A compared trial as it is drawn: plain arrays of what the trial has, and the limits that several trials share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markertrack import frames
from swim2real.objective import ComparedTrial
from swim2real.objective.motion import finite_mean
from swim2real.robots.robot import Robot
from swimbase.arrays import Array, Mask
from swimbase.errors import ArgumentError

Indices = NDArray[np.intp]

_FOLLOWED = 0.5  # share of frames in which a marker is seen, for its static offset to be believed
_TRAIL = 0.08  # share of a trial without a beat: the path of each marker that is drawn behind it
_MOVES = 0.02  # of the size of all places: a coordinate that varies less is still
_MOST_OF_IT = 0.95  # of the power of the motion, when its pace is measured
_BEYOND = 0.5  # of the real trial's size, by which a simulated one may widen a box on each side
_MARGIN = 0.12  # of the size of what is drawn: names stand there
_LEAST_SHARE, _MOST_SHARE = 0.3, 0.9  # a box's height, as a share of its width
_ENLARGED = (1, 2, 5, 10)  # by which differences may be enlarged
_CLEARLY_OFF = 0.1  # of the width of what is shown: differences that are enlarged stay below it
_GRID_LINES = 6  # to a box's width, about
_AXES = "xyz"


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


class Swing(NamedTuple):
    """One way in which the head swings.

    Attributes:
        name: What swings.
        unit: Unit of the values.
        real: Real values, NaN where unknown. Shape (T,).
        simulated: Simulated values. Shape (T,).
    """

    name: str
    unit: str
    real: Array
    simulated: Array

    @property
    def size(self) -> float:
        """The largest known value, to either side; 0 where nothing is known."""
        return float(np.nanmax(np.abs([self.real, self.simulated]), initial=0.0))


@dataclass(frozen=True)
class TrialView:
    """One trial, real and simulated, as it is drawn.

    Positions are NaN where they are unknown or not drawn; those of a simulation that diverged are NaN all over.

    Attributes:
        name: Name of the trial.
        marker_names: M names.
        times: Rising [s]. Shape (T,).
        seen: False where the real marker was lost. Shape (T, M).
        real: Positions in the frame of comparison [m]. Shape (T, M, 2).
        simulated: Positions in the same frame, as the loss sees them [m]. Shape (T, M, 2).
        error: Mean distance of the markers; NaN where nothing is known [m].
        errors: The same at each time, of the markers that count then [m]. Shape (T,).
        lines: Indices of the markers that each line of the skeleton goes through.
        axes: What the frame of comparison is, in a few words.
        frequency: Frequency of the beat [Hz]; None without one.
        path_real: Positions as seen from the start [m]; None where the robot goes nowhere. Shape (T, M, 2).
        path_simulated: The same of the simulation, from its own start [m]. Shape (T, M, 2).
        swings: How the head swings about its path; empty where that isn't compared.
    """

    name: str
    marker_names: tuple[str, ...]
    times: Array
    seen: Mask
    real: Array
    simulated: Array
    error: float
    errors: Array
    lines: tuple[tuple[int, ...], ...]
    axes: str
    frequency: float | None = None
    path_real: Array | None = None
    path_simulated: Array | None = None
    swings: tuple[Swing, ...] = ()

    def __post_init__(self) -> None:
        times = np.asarray(self.times)
        if times.ndim != 1 or times.size < 2 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise ArgumentError(f"view '{self.name}': times must be 2 or more finite numbers that rise")
        shape = (times.size, len(self.marker_names), 2)
        wanted = {"seen": shape[:2], "errors": shape[:1], "real": shape, "simulated": shape, "path_real": shape,
                  "path_simulated": shape}  # fmt: skip
        for name, expected in wanted.items():
            array = getattr(self, name)
            if array is not None and np.shape(array) != expected:
                raise ArgumentError(f"view '{self.name}': {name} has shape {np.shape(array)}; it must have {expected}")

    @property
    def diverged(self) -> bool:
        """True if there is nothing of the simulation."""
        return not np.isfinite(self.simulated).all(axis=2).any()

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def about(self) -> str:
        """Words beside the name: the frequency of the beat, if there is one."""
        return "" if self.frequency is None else f"{self.frequency:.2f} Hz"

    @property
    def pace(self) -> float:
        """Rate of the fastest motion, which a film must not miss [Hz].

        The beat's frequency, or the rate below which lies most of what the real markers do; 0 where they hardly move.
        """
        if self.frequency is not None:
            return self.frequency
        times = np.linspace(self.times[0], self.times[-1], self.times.size)
        columns = self.real.reshape(len(self.real), -1).T
        known = [column for column in columns if np.count_nonzero(np.isfinite(column)) > 2]
        if not known:
            return 0.0
        size = float((np.nanmax(self.real, axis=(0, 1)) - np.nanmin(self.real, axis=(0, 1))).max())
        even = np.stack([np.interp(times, self.times[seen := np.isfinite(one)], one[seen]) for one in known])
        moved = even - even.mean(axis=1, keepdims=True)
        power = (np.abs(np.fft.rfft(moved[moved.std(axis=1) > _MOVES * size])) ** 2).sum(axis=0)
        if not power.any():
            return 0.0
        reached = np.cumsum(power) / power.sum()
        return float(np.searchsorted(reached, _MOST_OF_IT) / self.duration)

    def nearest(self, times: Array) -> Indices:
        """Index of the sample that is nearest to each time [s]. Shape (N,) to (N,)."""
        after = np.clip(np.searchsorted(self.times, times), 1, self.times.size - 1)
        before = after - 1
        return np.where(times - self.times[before] <= self.times[after] - times, before, after)

    def enlarged(self, width: float) -> tuple[int, TrialView]:
        """By which factor small differences between simulated and real places are enlarged, 1 for large ones; the view.

        What isn't seen of the real robot has no difference, and isn't drawn.

        Args:
            width: Width of what is shown [m].
        """
        gaps = np.linalg.norm(self.simulated - self.real, axis=2)
        known = gaps[np.isfinite(gaps)]
        typical = float(np.percentile(known, 90)) if known.size else math.inf
        factor = max(factor for factor in _ENLARGED if factor == 1 or factor * typical <= _CLEARLY_OFF * width)
        return factor, replace(self, simulated=self.real + factor * (self.simulated - self.real))

    def spacing(self) -> float:
        """The least usual distance of a marker to the one after next, whose names stand on the same side [m]."""
        if len(self.marker_names) < 3:
            return math.inf
        gaps = np.linalg.norm(self.real[:, 2:] - self.real[:, :-2], axis=2)
        known = [np.median(column[np.isfinite(column)]) for column in gaps.T if np.isfinite(column).any()]
        return float(min(known, default=math.inf))

    def moments(self, count: int) -> tuple[Array, Array]:
        """Times [s] that show the trial, and their shares of a beat or of the trial.

        They are spread evenly over one beat in the middle of the trial, or else from its start to its end.

        Args:
            count: Number of times. Shapes (count,).
        """
        least = 2 if self.frequency is None else 1
        if count < least:
            raise ArgumentError(f"count is {count}; it must be {least} moments of the trial or more")
        if self.frequency is None:
            shares = np.linspace(0.0, 1.0, count)
            return self.times[0] + shares * self.duration, shares
        return self._beat(count, 1 / self.frequency)

    def trail(self, index: int) -> tuple[slice, tuple[int, ...]]:
        """Samples just before one, itself included, and the markers whose path in them is drawn.

        With a beat it is the last marker's during the last beat, else every marker's during a share of the trial.
        """
        beat = self.frequency is not None
        length = 1 / self.frequency if self.frequency is not None else _TRAIL * self.duration
        first = int(np.searchsorted(self.times, self.times[index] - length))
        last = len(self.marker_names) - 1
        return slice(first, index + 1), (last,) if beat else tuple(range(last + 1))

    @property
    def last_seen(self) -> int:
        """The last sample at which the real robot's place is known; the last one if it never is."""
        path = self.real if self.path_real is None else self.path_real
        known = np.flatnonzero(np.isfinite(leads(path)).all(axis=1))
        return int(known[-1]) if known.size else self.times.size - 1

    def _beat(self, count: int, period: float) -> tuple[Array, Array]:
        """Times evenly spread over one beat in the middle of the trial [s], and their shares of the beat.

        The beat begins where the last real marker is farthest to the left of the swimmer (toward +y) if it was seen for
        long enough, so that the beats of several trials can be compared; the last simulated one otherwise. In a trial
        of less than two beats, a time outside of it is moved by a beat; one of less than a beat is covered from its
        start to its end.
        """
        shares = np.arange(count) / count
        if self.duration < period:
            shares = shares * self.duration / period
            return self.times[0] + shares * period, shares
        room = self.duration - period  # by which the beat may begin after the first time
        peak = (self._peak(1 / period) - self.times[0] - room / 2) % period
        times = room / 2 + (peak if peak <= period / 2 else peak - period) + shares * period
        times = np.where(times < 0, times + period, np.where(times > self.duration, times - period, times))
        return self.times[0] + times, shares

    def _peak(self, frequency: float) -> float:
        """A time at which the last marker is farthest toward +y, by a sine of the beat's frequency [s]."""
        for positions in (self.real, self.simulated):
            known = np.isfinite(positions[:, -1, 1])
            if np.count_nonzero(known) * 2 > known.size:
                turn = 2 * np.pi * frequency * self.times[known]
                columns = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)
                cosine, sine, _ = np.linalg.lstsq(columns, positions[known, -1, 1])[0]
                return float(np.arctan2(sine, cosine) / (2 * np.pi * frequency))
        return float(self.times[0])


def view_of(trial: ComparedTrial, robot: Robot) -> TrialView:
    """A compared trial as it is drawn: registered, as the loss sees it."""
    seen, hidden = trial.weights > 0, np.nan if trial.divergence else 0.0
    unseen = np.where(seen, 0.0, np.nan)[:, :, None]
    residual, error = trial.residual, trial.aligned_marker_error
    if trial.head is not None:
        residual, error = trial.motion_residual, trial.motion_error
    distances = np.where(seen, np.linalg.norm(residual + hidden, axis=2), np.nan)
    chain = tuple(range(len(robot.marker_names)))
    real, simulated = _paths(trial)
    return TrialView(
        name=trial.name,
        marker_names=robot.marker_names,
        times=trial.times,
        seen=seen,
        real=trial.real + unseen,
        simulated=trial.simulated + _offsets(trial, seen) + hidden,
        error=error + hidden,
        errors=finite_mean(distances.T),
        lines=_joined(robot.links) if trial.frequency is None else (chain,),
        axes=_axes(trial, robot),
        frequency=trial.frequency,
        path_real=None if real is None else real + unseen,
        path_simulated=None if simulated is None else simulated + hidden,
        swings=_swings(trial),
    )


def leads(path: Array) -> Array:
    """The place of the robot's front: the mean of markers 0 and 1, or the only one [m]. Shape (T, M, 2) to (T, 2)."""
    return path[:, 0] if path.shape[1] < 2 else frames.heads(path)


@dataclass(frozen=True)
class Limits:
    """Limits that pictures of several trials share, so that sizes can be compared from picture to picture.

    Attributes:
        plane: Part of the frame of comparison.
        path: Part of the plane of the paths; None where no trial has one.
        error: Distance at the top of the chart of errors [m].
        swings: Values at the edges of the charts of the head's swings, in their units.
    """

    plane: Box
    path: Box | None
    error: float
    swings: tuple[float, ...] = ()


def common_limits(views: Sequence[TrialView]) -> Limits:
    """Limits that hold all frames of all views.

    A simulation that goes astray widens them no more than by half the size of the real trials on each side.
    """
    if not views:
        raise ArgumentError("views is empty; limits need at least one view")
    paths = [(v.path_real, v.path_simulated) for v in views]
    known = [(real, simulated) for real, simulated in paths if real is not None and simulated is not None]
    errors = np.concatenate([view.errors[np.isfinite(view.errors)] for view in views])
    return Limits(
        _box([view.real for view in views], [view.simulated for view in views]),
        _box([real for real, _ in known], [simulated for _, simulated in known]) if known else None,
        rounded_up(float(errors.max()) if errors.size else 0.0),
        tuple(rounded_up(max(swing.size for swing in alike)) for alike in zip(*(v.swings for v in views), strict=True)),
    )


def grid_step(box: Box) -> float:
    """1, 2 or 5 times a power of ten, such that some lines of a grid lie in a box [m]."""
    return rounded_up((box.right - box.left) / (2 * _GRID_LINES))


def rounded_up(length: float) -> float:
    """The next 1, 2 or 5 times a power of ten; a millimeter for nothing."""
    if not length > 0:
        return 1e-3
    power = 10.0 ** math.floor(math.log10(length))
    return next(step * power for step in (1, 2, 5, 10) if length <= step * power * (1 + 1e-9))


def length_text(length: float) -> str:
    """A length in m or mm, as a person would say it."""
    return f"{length:g} m" if length >= 0.1 else f"{1e3 * length:g} mm"


def millimeters(distance: float) -> str:
    """A distance of markers [m], n/a where none is known."""
    return f"{1e3 * distance:.1f} mm" if math.isfinite(distance) else "n/a"


def _offsets(trial: ComparedTrial, seen: Mask) -> Array:
    """The registration; that of a marker that was mostly lost says little, its neighbors' says more. Shape (M, 2)."""
    followed, index = seen.mean(axis=0) > _FOLLOWED, np.arange(seen.shape[1])
    if not followed.any():
        return trial.registration
    known = index[followed]
    return np.stack([np.interp(index, known, trial.registration[known, axis]) for axis in (0, 1)], axis=1)


def _swings(trial: ComparedTrial) -> tuple[Swing, ...]:
    if trial.head is None:
        return ()
    real, simulated = trial.head.real, trial.head.simulated
    unknown = np.full_like(real.yaw, np.nan)
    yaw, sway = (unknown, unknown) if simulated is None else (simulated.yaw, simulated.sway)
    return (
        Swing("heading of the head about its path", "deg", np.degrees(real.yaw), np.degrees(yaw)),
        Swing("place of the head beside its path", "mm", 1e3 * real.sway, 1e3 * sway),
    )


def _paths(trial: ComparedTrial) -> tuple[Array, Array] | tuple[None, None]:
    """Both paths as seen from the start; with a beat the swims lie along an axis already. Shapes (T, M, 2)."""
    if trial.progress is None or trial.frame is None:
        return None, None
    if trial.frequency is not None:
        return trial.path_real, trial.path_simulated
    framed = np.flatnonzero(trial.framed)
    if not framed.size:
        return None, None
    real, simulated = (_seen_from(path, framed[0], trial.frame) for path in (trial.path_real, trial.path_simulated))
    return real, simulated


def _seen_from(path: Array, sample: int, frame: tuple[int, int]) -> Array:
    """Positions from the origin and along the axes that the frame has in one sample. Shape (T, M, 2)."""
    along = frames.body_axes(path[sample : sample + 1], frame)[0]
    left = np.array([-along[1], along[0]])
    return (path - path[sample, frame[0]]) @ np.stack([along, left], axis=1)


def _axes(trial: ComparedTrial, robot: Robot) -> str:
    if trial.frequency is not None:
        return "body frame, head at the left"
    if trial.frame is None:
        right, up = (_AXES[axis] for axis in robot.plane)
        return f"{right} right, {up} up"
    origin, ahead = (robot.marker_names[marker] for marker in trial.frame)
    return f"{origin} at the origin, {ahead} to its right"


def _joined(links: Sequence[tuple[int, int]]) -> tuple[tuple[int, ...], ...]:
    """The links, those that follow on one another joined to one line."""
    lines: list[list[int]] = []
    for start, end in links:
        if lines and lines[-1][-1] == start:
            lines[-1].append(end)
        else:
            lines.append([start, end])
    return tuple(tuple(line) for line in lines)


def _box(real: Sequence[Array], simulated: Sequence[Array]) -> Box:
    """Around all known positions, the simulated ones moved to within reach of the real ones; neither flat nor tall."""
    true, made = (np.concatenate([array.reshape(-1, 2) for array in arrays]) for arrays in (real, simulated))
    true, made = true[np.isfinite(true).all(axis=1)], made[np.isfinite(made).all(axis=1)]
    if len(true) and len(made):
        low, high = true.min(axis=0), true.max(axis=0)
        reach = _BEYOND * float((high - low).max())
        made = np.clip(made, low - reach, high + reach)
    points = np.concatenate([true, made])
    if not len(points):
        return Box(-0.5, -0.3, 0.5, 0.3)
    margin = _MARGIN * max(float(np.ptp(points, axis=0).max()), 1e-6)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    middle, size = (low + high) / 2, high - low
    size[1] = max(size[1], _LEAST_SHARE * size[0])
    size[0] = max(size[0], size[1] / _MOST_SHARE)
    left, bottom, right, top = *(middle - size / 2).tolist(), *(middle + size / 2).tolist()
    return Box(left, bottom, right, top)
