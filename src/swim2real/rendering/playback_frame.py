"""One moment of a playback over its recording: markers and links above, the error over time below."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import INK, PAGE, Bytes, Canvas, plain
from swim2real.rendering.error_chart import ErrorChart
from swim2real.rendering.labels import (
    check_width,
    draw_legends,
    draw_moment,
    draw_scale_bar,
    gap_of,
    text_height,
)
from swim2real.rendering.panel import MUTED, Panel
from swim2real.rendering.playback_panel import plane_panel, way_panel
from swim2real.rendering.playback_view import PlaybackLimits, PlaybackView, grid_step, length_text

if TYPE_CHECKING:
    from PIL.Image import Image

FROM_THE_START = "both from the same first pose"


class PlaybackFrames:
    """Draws the samples of a recording: the playback in blue over the recording in red."""

    def __init__(self, view: PlaybackView, limits: PlaybackLimits, width: int) -> None:
        """Draws what is the same in all of them.

        Args:
            view: The recording.
            limits: What is shown; `playback_limits` of all trials makes them comparable.
            width: Of the pictures, even [px].

        Raises:
            ArgumentError: The width is odd or too small.
            MissingExtraError: Pillow isn't installed.
        """
        check_width(width)
        self._view, self._limits, self._width = view, limits, width
        self._size, self._gap = text_height(width), gap_of(width)
        self._panel = Panel(limits.plane, width - 2 * self._gap, grid_step(limits.plane))
        self._chart = ErrorChart(view, limits.error, width - 2 * self._gap, self._size)

    def draw(self, index: int) -> Bytes:
        """One sample: RGB, of even sizes. Shape (H, width, 3).

        Raises:
            ArgumentError: There is no such sample.
        """
        view, size, gap = self._view, self._size, self._gap
        if not 0 <= index < view.times.size:
            raise ArgumentError(f"index is {index}; view '{view.name}' has samples 0 to {view.times.size - 1}")
        parts = [(gap, self._plane(index))]
        way = draw_way(view, index, self._limits, self._width)
        parts += [(0, way)] if way is not None else []
        parts += [(gap, self._chart.at(index))]
        head = round(2 * size)
        height = head + sum(part.height for _, part in parts) + gap
        canvas, y = Canvas(plain(self._width, height + height % 2, PAGE)), head
        draw_moment(canvas, view.name, "", view.times[index], index, size)
        for left, part in parts:
            canvas.paste(part, (left, y))
            y += part.height
        return canvas.pixels()

    def _plane(self, index: int) -> Image:
        image, size = plane_panel(self._view, index, self._panel, self._size), self._size
        canvas = Canvas(image)
        draw_legends(canvas, size)
        canvas.text((self._panel.width - 0.6 * size, size), self._view.axes, MUTED, 0.8 * size, (1, 0.5))
        draw_scale_bar(canvas, self._panel, length_text(self._panel.step), size)
        return image


def draw_way(view: PlaybackView, index: int, limits: PlaybackLimits, width: int) -> Image | None:
    """How far a robot that travels has come, and where to; None for one that doesn't.

    Args:
        view: The recording.
        index: Of the sample.
        limits: What is shown.
        width: Of the picture [px].
    """
    if limits.course is None or view.course_real is None:
        return None
    size, gap = text_height(width), gap_of(width)
    panel = Panel(limits.course, width - 2 * gap, grid_step(limits.course))
    head = round(1.8 * size)
    image = plain(width, head + panel.height, PAGE)
    canvas = Canvas(image)
    canvas.text((gap, head / 2), FROM_THE_START, INK, 0.9 * size, (0, 0.5))
    canvas.text((width - gap, head / 2), f"grid {length_text(panel.step)}", MUTED, 0.8 * size, (1, 0.5))
    canvas.paste(way_panel(view, index, panel), (gap, head))
    return image
