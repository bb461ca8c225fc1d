"""From several videos to trials in one reference folder, each video in a process of its own."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import wait
from functools import partial
from pathlib import Path
from typing import Any

from markertrack.following import FrameProgress
from markertrack.span import WHOLE, Span
from markertrack.video import film_name
from swim2real.pipeline.tracking import TrackedVideo, track_video
from swim2real.processes import ProcessDiedError, ProcessPool
from swim2real.robots.robot import Robot
from swim2real.settings import TrackingSettings
from swimbase.errors import ArgumentError, Swim2RealError, TrackingError
from swimbase.names import composed, file_key

_POLL_INTERVAL = 0.2  # s between two looks at what the processes report
_progress: Any = None  # a process's end of the queue
Result = TrackedVideo | Swim2RealError


def track_videos(
    videos: Sequence[str | Path], points: Sequence[str | Path], robot: Robot, settings: TrackingSettings,
    folder: str | Path, *, corrections: Sequence[Path | None] | None = None,
    frequencies: Sequence[float | None] | None = None, controls: Sequence[Path | None] | None = None,
    sensors: Sequence[Path | None] | None = None, spans: Sequence[Span] | None = None,
    fps: Sequence[float | None] | None = None, workers: int | None = None,
    on_progress: Callable[[FrameProgress], None] = lambda progress: None,
    on_done: Callable[[str, Result], None] = lambda name, result: None,
) -> list[Result]:  # fmt: skip
    """Tracks videos into one reference folder. One that fails leaves the others alone.

    Args:
        videos: Paths of the videos, whose names become the trials'.
        points: Points file of each video, or "auto" to find its markers without a click.
        robot: Robot that carries the markers.
        settings: How to track.
        folder: Path of the reference folder.
        corrections: File of corrections of each video, None where there is none.
        frequencies: Frequency that the motor was commanded to turn at in each video [Hz], None where it isn't known.
        controls: Table of what drove the robot in each video, None where there is none.
        sensors: Table of what was measured in each video, None where there is none.
        spans: Stretch of each video that is tracked; None for all of all.
        fps: Frames per second that the camera took for each video, None where the film states it.
        workers: Number of processes at a time; None for as many as there are cores and videos.
        on_progress: Called now and then with the state of a video.
        on_done: Called when a video is done or has failed.

    Returns:
        The result of each video in order, or the error that it failed with.

    Raises:
        ArgumentError: The videos can't make one reference.
    """
    count = len(videos)
    names = [composed(film_name(Path(video))) for video in videos]
    keys = [file_key(name) for name in names]
    if not videos:
        raise ArgumentError("no video was given")
    if len(set(keys)) < count:
        double = next(name for name, key in zip(names, keys, strict=True) if keys.count(key) > 1)
        raise ArgumentError(f"two videos would make trial '{double}'; rename one")
    if workers is not None and workers < 1:
        raise ArgumentError(f"workers is {workers}; it must be at least 1")
    none: list[None] = [None] * count
    of_each = {
        "points": points, "corrections": corrections or none, "frequency": frequencies or none,
        "controls": controls or none, "sensors": sensors or none, "span": spans or [WHOLE] * count, "fps": fps or none,
    }  # fmt: skip
    for what, values in of_each.items():
        if len(values) != count:
            raise ArgumentError(f"{len(values)} {what} for {count} videos; give as many as videos")
    keywords = [dict(zip(of_each, values, strict=True)) for values in zip(*of_each.values(), strict=True)]
    jobs = {
        name: partial(track_video, video, robot=robot, settings=settings, folder=folder, **one)
        for name, video, one in zip(names, videos, keywords, strict=True)
    }
    processes = min(count, workers or os.cpu_count() or 1)
    if processes > 1:
        return _in_processes(jobs, processes, on_progress, on_done)
    results: list[Result] = []
    for name, job in jobs.items():
        results.append(_result(partial(job, on_progress=on_progress)))
        on_done(name, results[-1])
    return results


def _in_processes(
    jobs: Mapping[str, Callable[..., TrackedVideo]], processes: int, on_progress: Callable[[FrameProgress], None],
    on_done: Callable[[str, Result], None],
) -> list[Result]:  # fmt: skip
    progress: Any = multiprocessing.get_context("spawn").Queue()
    results: dict[str, Result] = {}
    try:
        with ProcessPool(processes, tries=1, initializer=_connect, initargs=(progress,)) as pool:
            futures = {pool.submit(_tracked, job): name for name, job in jobs.items()}
            left = set(futures)
            while left:
                done, left = wait(left, timeout=_POLL_INTERVAL)
                with contextlib.suppress(queue.Empty):  # what the processes have reported so far
                    while True:
                        on_progress(progress.get_nowait())
                for future in done:
                    name = futures[future]
                    results[name] = _result(future.result)
                    on_done(name, results[name])
    finally:
        progress.close()
    return [results[name] for name in jobs]


def _connect(progress: Any) -> None:
    global _progress
    _progress = progress
    progress.cancel_join_thread()  # a process that ends doesn't wait until its last reports are read


def _tracked(job: Callable[..., TrackedVideo]) -> TrackedVideo:
    return job(threads=1, on_progress=_progress.put)


def _result(track: Callable[[], TrackedVideo]) -> Result:
    try:
        return track()
    except ProcessDiedError as error:
        return TrackingError(str(error))
    except Swim2RealError as error:
        return error
