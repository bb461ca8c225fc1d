"""From several videos to trials in one reference folder, each video in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any

from swim2real.errors import ArgumentError, Swim2RealError, TrackingError
from swim2real.names import composed, file_key
from swim2real.pipeline.tracking import FrameProgress, TrackedVideo, track_video
from swim2real.processes import ProcessDiedError, ProcessPool
from swim2real.robots.robot import Robot
from swim2real.settings import TrackingSettings
from swim2real.trials.span import WHOLE, Span

_POLL_INTERVAL = 0.2  # s between two looks at what the processes report
_progress: Any = None  # a process's end of the queue


def track_videos(
    videos: Sequence[str | Path], points: Sequence[str | Path], robot: Robot, settings: TrackingSettings,
    folder: str | Path, *, corrections: Sequence[Path | None] | None = None,
    frequencies: Sequence[float | None] | None = None, controls: Sequence[Path | None] | None = None,
    sensors: Sequence[Path | None] | None = None, spans: Sequence[Span] | None = None, workers: int | None = None,
    on_progress: Callable[[FrameProgress], None] = lambda progress: None,
    on_done: Callable[[str, TrackedVideo | Swim2RealError], None] = lambda name, result: None,
) -> list[TrackedVideo | Swim2RealError]:  # fmt: skip
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
        workers: Number of processes at a time; None for as many as there are cores and videos.
        on_progress: Called now and then with the state of a video.
        on_done: Called when a video is done or has failed.

    Returns:
        The result of each video in order, or the error that it failed with.

    Raises:
        ArgumentError: The videos can't make one reference.
    """
    count = len(videos)
    names = [composed(Path(video).stem) for video in videos]
    keys = [file_key(name) for name in names]
    double = next((name for name, key in zip(names, keys, strict=True) if keys.count(key) > 1), None)
    if not videos:
        raise ArgumentError("no video was given")
    if double is not None:
        raise ArgumentError(f"two videos would make trial '{double}'; rename one")
    if workers is not None and workers < 1:
        raise ArgumentError(f"workers is {workers}; it must be at least 1")
    known: dict[str, Sequence[Any]] = {
        "points": points, "corrections": corrections or [None] * count, "frequency": frequencies or [None] * count,
        "controls": controls or [None] * count, "sensors": sensors or [None] * count, "span": spans or [WHOLE] * count,
    }  # fmt: skip
    for key, values in known.items():
        if len(values) != count:
            raise ArgumentError(f"{len(values)} {key} for {count} videos; give as many as videos")
    jobs: list[dict[str, Any]] = [
        {"video": video, "robot": robot, "settings": settings, "folder": folder,
         **{key: values[i] for key, values in known.items()}}
        for i, video in enumerate(videos)
    ]  # fmt: skip
    processes = min(count, workers or os.cpu_count() or 1)
    if processes == 1:
        results: list[TrackedVideo | Swim2RealError] = []
        for name, job in zip(names, jobs, strict=True):
            try:
                result: TrackedVideo | Swim2RealError = track_video(**job, on_progress=on_progress)
            except Swim2RealError as error:
                result = error
            on_done(name, result)
            results.append(result)
        return results
    return _in_processes(names, jobs, processes, on_progress, on_done)


def _in_processes(
    names: Sequence[str], jobs: Sequence[dict[str, Any]], processes: int,
    on_progress: Callable[[FrameProgress], None], on_done: Callable[[str, TrackedVideo | Swim2RealError], None],
) -> list[TrackedVideo | Swim2RealError]:  # fmt: skip
    progress: Any = multiprocessing.get_context("spawn").Queue()
    results: dict[str, TrackedVideo | Swim2RealError] = {}
    try:
        with ProcessPool(processes, tries=1, initializer=_connect, initargs=(progress,)) as pool:
            futures: dict[Future[TrackedVideo], str] = {
                pool.submit(_job, job): name for name, job in zip(names, jobs, strict=True)
            }
            left = set(futures)
            while left:
                done, left = wait(left, timeout=_POLL_INTERVAL)
                _report(progress, on_progress)
                for future in done:
                    name = futures[future]
                    results[name] = _result(future)
                    on_done(name, results[name])
    finally:
        progress.close()
    return [results[name] for name in names]


def _connect(progress: Any) -> None:
    global _progress
    _progress = progress
    progress.cancel_join_thread()  # a process that ends doesn't wait until its last reports are read


def _job(job: dict[str, Any]) -> TrackedVideo:
    return track_video(**job, threads=1, on_progress=_progress.put)


def _report(progress: Any, on_progress: Callable[[FrameProgress], None]) -> None:
    """Passes on what the processes have reported so far."""
    try:
        while True:
            on_progress(progress.get_nowait())
    except queue.Empty:
        return


def _result(future: Future[TrackedVideo]) -> TrackedVideo | Swim2RealError:
    try:
        return future.result()
    except ProcessDiedError as error:
        return TrackingError(str(error))
    except Swim2RealError as error:
        return error
