"""A film of an episode from above: the robot's midline and fins, the path of its head, its goal, and the motor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.rendering.drawing import INK, PAGE, Canvas, Color, plain
from swim2real.rl.body import FISH_LAYOUT
from swim2real.rl.rollout import Episode
from swim2real.video.writer import VideoWriter

Array = NDArray[np.float64]

_BODY: Color = (21, 88, 176)
_PATH: Color = (162, 172, 185)
_GOAL: Color = (198, 40, 40)
_REACHED: Color = (26, 122, 60)
_MARGIN = 0.12  # m
_MIDLINE = FISH_LAYOUT.midline_markers  # the two after them are the fin tips
FPS = 25


def write_film(path: str | Path, episode: Episode, width: int = 720, threshold: float | None = None) -> Path:
    """Writes a film at half the control rate, in real time.

    Args:
        path: File to write.
        episode: Episode to show.
        width: Width of the pictures [px].
        threshold: Radius of the goal [m]; None for a dot.

    Raises:
        VideoError: The file can't be written.
    """
    low, high = _box(episode)
    scale = width / (high[0] - low[0])
    height = round(scale * (high[1] - low[1]) / 2) * 2

    def place(point: Array) -> tuple[float, float]:
        return scale * float(point[0] - low[0]), scale * float(high[1] - point[1])

    stride = max(1, round(episode.rate / FPS))
    with VideoWriter(path, width, height, episode.rate / stride) as writer:
        for k in range(0, len(episode.markers), stride):
            canvas, markers = Canvas(plain(width, height, PAGE)), episode.markers[k]
            if episode.goal is not None:
                here = place(episode.goal)
                reached = episode.success and k + stride >= len(episode.markers)
                canvas.dot(here, 4.0, _REACHED if reached else _GOAL)
                if threshold is not None:
                    canvas.ring(here, max(3.0, scale * threshold), _REACHED if reached else _GOAL, 1.5)
            path_points = episode.heads[: k + 2]
            canvas.polyline([place(point) for point in path_points[:: max(1, len(path_points) // 200)]], _PATH, 1.5)
            if len(markers) > _MIDLINE + 1:
                fins = (markers[_MIDLINE], (markers[0] + markers[1]) / 2, markers[_MIDLINE + 1])
                canvas.polyline([place(point) for point in fins], _BODY, 2.0)
            canvas.polyline([place(point) for point in markers[:_MIDLINE]], _BODY, 4.0)
            for point in markers[:_MIDLINE]:
                canvas.dot(place(point), 3.0, INK)
            text = f"{(k + 1) / episode.rate:5.2f} s   motor {episode.commands[k] / (2 * np.pi):+.2f} Hz"
            canvas.text((10, 8), text, INK, 16)
            writer.write(canvas.pixels())
    return Path(path)


def _box(episode: Episode) -> tuple[Array, Array]:
    """The corners of the region that is shown, at least as high as a third of its width [m]."""
    points = [episode.markers.reshape(-1, 2), episode.heads]
    if episode.goal is not None:
        points.append(episode.goal[None])
    everything = np.concatenate(points)
    low, high = everything.min(axis=0) - _MARGIN, everything.max(axis=0) + _MARGIN
    room = max(0.0, (high[0] - low[0]) / 3 - (high[1] - low[1])) / 2
    low[1], high[1] = low[1] - room, high[1] + room
    wide = max(0.0, (high[1] - low[1]) / 1.2 - (high[0] - low[0])) / 2  # not much taller than wide
    low[0], high[0] = low[0] - wide, high[0] + wide
    return low, high
