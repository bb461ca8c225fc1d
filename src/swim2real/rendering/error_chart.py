"""A small chart of how far a playback is from its recording over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swim2real.rendering.drawing import INK, PAGE, Canvas, plain
from swim2real.rendering.panel import GRID, GROUND, MUTED, START, points
from swim2real.rendering.playback_view import PlaybackView, length_text, millimeters

if TYPE_CHECKING:
    from PIL.Image import Image

HEIGHT = 5.5  # times the size of its text
_DOT = 3.5  # px


class ErrorChart:
    """The mean distance of a trial's markers over time; what doesn't change from moment to moment is drawn once."""

    def __init__(self, view: PlaybackView, top: float, width: int, size: float) -> None:
        """Draws the curve.

        Args:
            view: The recording.
            top: Distance at the upper edge [m].
            width: Of the picture [px].
            size: Of the text [px].
        """
        small, height = 0.8 * size, round(HEIGHT * size)
        self._image = plain(width, height, PAGE)
        canvas = Canvas(self._image)
        head, foot = round(1.4 * size), round(1.3 * small)
        canvas.fill((0, head, width, height - foot), GROUND)
        canvas.fill((0, height - foot - 1, width, height - foot), GRID)
        canvas.fill((0, head, width, head + 1), GRID)
        shares = (view.times - view.times[0]) / view.duration
        level = head + (height - foot - 1 - head) * (1 - np.minimum(view.errors / top, 1.0))
        self._places = np.stack([shares * (width - 1), level], axis=1)
        self._range, self._size = (head, height - foot), size
        canvas.polyline(points(self._places), INK, 1.6)
        canvas.text((0, height - foot / 2), f"{view.times[0]:.2f} s", MUTED, small, (0, 0.5))
        canvas.text((width, height - foot / 2), f"{view.times[-1]:.2f} s", MUTED, small, (1, 0.5))
        scale = f"mean {millimeters(view.error)}   full height {length_text(top)}"
        canvas.text((width / 2, height - foot / 2), scale, MUTED, small, (0.5, 0.5))
        self._errors = view.errors.tolist()

    def at(self, *moments: int, text: str = "distance of the markers, simulated to real") -> Image:
        """The chart with lines at moments; of a single one, its distance is written.

        Args:
            moments: Samples.
            text: Above the chart.
        """
        image = self._image.copy()
        canvas, (top, bottom) = Canvas(image), self._range
        for moment in moments:
            column = round(self._places[moment, 0])
            canvas.fill((column, top, column + 1, bottom), START)
            if np.isfinite(self._places[moment]).all():
                x, y = self._places[moment].tolist()
                canvas.dot((x, y), _DOT, INK)
        if len(moments) == 1:
            text += f": {millimeters(self._errors[moments[0]])}"
        canvas.text((0, top / 2), text, INK, 0.9 * self._size, (0, 0.5))
        return image
