"""Clips for a VLM and for people: a simulated trial over its real one, and the real film itself, small."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import Bytes
from swim2real.rendering.film import film_frames
from swim2real.rendering.view import View
from swim2real.video import VideoWriter

ROUNDING = 1e-6  # s
CRF = 32  # thin lines and text stay clear, and 4 s at 10 frames a second take some 80 kB


def write_clip(view: View, draw: Callable[[int], Bytes], path: str | Path, fps: float) -> None:
    """Writes a film of a simulated trial over its real one, in true speed.

    Args:
        view: The trial.
        draw: Makes the picture of a sample, all in one size.
        path: Of the film, such as `.mp4`.
        fps: Frames a second; each shows the sample nearest to its time.

    Raises:
        ArgumentError: The fps is not allowed, or what `draw` raises.
        VideoError: The file can't be written.
        MissingExtraError: Pillow or PyAV isn't installed.
    """
    times = clip_times(view.duration, fps)
    samples = view.nearest(view.times[0] + times).tolist()
    image = draw(samples[0])
    with VideoWriter(path, image.shape[1], image.shape[0], fps, crf=CRF) as writer:
        for k, (time, sample) in enumerate(zip(times.tolist(), samples, strict=True)):
            writer.write(image if k == 0 else draw(sample), time)


def film_clip(
    video: str | Path, path: str | Path, fps: float, width: int = 640, seconds: float | None = None, start: float = 0.0
) -> None:
    """Writes a small copy of a real film, upright, in true speed, with frame number and time burned in.

    Args:
        video: Of the film.
        path: Of the copy, such as `.mp4`.
        fps: Frames a second; each shows the frame of the film nearest to its time.
        width: Of the copy, even [px].
        seconds: That are copied; None for all that there is.
        start: Of the copy, since the film's first frame [s].

    Raises:
        ArgumentError: The width, fps, seconds or start are not allowed, or the film ends before the start.
        VideoError: The film can't be read or the copy can't be written.
        MissingExtraError: Pillow or PyAV isn't installed.
    """
    if Path(path).absolute() == Path(video).absolute():
        raise ArgumentError(f"the copy of '{video}' would replace it; give path another name")
    if seconds is not None and not seconds >= 0:
        raise ArgumentError(f"seconds is {seconds}; it must be 0 or more, or None for the whole film")
    _check_fps(fps)
    times = (start + k / fps for k in itertools.count())
    if seconds is not None:
        times = itertools.takewhile(lambda time: time <= start + seconds + ROUNDING, times)
    frames = film_frames(video, times, width)
    first = next(frames, None)
    if first is None:
        raise ArgumentError(f"the film '{video}' ends before start, {start:g} s; give a start within the film")
    with VideoWriter(path, width, first[1].shape[0], fps, crf=CRF) as writer:
        writer.write(first[1], 0.0)
        for k, (_, image) in enumerate(frames, 1):
            writer.write(image, k / fps)


def clip_times(duration: float, fps: float) -> NDArray[np.float64]:
    """Times of the frames of a clip [s]. Shape (N,).

    Args:
        duration: Of what it shows [s].
        fps: Frames a second.
    """
    _check_fps(fps)
    return np.arange(int(duration * fps + ROUNDING) + 1) / fps


def _check_fps(fps: float) -> None:
    if not (math.isfinite(fps) and fps > 0):
        raise ArgumentError(f"fps is {fps}; it must be finite and above 0 frames a second")
