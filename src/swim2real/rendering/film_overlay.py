"""Simulated markers on a film of the real robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from swim2real.rendering.drawing import DARK, Bytes, Canvas, Color, Place, to_pillow
from swim2real.video import VideoWriter

Array = NDArray[np.float64]

REAL: Color = (255, 82, 82)
SIMULATED: Color = (64, 156, 255)
EDGE = 1.0  # px


class FilmOverlay:
    """Writes a film with real markers as red rings and simulated ones as blue dots with lines. A context manager.

    Attributes:
        width: Width of the pictures [px]: `Frame.scaled(overlay.width)` fits.
        height: Their height [px].
    """

    def __init__(
        self, path: str | Path, size: tuple[int, int], fps: float, lines: Sequence[Sequence[int]],
        longest_side: int = 1280,
    ) -> None:  # fmt: skip
        """Opens the file.

        Args:
            path: Path of the film to write, such as `.mp4`.
            size: Width and height of the upright film [px].
            fps: Frames a second.
            lines: Indices of the markers that each line goes through.
            longest_side: To which the film is scaled down [px]. A smaller film keeps its size.

        Raises:
            VideoError: The file can't be written.
        """
        share = min(1.0, longest_side / max(size))
        self.width = max(2, 2 * round(share * size[0] / 2))
        self.height = max(2, 2 * round(self.width * size[1] / size[0] / 2))  # as `Frame.scaled` has it
        self._share = np.array([self.width, self.height]) / size
        self._lines = lines
        self._radius = max(3.0, self.width / 260)
        self._writer = VideoWriter(path, self.width, self.height, fps)
        self._begin: float | None = None

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self._writer.__exit__(kind, *error)

    def add(self, image: Bytes, time: float, real: Array, simulated: Array) -> None:
        """Adds a frame.

        Args:
            image: The upright film, RGB, in the overlay's size. Shape (height, width, 3).
            time: Time of the frame; the film that is written begins at the first one [s].
            real: Real markers in the film, NaN where unknown [px]. Shape (M, 2).
            simulated: Simulated markers in the film [px]. Shape (M, 2).

        Raises:
            VideoError: The time doesn't follow the last one, or the file can't be written.
        """
        canvas = Canvas(to_pillow(image))
        for place in self._places(real):
            if self._within(place):
                canvas.ring(place, 1.9 * self._radius, REAL, 2.0, EDGE)
        places = self._places(simulated)
        for line in self._lines:
            canvas.polyline([places[m] for m in line], SIMULATED, 2.2, EDGE, 0.9)
        for place in places:
            if self._within(place):
                canvas.dot(place, self._radius, SIMULATED, EDGE)
        size = 15.0 if self.width >= 640 else 11.0
        canvas.text((0.8 * size, 0.8 * size), "simulated", SIMULATED, size, plate=DARK)
        canvas.text((7.5 * size, 0.8 * size), "tracked", REAL, size, plate=DARK)
        self._begin = time if self._begin is None else self._begin
        self._writer.write(canvas.pixels(), time - self._begin)

    def _places(self, positions: Array) -> list[Place]:
        scaled = (positions + 0.5) * self._share - 0.5
        return [(float(x), float(y)) for x, y in scaled]

    def _within(self, place: Place) -> bool:
        return -50 < place[0] < self.width + 50 and -50 < place[1] < self.height + 50
