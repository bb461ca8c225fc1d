"""Real films: frames at given times, small copies, and sheets of moments, with time and number burned in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markertrack.drawing import DARK, PAGE, Bytes, Canvas, contact_sheet, to_pillow
from markertrack.video import Frame, VideoReader, VideoWriter
from swimbase.errors import ArgumentError

LEAST_WIDTH = 64  # px
ROUNDING = 1e-6  # s
CRF = 32  # thin lines and text stay clear, and 4 s at 10 frames per second take some 80 kB


def film_frames(
    video: str | Path, times: Iterable[float], width: int, rate: float | None = None
) -> Iterator[tuple[float, Bytes]]:
    """The frames of a film that are nearest to given times, upright and scaled, with time and number burned in.

    The film is read once, from its start to the last time, and one frame at a time is in memory.

    Args:
        video: Path of the film.
        times: Times since its first frame, rising [s]. They end with the film, half a frame after its last one.
        width: Width of the pictures, even [px].
        rate: Frames per second that the camera took; by default as the film states it.

    Yields:
        Time of each frame [s] and its picture, RGB. Shape (H, width, 3).

    Raises:
        ArgumentError: The times don't rise, or the width is odd or too small.
        VideoError: The film can't be read.
    """
    if width < LEAST_WIDTH or width % 2:
        raise ArgumentError(f"width is {width} px; it must be even and at least {LEAST_WIDTH}")
    wanted = _rising(times)
    time = next(wanted, None)
    with VideoReader(video, fps=rate) as reader:
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


def film_clip(
    video: str | Path, path: str | Path, fps: float, width: int = 640, seconds: float | None = None, start: float = 0.0,
    rate: float | None = None,
) -> None:  # fmt: skip
    """Writes a small copy of a real film, upright, in true speed, with frame number and time burned in.

    Args:
        video: Path of the film.
        path: Path of the copy, such as `.mp4`.
        fps: Frames a second; each shows the frame of the film nearest to its time.
        width: Width of the copy, even [px].
        seconds: Seconds that are copied; None for all that there are.
        start: Start of the copy, since the film's first frame [s].
        rate: Frames per second that the camera took; by default as the film states it.

    Raises:
        ArgumentError: The width, fps, seconds or start are not allowed, or the film ends before the start.
        VideoError: The film can't be read or the copy can't be written.
    """
    if Path(path).absolute() == Path(video).absolute():
        raise ArgumentError(f"the copy of '{video}' would replace it; give path another name")
    if seconds is not None and not seconds >= 0:
        raise ArgumentError(f"seconds is {seconds}; it must be 0 or more, or None for the whole film")
    _check_fps(fps)
    times = (start + k / fps for k in itertools.count())
    if seconds is not None:
        times = itertools.takewhile(lambda time: time <= start + seconds + ROUNDING, times)
    frames = film_frames(video, times, width, rate)
    first = next(frames, None)
    if first is None:
        raise ArgumentError(f"the film '{video}' ends before start, {start:g} s; give a start within the film")
    with VideoWriter(path, width, first[1].shape[0], fps, crf=CRF) as writer:
        writer.write(first[1], 0.0)
        for k, (_, image) in enumerate(frames, 1):
            writer.write(image, k / fps)


def film_sheet(video: str | Path, times: Sequence[float], columns: int, width: int, rate: float | None = None) -> Bytes:
    """Frames of a real film, upright, with time and number burned in.

    Args:
        video: Path of the film.
        times: Times since its first frame, rising [s]; each shows the nearest frame. Those after the end are left out.
        columns: Pictures in a row.
        width: Width of each picture, even [px].
        rate: Frames per second that the camera took; by default as the film states it.

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No time lies within the film, the times don't rise, or a number is not allowed.
        VideoError: The film can't be read.
    """
    frames = list(film_frames(video, times, width, rate))
    if not frames:
        raise ArgumentError(f"none of the {len(times)} times lies within '{video}'; give times within the film, in s")
    captions = [f"{time:.3f} s" for time, _ in frames]
    return contact_sheet([image for _, image in frames], captions, columns, width)


def clip_times(duration: float, fps: float) -> NDArray[np.float64]:
    """Times of the frames of a clip [s]. Shape (N,).

    Args:
        duration: Duration of what it shows [s].
        fps: Frames a second.
    """
    _check_fps(fps)
    return np.arange(int(duration * fps + ROUNDING) + 1) / fps


def _check_fps(fps: float) -> None:
    if not (math.isfinite(fps) and fps > 0):
        raise ArgumentError(f"fps is {fps}; it must be finite and above 0 frames per second")


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
