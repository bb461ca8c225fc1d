"""Several videos at a time, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any

from swim2real.errors import ArgumentError, Swim2RealError, TrackingError
from swim2real.pipeline.tracking import Filmed, FrameProgress, track_film
from swim2real.processes import ProcessDiedError, ProcessPool
from swim2real.robots.robot import Robot
from swim2real.settings import TrackingSettings

_LOOK = 0.2  # s between two looks at what the processes say
_every: Any = None  # a process's end of the queue


def track_films(
    videos: Sequence[str | Path], points: Sequence[str | Path | None], robot: Robot, settings: TrackingSettings,
    folder: str | Path, *, frequencies: Sequence[float | None] | None = None,
    controls: Sequence[Path | None] | None = None, sensors: Sequence[Path | None] | None = None,
    workers: int | None = None,
    on_progress: Callable[[FrameProgress], None] = lambda progress: None,
    on_done: Callable[[str, Filmed | Swim2RealError], None] = lambda name, result: None,
) -> list[Filmed | Swim2RealError]:  # fmt: skip
    """Tracks videos into one reference folder. One that fails leaves the others alone.

    Args:
        videos: The videos, whose names become the trials'.
        points: File with the markers of each first frame, None to find them.
        robot: Whose markers they are.
        settings: How.
        folder: Reference folder.
        frequencies: That were asked of the motor [Hz], None where it isn't known.
        controls: Tables of what drove the robot, None where there is none.
        sensors: Likewise of what was measured.
        workers: Processes at a time; None for as many as there are cores and videos.
        on_progress: Called now and then with the state of a video.
        on_done: Called when a video is done or has failed.

    Returns:
        What came of each video, or why nothing did.

    Raises:
        ArgumentError: The videos can't make one reference.
    """
    count = len(videos)
    names = [Path(video).stem for video in videos]
    double = next((name for name in names if names.count(name) > 1), None)
    if not videos:
        raise ArgumentError("no video was given")
    if double is not None:
        raise ArgumentError(f"two videos would make trial '{double}'; rename one")
    if workers is not None and workers < 1:
        raise ArgumentError(f"workers is {workers}; it must be at least 1")
    known: dict[str, Sequence[Any]] = {
        "points": points, "frequency": frequencies or [None] * count, "controls": controls or [None] * count,
        "sensors": sensors or [None] * count,
    }  # fmt: skip
    for key, one in known.items():
        if len(one) != count:
            raise ArgumentError(f"{len(one)} {key} for {count} videos; give as many as videos")
    jobs: list[dict[str, Any]] = [
        {"video": video, "robot": robot, "settings": settings, "folder": folder,
         **{key: one[i] for key, one in known.items()}}
        for i, video in enumerate(videos)
    ]  # fmt: skip
    processes = min(count, workers or os.cpu_count() or 1)
    if processes == 1:
        results: list[Filmed | Swim2RealError] = []
        for name, job in zip(names, jobs, strict=True):
            try:
                found: Filmed | Swim2RealError = track_film(**job, on_progress=on_progress)
            except Swim2RealError as error:
                found = error
            on_done(name, found)
            results.append(found)
        return results
    return _in_processes(names, jobs, processes, on_progress, on_done)


def _in_processes(
    names: Sequence[str], jobs: Sequence[dict[str, Any]], processes: int,
    on_progress: Callable[[FrameProgress], None], on_done: Callable[[str, Filmed | Swim2RealError], None],
) -> list[Filmed | Swim2RealError]:  # fmt: skip
    told: Any = multiprocessing.get_context("spawn").Queue()
    results: dict[str, Filmed | Swim2RealError] = {}
    try:
        with ProcessPool(processes, tries=1, initializer=_listen, initargs=(told,)) as pool:
            futures: dict[Future[Filmed], str] = {
                pool.submit(_job, job): name for name, job in zip(names, jobs, strict=True)
            }
            left = set(futures)
            while left:
                done, left = wait(left, timeout=_LOOK)
                _drain(told, on_progress)
                for future in done:
                    name = futures[future]
                    results[name] = _result(future)
                    on_done(name, results[name])
    finally:
        told.close()
    return [results[name] for name in names]


def _listen(told: Any) -> None:
    global _every
    _every = told
    told.cancel_join_thread()  # a process that ends doesn't wait until its last words are heard


def _job(job: dict[str, Any]) -> Filmed:
    return track_film(**job, threads=1, on_progress=_every.put)


def _drain(told: Any, on_progress: Callable[[FrameProgress], None]) -> None:
    try:
        while True:
            on_progress(told.get_nowait())
    except queue.Empty:
        return


def _result(future: Future[Filmed]) -> Filmed | Swim2RealError:
    try:
        return future.result()
    except ProcessDiedError as error:
        return TrackingError(str(error))
    except Swim2RealError as error:
        return error
