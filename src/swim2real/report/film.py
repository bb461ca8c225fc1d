"""The film on a run's page: the markers of each trial, small enough to lie within the page, for its script to draw."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import SavedTrial
from swim2real.objective import ComparedTrial
from swim2real.rendering.trial_view import TrialView, common_limits, grid_step, length_text, view_of
from swim2real.robots.robot import Robot
from swim2real.trials import frames

Array = NDArray[np.float64]

RATE = 30.0  # Hz, at most
STEP = 0.1  # mm of a whole number, at least
_MOST = 2**15 - 1
_LOST = -(2**15)  # the whole number of a marker that isn't known
_BYTES = 300_000  # of all films of a page, about
_FRAMES = (60, 900)  # of a film at most, where there are many and few trials


@dataclass(frozen=True)
class Film:
    """A trial as the page's script draws it.

    Positions are little-endian 16-bit numbers in base64, in the order frame, marker, coordinate: multiples of `step`
    from the middle of the picture, y up.

    Attributes:
        name: Name of the trial, with its frequency where it has a beat.
        held_out: Whether it was left out of the fit.
        diverged: Whether there is nothing of the simulation.
        rate: Frames to a second [Hz].
        frames: How many.
        markers: How many, M.
        real: Real positions.
        simulated: Simulated positions, moved as the loss sees them.
        step: [mm].
        lines: Indices of the markers that each line of the skeleton goes through.
        size: Width and height of what is shown [mm].
        grid: Distance of the lines behind the robot [mm].
        grid_text: The same in words.
        cut: Seconds that are shown where the trial is longer; else None.
    """

    name: str
    held_out: bool
    diverged: bool
    rate: float
    frames: int
    markers: int
    real: str
    simulated: str
    step: float
    lines: tuple[tuple[int, ...], ...]
    size: tuple[float, float]
    grid: float
    grid_text: str
    cut: float | None


def films(trials: Sequence[SavedTrial], robot: Robot) -> tuple[Film, ...]:
    """A film of each trial; none for a robot without markers."""
    if not robot.marker_names:
        return ()
    whole = _BYTES * 3 / 4 / (8 * len(robot.marker_names) * max(len(trials), 1))
    most = int(np.clip(whole, *_FRAMES))
    return tuple(_film(one, _view(one.compared, robot), most) for one in trials if len(one.compared.times) > 1)


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
    limits = common_limits([view])
    box, real, simulated = limits.plane, view.real, view.simulated
    if limits.path is not None and view.path_real is not None and view.path_simulated is not None:
        box, real, simulated = limits.path, view.path_real, view.path_simulated
    rate = max(min(RATE, (len(view.times) - 1) / view.duration), 1 / view.duration)
    wanted = np.arange(0.0, view.duration + 0.5 / rate, 1 / rate)[:most]
    between = (view.times[1:] + view.times[:-1]) / 2 - view.times[0]
    picked = np.searchsorted(between, wanted)  # the sample that is nearest to each
    middle = np.array([box.left + box.right, box.bottom + box.top]) / 2
    size = (1e3 * (box.right - box.left), 1e3 * (box.top - box.bottom))
    step = max(STEP, max(size) / _MOST)
    grid = grid_step(box)
    shown = float(wanted[-1])
    return Film(
        name=view.name if view.frequency is None else f"{view.frequency:.2f} Hz, {view.name}",
        held_out=saved.held_out,
        diverged=view.diverged,
        rate=round(rate, 4),
        frames=len(picked),
        markers=real.shape[1],
        real=_packed(1e3 * (real[picked] - middle) / step),
        simulated=_packed(1e3 * (simulated[picked] - middle) / step),
        step=step,
        lines=view.lines,
        size=(round(size[0], 1), round(size[1], 1)),
        grid=round(1e3 * grid, 6),
        grid_text=length_text(grid),
        cut=shown if shown < view.duration - 1.5 / rate else None,
    )


def _packed(numbers: Array) -> str:
    whole = np.where(np.isfinite(numbers), np.clip(np.rint(numbers), -_MOST, _MOST), _LOST)
    return base64.b64encode(whole.astype("<i2").tobytes()).decode()
