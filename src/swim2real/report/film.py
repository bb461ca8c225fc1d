"""The film on a run's page: the markers of each trial, small enough to lie within the page, for its script to draw."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markertrack import frames
from swim2real.calibration import SavedTrial
from swim2real.objective import ComparedTrial
from swim2real.rendering.trial_view import TrialView, common_limits, grid_step, length_text, view_of
from swim2real.robots.robot import Robot
from swimbase.arrays import Array

Indices = NDArray[np.intp]

RATE = 30.0  # Hz, at most
STEP = 0.1  # mm of a whole number, at least
_MOST = 2**15 - 1
_LOST = -(2**15)  # the whole number of a marker that isn't known
_BYTES = 300_000  # of all films of a page, about
_FRAMES = (60, 900)  # of a film at most, where there are many and few trials


class Picture(NamedTuple):
    """Points in a plane as the page's script draws them.

    Positions are little-endian 16-bit numbers in base64, in the order frame, point, coordinate: multiples of `step`
    from the middle of the picture, the second coordinate up.

    Attributes:
        real: Real positions.
        simulated: Simulated positions.
        points: How many.
        step: [mm].
        lines: Indices of the points that each line goes through.
        width: Of what is shown [mm].
        height: Of what is shown [mm].
        grid: Distance of the lines behind the robot [mm].
    """

    real: str
    simulated: str
    points: int
    step: float
    lines: tuple[tuple[int, ...], ...]
    width: float
    height: float
    grid: float

    @property
    def grid_text(self) -> str:
        """Distance of the lines behind the robot, in words."""
        return f"Lines are {length_text(self.grid / 1e3)} apart."


@dataclass(frozen=True)
class Film:
    """A trial as the page's script draws it.

    Attributes:
        name: Name of the trial, with its frequency where it has a beat.
        held_out: Whether it was left out of the fit.
        diverged: Whether there is nothing of the simulation.
        rate: Frames to a second [Hz].
        frames: How many.
        markers: How many, M.
        picture: The markers, the simulated ones moved as the loss sees them.
        cut: Seconds that are shown where the trial is longer; else None.
    """

    name: str
    held_out: bool
    diverged: bool
    rate: float
    frames: int
    markers: int
    picture: Picture
    cut: float | None


def films(trials: Sequence[SavedTrial], robot: Robot) -> tuple[Film, ...]:
    """A film of each trial; none for a robot without markers."""
    if not robot.marker_names:
        return ()
    shown = [(one, _view(one.compared, robot)) for one in trials if len(one.compared.times) > 1]
    whole = _BYTES * 3 / 4 / (8 * len(robot.marker_names) * max(len(trials), 1))
    most = int(np.clip(whole, *_FRAMES))
    return tuple(_film(one, view, most) for one, view in shown)


def _view(trial: ComparedTrial, robot: Robot) -> TrialView:
    """A trial with its paths as the loss sees them: the simulated one is registered, which turns with the body."""
    view = view_of(trial, robot)
    if view.path_simulated is None or trial.frequency is None or trial.frame is None:
        return view
    if trial.head is not None and trial.head.simulated is not None:
        real, simulated = trial.head.real.to_path(view.real), trial.head.simulated.to_path(view.simulated)
        return replace(view, path_real=real, path_simulated=simulated)
    axes = frames.body_axes(view.path_simulated, trial.frame)
    shift = frames.composed(view.simulated - trial.simulated, axes[:, None])
    return replace(view, path_simulated=view.path_simulated + shift)


def _film(saved: SavedTrial, view: TrialView, most: int) -> Film:
    rate = max(min(RATE, (len(view.times) - 1) / view.duration), 1 / view.duration)
    wanted = np.arange(0.0, view.duration + 0.5 / rate, 1 / rate)[:most]
    picked = view.nearest(view.times[0] + wanted)
    shown = float(wanted[-1])
    return Film(
        name=view.name if view.frequency is None else f"{view.frequency:.2f} Hz, {view.name}",
        held_out=saved.held_out,
        diverged=view.diverged,
        rate=round(rate, 4),
        frames=len(picked),
        markers=len(view.marker_names),
        picture=_picture(view, picked),
        cut=shown if shown < view.duration - 1.5 / rate else None,
    )


def _picture(view: TrialView, picked: Indices) -> Picture:
    limits = common_limits([view])
    box, real, simulated = limits.plane, view.real, view.simulated
    if limits.path is not None and view.path_real is not None and view.path_simulated is not None:
        box, real, simulated = limits.path, view.path_real, view.path_simulated
    middle = np.array([box.left + box.right, box.bottom + box.top]) / 2
    width, height = 1e3 * (box.right - box.left), 1e3 * (box.top - box.bottom)
    step = max(STEP, max(width, height) / _MOST)
    return Picture(
        real=_packed(1e3 * (real[picked] - middle) / step),
        simulated=_packed(1e3 * (simulated[picked] - middle) / step),
        points=real.shape[1],
        step=step,
        lines=view.lines,
        width=round(width, 1),
        height=round(height, 1),
        grid=round(1e3 * grid_step(box), 6),
    )


def _packed(numbers: Array) -> str:
    whole = np.where(np.isfinite(numbers), np.clip(np.rint(numbers), -_MOST, _MOST), _LOST)
    return base64.b64encode(whole.astype("<i2").tobytes()).decode()
