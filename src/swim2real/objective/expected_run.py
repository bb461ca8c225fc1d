"""Expected motion of a robot under a table of commands, and its comparison with a film.

The two markers of the robot's frame describe both, as from its start: x backward, y to the side, heading 0. So a hull
that rolls sways in the expectation as its markers do in the film.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import MinLen
from pydantic import BaseModel
from scipy.signal import find_peaks

from markertrack import frames
from swim2real.trials import Trial, TrialSet
from swimbase.arrays import Array
from swimbase.checking import Label, Number, Positive, read
from swimbase.errors import ArgumentError, TrialError

Series = Annotated[list[Number], MinLen(2)]

ENDING = ".expected.json"  # of the file's name, in place of the table's
_AT_REST = 0.1  # s after the first command, in which the film shows where the robot starts
_SHORT = 0.1  # s by which a film may end before the last command
_NEAR = 0.005  # m; a tracked path that is as near to the spread of the sets counts as within it
_SWING = 0.03  # rad; the heading of a beat swings by more


class Band(BaseModel):
    """A quantity over time.

    Attributes:
        expected: With the parameters that the policy was trained with. Shape (T,).
        low: The least of all parameter sets. Shape (T,).
        high: The greatest. Shape (T,).
    """

    expected: Series
    low: Series
    high: Series

    @staticmethod
    def of(rows: Array) -> Band:
        """The band of several sets' series, of which the first is the expected one. Shape (B, T)."""
        expected, low, high = (np.round(one, 6).tolist() for one in (rows[0], rows.min(axis=0), rows.max(axis=0)))
        return Band(expected=expected, low=low, high=high)


class ExpectedRun(BaseModel):
    """Expected motion under a table of commands.

    Attributes:
        robot: Name of the robot.
        task: Task of the policy.
        frame: Names of the two markers of its frame.
        origin: Where the point that stands for the robot is from the middle of these, in the frame [m].
        goal: Goal of the task [m]; None without one.
        threshold: Distance below which it is reached [m].
        rate: Rows a second [Hz]; the first is the start.
        sets: Number of parameter sets.
        x: Where the robot is, backward from its start [m].
        y: Where it is, to the side [m].
        heading: Its heading [rad].
        roll: Its roll, which a film from above doesn't show [rad]; None for a robot that doesn't roll.
        arrivals: When each set reaches the goal, the expected one first [s]; None where it doesn't.
    """

    format: Literal[1] = 1
    kind: Literal["expected run"] = "expected run"
    robot: Label
    task: str
    frame: tuple[Label, Label]
    origin: tuple[Number, Number]
    goal: tuple[Number, Number] | None
    threshold: Positive | None
    rate: Positive
    sets: int
    x: Band
    y: Band
    heading: Band
    roll: Band | None
    arrivals: Annotated[list[Number | None], MinLen(1)]

    @property
    def seconds(self) -> float:
        """Length of the table [s]."""
        return (len(self.x.expected) - 1) / self.rate

    @property
    def sentence(self) -> str:
        """Expectation for the end, in words."""
        came = [time for time in self.arrivals if time is not None]
        of = f" of {self.sets} sets" if self.sets > 1 else ""
        goal = f", goal reached by {len(came)}{of} after {min(came):.1f} to {max(came):.1f} s" if came else ""
        x, heading = self.x, np.degrees(self.heading.expected[-1])
        spread = f" ({-x.high[-1]:.3f} to {-x.low[-1]:.3f}{of})" if self.sets > 1 else ""
        roll = "" if self.roll is None else f", roll up to {np.degrees(np.abs(self.roll.expected).max()):.0f}°"
        return f"{-x.expected[-1]:.3f} m forward{spread}, heading {heading:.0f}°{roll}{goal}"


def read_expected_run(path: Path) -> ExpectedRun:
    """Reads an expected run.

    Raises:
        ArgumentError: The file is damaged.
    """
    run = read(ExpectedRun, path, "expected run", ArgumentError, "`swim2real export-commands` writes one")
    bands = [run.x, run.y, run.heading, *([] if run.roll is None else [run.roll])]
    if len({len(series) for band in bands for series in (band.expected, band.low, band.high)}) > 1:
        raise ArgumentError(f"expected run '{path}': its series differ in length; write it anew with export-commands")
    return run


def motion_of(markers: Array, pair: frames.Pair, origin: Array) -> tuple[Array, Array]:
    """Places and headings of a robot from its markers, NaN where its frame isn't seen.

    Args:
        markers: Positions of the markers [m]. Shape (T, M, 2).
        pair: The two markers of the frame.
        origin: The point that stands for the robot, from their middle, in the frame [m]. Shape (2,).

    Returns:
        Places [m] and headings without jumps [rad]. Shapes (T, 2) and (T,).
    """
    axes = frames.body_axes(markers, pair)
    headings = np.arctan2(axes[:, 1], axes[:, 0])
    seen = np.isfinite(headings)
    headings[seen] = np.unwrap(headings[seen])
    return frames.heads(markers, pair) + frames.composed(origin, axes), headings


def arrival(places: Array, rate: float, goal: tuple[float, float] | None, threshold: float | None) -> float | None:
    """When places, of which the first is the start, are nearer to a goal than a threshold [s]; None for never."""
    if goal is None or threshold is None:
        return None
    reached = np.flatnonzero(np.hypot(*(places - np.array(goal)).T) < threshold)
    return float(reached[0]) / rate if reached.size else None


Row = tuple[float | None, float | None, float | None, float | None]


