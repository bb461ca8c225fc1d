"""The recordings of a comparison, ready to be drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.briefing.recordings.axes import axes_of
from swim2real.objective import ComparedTrial, Comparison
from swim2real.objective.motion import finite_mean as mean
from swim2real.rendering.clip import write_clip
from swim2real.rendering.drawing import Bytes
from swim2real.rendering.playback_frame import PlaybackFrames
from swim2real.rendering.playback_sheet import moments_sheet, trials_overview
from swim2real.rendering.playback_view import PlaybackLimits, PlaybackView, playback_limits
from swim2real.robots.robot import Robot
from swim2real.trials import frames

Array = NDArray[np.float64]


class RecordingAlbum:
    """All recordings, in the order of the reference. An `Album`."""

    def __init__(self, comparison: Comparison, robot: Robot) -> None:
        trials = comparison.trials
        self._views = [playback_view(trial, robot) for trial in trials]
        self._limits = playback_limits(self._views)
        losses = [trial.loss for trial in trials]
        views = zip(self._views, losses, strict=True)
        self.scenes = [RecordingScene(view, loss, self._limits) for view, loss in views]

    def overview(self, moments: int, width: int) -> Bytes:
        return trials_overview(self._views, moments, width, self._limits)


class RecordingScene:
    """One recording. A `Scene`."""

    def __init__(self, view: PlaybackView, loss: float, limits: PlaybackLimits) -> None:
        self._view, self._limits, self.loss = view, limits, loss
        self.name = self.title = view.name
        self.pace, self.start, self.duration = view.pace, max(float(view.times[0]), 0.0), view.duration
        way = ", then both from the same first pose" if view.course_real is not None else ""
        self.clip_note = f"{view.axes}{way}; below the markers' mean distance over time"
        self.film_note = "the same moments"

    def write_clip(self, path: str | Path, fps: float, width: int) -> None:
        write_clip(self._view, PlaybackFrames(self._view, self._limits, width).draw, path, fps)

    def sheet(self, moments: int, columns: int, width: int) -> Bytes:
        return moments_sheet(self._view, moments, columns, width, self._limits)

    def sheet_note(self, moments: int) -> str:
        return f"{moments} moments from start to end with the markers' mean distance, then that distance over time"

    def film_times(self, moments: int) -> list[float]:
        return self._view.times[self._view.moments(moments)].clip(min=0.0).tolist()


def playback_view(trial: ComparedTrial, robot: Robot) -> PlaybackView:
    """A compared recording as it is drawn: in the plane of comparison, as the loss sees it."""
    seen = trial.weights > 0
    distance = np.where(seen, np.linalg.norm(trial.residual, axis=2), np.nan)
    real, simulated = _from_first_pose(trial) if trial.progress_real is not None else (None, None)
    return PlaybackView(
        trial.name, trial.times, seen, trial.real, trial.simulated, robot.marker_names,
        np.nan if trial.divergence else trial.aligned_marker_error, mean(distance.T), robot.links,
        axes_of(robot).picture, real, simulated,
    )  # fmt: skip


def _from_first_pose(trial: ComparedTrial) -> tuple[Array, Array] | tuple[None, None]:
    """Both in the frame in which each is when the real one is first seen. Shapes (T, M, 2)."""
    if trial.frame is None:
        return None, None
    framed = np.flatnonzero((trial.weights[:, trial.frame] > 0).all(axis=1))
    if not framed.size:
        return None, None
    real, simulated = (_seen_from(w, framed[0], trial.frame) for w in (trial.path_real, trial.path_simulated))
    return real, simulated


def _seen_from(world: Array, sample: int, frame: tuple[int, int]) -> Array:
    """Positions from the origin and along the axes that the frame has in one sample."""
    along = frames.body_axes(world[sample : sample + 1], frame)[0]
    left = np.array([-along[1], along[0]])
    return (world - world[sample, frame[0]]) @ np.stack([along, left], axis=1)
