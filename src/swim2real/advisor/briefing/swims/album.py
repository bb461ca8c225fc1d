"""The swims of a comparison, ready to be drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from swim2real.objective import ComparedTrial, Comparison
from swim2real.rendering.clip import write_clip
from swim2real.rendering.drawing import Bytes
from swim2real.rendering.swim_frame import draw_frame
from swim2real.rendering.swim_sheet import beat_sheet, clip_sheet
from swim2real.rendering.swim_view import Limits, SwimView, common_limits

_FOLLOWED = 0.5  # share of frames in which a marker is seen, for its static offset to be believed


class SwimAlbum:
    """All swims, by frequency. An `Album`."""

    def __init__(self, comparison: Comparison, marker_names: Sequence[str]) -> None:
        swims = sorted(comparison.trials, key=lambda trial: trial.frequency or 0.0)
        self._views = [swim_view(trial, marker_names) for trial in swims]
        self._limits = common_limits(self._views)
        losses = [trial.loss for trial in swims]
        self.scenes = [SwimScene(view, loss, self._limits) for view, loss in zip(self._views, losses, strict=True)]

    def overview(self, moments: int, width: int) -> Bytes:
        return beat_sheet(self._views, moments, width, self._limits)


class SwimScene:
    """One swim. A `Scene`."""

    clip_note = "above in the body frame, below side by side in the world frame"
    film_note = "moments of one beat"

    def __init__(self, view: SwimView, loss: float, limits: Limits) -> None:
        self._view, self._limits, self.loss = view, limits, loss
        self.name, self.title = view.name, f"{view.name}, {view.frequency:.2f} Hz"
        self.pace, self.start, self.duration = view.frequency, 0.0, view.duration

    def write_clip(self, path: str | Path, fps: float, width: int) -> None:
        write_clip(self._view, lambda index: draw_frame(self._view, index, self._limits, width), path, fps)

    def sheet(self, moments: int, columns: int, width: int) -> Bytes:
        return clip_sheet(self._view, moments, columns, width, self._limits)

    def sheet_note(self, moments: int) -> str:
        return f"{moments} moments of one beat, then both courses over the whole time"

    def film_times(self, moments: int) -> list[float]:
        period = 1 / self._view.frequency
        return (np.arange(moments) / moments * period + max(self.duration - period, 0) / 2).tolist()


def swim_view(trial: ComparedTrial, marker_names: Sequence[str]) -> SwimView:
    """A compared swim as it is drawn: registered, as the loss sees it."""
    hidden = np.nan if trial.divergence else 0.0
    seen = trial.weights > 0
    followed, index = seen.mean(axis=0) > _FOLLOWED, np.arange(len(marker_names))
    offsets = trial.registration
    if followed.any():  # the offset of a marker that was mostly lost says little; its neighbors' say more
        known = index[followed]
        offsets = np.stack([np.interp(index, known, trial.registration[known, axis]) for axis in (0, 1)], axis=1)
    return SwimView(
        trial.name, trial.times, seen, trial.real, trial.simulated + offsets + hidden, tuple(marker_names),
        trial.frequency or 0.0, trial.path_real, trial.path_simulated + hidden,
    )  # fmt: skip
