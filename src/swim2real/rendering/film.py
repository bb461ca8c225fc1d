"""Frames of a real film at given times, scaled, with their time burned in."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import DARK, PAGE, Bytes, Canvas, to_pillow
from swim2real.video import Frame, VideoReader

LEAST_WIDTH = 64  # px


def film_frames(video: str | Path, times: Iterable[float], width: int) -> Iterator[tuple[float, Bytes]]:
    """The frames of a film that are nearest to given times, upright and scaled, with time and number burned in.

    The film is read once, from its start to the last time, and one frame at a time is in memory.

    Args:
        video: Of the film.
        times: Since its first frame, rising [s]. They end with the film, half a frame after its last one.
        width: Of the pictures, even [px].

    Yields:
        Time of each frame [s] and its picture, RGB. Shape (H, width, 3).

    Raises:
        ArgumentError: The times don't rise, or the width is odd or too small.
        VideoError: The film can't be read.
        MissingExtraError: PyAV or Pillow isn't installed.
    """
    if width < LEAST_WIDTH or width % 2:
        raise ArgumentError(f"width is {width} px; it must be even and at least {LEAST_WIDTH}")
    wanted = _rising(times)
    time = next(wanted, None)
    with VideoReader(video) as reader:
        before: Frame | None = None
        for frame in reader:
            if before is not None and time is not None and time <= (before.time + frame.time) / 2:
                picture = _drawn(before, width)
                while time is not None and time <= (before.time + frame.time) / 2:
                    yield before.time, picture
                    time = next(wanted, None)
            if time is None:
                return
            before = frame
        if before is not None:
            picture, end = _drawn(before, width), before.time + 0.5 / reader.info.fps
            while time is not None and time <= end:
                yield before.time, picture
                time = next(wanted, None)


def _rising(times: Iterable[float]) -> Iterator[float]:
    last = -math.inf
    for time in times:
        if not (math.isfinite(time) and time >= 0 and time > last):
            raise ArgumentError(f"a time of a film is {time} s; it must be finite, 0 or more, and later than the last")
        yield time
        last = time


def _drawn(frame: Frame, width: int) -> Bytes:
    canvas, size = Canvas(to_pillow(frame.scaled(width))), float(np.clip(round(width / 32), 12, 26))
    text = f"{frame.time:.3f} s   frame {frame.index}"
    canvas.text((0.6 * size, 0.4 * size), text, PAGE, size, plate=DARK)
    return canvas.pixels()