@dataclass(frozen=True)
class _RealRun:
    """Motion of a real robot, beside the expected one.

    Attributes:
        trial: Name of the trial.
        came: Whether it reached its goal, or without one whether it ends within the spread of the sets; None where the
            film ends too early to say, or nothing spreads.
        seconds: Time after the first command that is compared [s].
        beats: Swings of the heading that the whole table is expected to make, and that the film shows.
        path_error: Root mean square distance from where it is expected at the same time [m].
        within: Share of the time that it is within the spread of the sets, in x and y, or at most 5 mm beside it; None
            with one set.
        goal_distance: Least distance from the goal, to the film's end [m]; None without a goal.
        figures: At the end of the time `forward` and `sideways` [m] and `heading` [rad], and the `arrival` at the goal
            [s]: each as expected, the least and the most of all sets, and measured; None for no arrival.
        sentence: What became of it, in words.
    """

    trial: str
    came: bool | None
    seconds: float
    beats: tuple[int, int]
    path_error: float
    within: float | None
    goal_distance: float | None
    figures: dict[str, Row]
    sentence: str


def compare_run(expected: ExpectedRun, trials: TrialSet, trial: Trial, begin: float | None = None) -> _RealRun:
    """Compares a real run with the expected one.

    Args:
        expected: The expected run.
        trials: The trials that it is one of, whose markers have names.
        trial: The trial.
        begin: Time of the first command on the trial's clock [s]; None for the first row of its controls, or without
            any for its first frame.

    Raises:
        ArgumentError: A marker of the frame has no track.
        TrialError: The robot isn't seen at its start or afterward.
    """
    if missing := [name for name in expected.frame if name not in trials.marker_names]:
        raise ArgumentError(
            f"the expected run of robot '{expected.robot}' has the markers {' and '.join(expected.frame)}; the "
            f"trials have {', '.join(trials.marker_names)}: track {missing[0]}, too"
        )
    if begin is None:
        begin = float((trial.track if trial.controls is None else trial.controls).times[0])
    one, other = (trials.marker_names.index(name) for name in expected.frame)
    places, headings = motion_of(trial.track.positions, (one, other), np.array(expected.origin))
    times, seen = trial.track.times - begin, np.isfinite(headings)
    first, last = seen & (np.abs(times) <= _AT_REST), float(times[seen].max(initial=-np.inf))
    if not first.any() or last <= 1 / expected.rate:
        raise TrialError(
            f"trial '{trial.name}': {expected.frame[0]} and {expected.frame[1]} must be seen within {_AT_REST:g} s of "
            f"the first command, at {begin:g} s, and afterward; give its time with --begin, or track them there"
        )
    start, turned = places[first].mean(axis=0), headings[first].mean()
    grid = np.arange(int(last * expected.rate + 1e-9) + 1) / expected.rate
    real = frames.components(places[seen] - start, np.array([np.cos(turned), np.sin(turned)]))
    x, y, heading = (np.interp(grid, times[seen], column) for column in (*real.T, headings[seen] - turned))
    path, n = np.column_stack([x, y]), min(len(grid), len(expected.x.expected))
    inside, off, rows = np.ones(n, np.bool_), np.zeros(n), dict[str, Row]()
    names = ("forward", expected.x, x), ("sideways", expected.y, y), ("heading", expected.heading, heading)
    for name, band, series in names:
        told, low, high = (np.array(each[:n]) for each in (band.expected, band.low, band.high))
        sign = -1.0 if name == "forward" else 1.0
        least, most = sorted((sign * float(low[-1]), sign * float(high[-1])))
        rows[name] = (sign * float(told[-1]), least, most, sign * float(series[n - 1]))
        if name != "heading":
            inside &= (series[:n] >= low - _NEAR) & (series[:n] <= high + _NEAR)
            off += (series[:n] - told) ** 2
    came_at = [time for time in expected.arrivals if time is not None]
    reached = arrival(path, expected.rate, expected.goal, expected.threshold)
    rows["arrival"] = (expected.arrivals[0], min(came_at, default=None), max(came_at, default=None), reached)
    cut = last < expected.seconds - _SHORT
    came = bool(inside[-1]) if expected.goal is None else reached is not None
    unknown = (expected.sets == 1 or cut) if expected.goal is None else (cut and not came)
    nearest = None if expected.goal is None else float(np.hypot(*(path - np.array(expected.goal)).T).min())
    one, other = (len(find_peaks(each, prominence=_SWING)[0]) for each in (expected.heading.expected, heading[:n]))
    beats = one, other
    return _RealRun(
        trial.name, None if unknown else came, float(grid[n - 1]), beats, float(np.sqrt(off.mean())),
        None if expected.sets == 1 else float(inside.mean()), nearest, rows,
        f"{trial.name}: {_sentence(rows, nearest, unknown, expected.seconds, float(grid[n - 1]), beats)}",
    )  # fmt: skip


def _sentence(
    rows: dict[str, Row], nearest: float | None, unknown: bool, table: float, seconds: float, beats: tuple[int, int]
) -> str:
    told, low, high, measured = rows["forward" if nearest is None else "arrival"]
    spread = "" if low == high else f", {low:.2f} to {high:.2f}"
    if nearest is None:
        said = f"{measured:.3f} m forward in {seconds:.1f} s, expected {told:.3f}{spread}"
    else:
        said = f"it did not come: {nearest:.2f} m from the goal at its nearest"
        if measured is not None:
            said = f"it came: goal reached after {measured:.1f} s"
        elif unknown:
            said = "whether it came isn't in the film"
        said += f", expected {'not to' if told is None else f'after {told:.1f} s'}{spread}"
    if seconds < table - _SHORT:
        said += f"; the film ends at {seconds:.1f} s, the commands at {table:.1f} s: give all of it"
    if beats[1] < beats[0] - 1:
        said += f"; it shows {beats[1]} of {beats[0]} beats: look at the motor's log"
    return said
