"""A film of episodes as the camera sees them: the robots' markers, the paths that they took, goals, and commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markertrack.drawing import INK, PAGE, Canvas, Color, plain
from markertrack.video.writer import VideoWriter
from swim2real.rl.rollout import Episode
from swim2real.robots.robot import Robot
from swimbase.arrays import Array

_BODY: Color = (21, 88, 176)
_PATH: Color = (162, 172, 185)
_GOAL: Color = (198, 40, 40)
_REACHED: Color = (26, 122, 60)
_MARGIN = 0.2  # of the robot's length
FPS = 25


@dataclass(frozen=True)
class Scene:
    """An episode that is shown.

    Attributes:
        title: What is written above it.
        episode: The episode.
        robot: Its robot.
    """

    title: str
    episode: Episode
    robot: Robot


def write_film(path: str | Path, scenes: Sequence[Scene], width: int = 720, threshold: float | None = None) -> Path:
    """Writes a film of one or several episodes side by side, at half the control rate, in real time.

    Args:
        path: File to write.
        scenes: Episodes to show, in equal panels of one scale; one that ends early stays as it ended.
        width: Width of the pictures [px].
        threshold: Radius of goals [m]; None for a dot.

    Raises:
        VideoError: The file can't be written.
    """
    columns = math.ceil(math.sqrt(len(scenes)))
    rows = math.ceil(len(scenes) / columns)
    low, high = _box(scenes)
    panel_width = width // columns // 2 * 2
    scale = panel_width / (high[0] - low[0])
    panel_height = round(scale * (high[1] - low[1]) / 2) * 2
    stride = max(1, round(scenes[0].episode.rate / FPS))
    longest = max(len(scene.episode.markers) for scene in scenes)
    with VideoWriter(path, panel_width * columns, panel_height * rows, scenes[0].episode.rate / stride) as writer:
        for k in range(0, longest, stride):
            picture = np.empty((panel_height * rows, panel_width * columns, 3), np.uint8)
            picture[:] = PAGE
            for i, scene in enumerate(scenes):
                canvas = Canvas(plain(panel_width, panel_height, PAGE))
                last = len(scene.episode.markers) - 1
                _draw(canvas, scene, min(k, last), k + stride > last, (low, high, scale), threshold)
                top, left = i // columns * panel_height, i % columns * panel_width
                picture[top : top + panel_height, left : left + panel_width] = canvas.pixels()
            writer.write(picture)
    return Path(path)


def _draw(
    canvas: Canvas, scene: Scene, k: int, over: bool, view: tuple[Array, Array, float], threshold: float | None
) -> None:
    episode, robot = scene.episode, scene.robot
    low, high, scale = view

    def place(point: Array) -> tuple[float, float]:
        return scale * float(point[0] - low[0]), scale * float(high[1] - point[1])

    if episode.goal is not None:
        here, color = place(episode.goal), _REACHED if episode.success and over else _GOAL
        canvas.dot(here, 4.0, color)
        if threshold is not None:
            canvas.ring(here, max(3.0, scale * threshold), color, 1.5)
    path_points = episode.heads[: k + 2]
    canvas.polyline([place(point) for point in path_points[:: max(1, len(path_points) // 200)]], _PATH, 1.5)
    markers, first = episode.markers[k], episode.markers[0]
    known = len(robot.marker_names)
    for site in range(known, len(markers)):  # a further site hangs on the marker that is nearest at the start
        nearest = int(np.argmin(np.square(first[:known] - first[site]).sum(axis=1)))
        canvas.polyline([place(markers[site]), place(markers[nearest])], _BODY, 2.0)
    for i, j in robot.links:
        canvas.polyline([place(markers[i]), place(markers[j])], _BODY, 4.0)
    for point in markers[:known]:
        canvas.dot(place(point), 3.0, INK)
    commands = ", ".join(f"{command:+.2f}" for command in episode.commands[k])
    canvas.text((10, 8), f"{scene.title}  {(k + 1) / episode.rate:5.2f} s  {commands}".strip(), INK, 16)


def _box(scenes: Sequence[Scene]) -> tuple[Array, Array]:
    """The corners of the region that is shown, at least as high as a third of its width [m]."""
    points = [part for scene in scenes for part in (scene.episode.markers.reshape(-1, 2), scene.episode.heads)]
    points += [scene.episode.goal[None] for scene in scenes if scene.episode.goal is not None]
    everything = np.concatenate(points)
    margin = _MARGIN * float(np.ptp(scenes[0].robot.rest_markers, axis=0).max())
    low, high = everything.min(axis=0) - margin, everything.max(axis=0) + margin
    room = max(0.0, (high[0] - low[0]) / 3 - (high[1] - low[1])) / 2
    low[1], high[1] = low[1] - room, high[1] + room
    wide = max(0.0, (high[1] - low[1]) / 1.2 - (high[0] - low[0])) / 2  # not much taller than wide
    low[0], high[0] = low[0] - wide, high[0] + wide
    return low, high
