"""From one video to a trial in a reference folder.

Beside the trial's table, the folder `tracks` gets the track in pixels (a DeepLabCut table), an overlay video for a
person to check it, and a report. The report is written last: with it
the video is done, and isn't tracked again as long as it, the points and the settings are the same.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Literal

import numpy as np
from pydantic import BaseModel

from markertrack.camera_file import read_camera
from markertrack.film import AUTO, HowToTrack, track_film
from markertrack.following import FrameProgress
from markertrack.span import WHOLE, Span
from markertrack.video import film_files, film_name, film_title
from swim2real.calibration import versions
from swim2real.objective.comparison import rounded
from swim2real.robots.robot import Robot
from swim2real.settings import TrackingSettings
from swim2real.trials import Trial
from swim2real.trials.pose_tables import write_dlc
from swim2real.trials.published import nominal_frequency
from swim2real.trials.reference import add_trial, check_folder, load_reference
from swim2real.trials.signals import MEMORY, read_signals
from swim2real.trials.timebase import TABLES, Timebase, by_stamps, contradictions
from swimbase.errors import ArgumentError, TrackingError, TrialError
from swimbase.names import composed
from swimbase.store import read_json, write_json, writing

TRACKS = "tracks"
_ENDS = 1 << 20  # bytes of a video's beginning and end that distinguish it from others


class TrackingReport(BaseModel):
    """Report on a tracked video: method and findings, as in `tracks/NAME.json`.

    Attributes:
        fingerprint: Hash of the video, the points and the settings.
        trial: Name of the trial.
        video: Name of the video file.
        width: Width of the upright picture [px].
        height: Height of the upright picture [px].
        fps: Mean number of frames per second.
        rate_from: How that is known: by the film's `container`, or `given` by the user.
        codec: Name of the video's codec.
        mirrored: Whether the stored pictures are mirrored, left for right, before they are turned.
        rotation: Angle by which the stored pictures are turned clockwise [degrees].
        frames: Number of frames.
        tracker: Name of the tracker.
        points: Where the markers are in the first frame [px]. Shape (M, 2).
        points_from: `file`, or `auto` for points that were found without a click.
        meters_per_pixel: Scale at the head [m].
        scale_spread: Range of all estimates of the scale, relative to it.
        scales: Estimates of the scale by name [m].
        confidence: Mean confidence of each marker. Shape (M,).
        lost_share: Share of frames for which each marker is lost. Shape (M,).
        filled_share: Share of frames for which each marker was filled in. Shape (M,).
        usable: Whether the trial can be used without a second thought.
        findings: Sentences on what a person should know.
        seconds: Time that the tracking took [s].
    """

    fingerprint: str
    trial: str
    video: str
    width: int
    height: int
    fps: float
    rate_from: Literal["container", "given"]
    codec: str
    mirrored: bool
    rotation: int
    frames: int
    tracker: str
    points: list[list[float]]
    points_from: str
    meters_per_pixel: float
    scale_spread: float
    scales: dict[str, float]
    confidence: list[float]
    lost_share: list[float]
    filled_share: list[float]
    usable: bool
    findings: list[str]
    seconds: float


@dataclass(frozen=True)
class TrackedVideo:
    """Result of tracking a video.

    Attributes:
        name: Name of the trial.
        report: How it was tracked and what was found.
        done_before: Whether the same track was there already, so that nothing was done.
    """

    name: str
    report: TrackingReport
    done_before: bool


def track_video(
    video: str | Path, points: str | Path, robot: Robot, settings: TrackingSettings, folder: str | Path, *,
    corrections: Path | None = None, frequency: float | None = None, controls: Path | None = None,
    sensors: Path | None = None, span: Span = WHOLE, fps: float | None = None, threads: int = 0,
    on_progress: Callable[[FrameProgress], None] = lambda progress: None,
) -> TrackedVideo:  # fmt: skip
    """Tracks a video and adds it to a reference folder as a trial of the video's name.

    Args:
        video: Path of the video, of a folder of pictures, or a pattern of their names such as `frame_%04d.png`.
        points: Path of the points file with the markers in one of its frames; "auto" finds them in the first one
            without a click, which is refused where it isn't sure.
        robot: Robot that carries the markers.
        settings: How to track.
        folder: Path of the reference folder.
        corrections: Path of a file of corrections, or of the points of another frame.
        frequency: Frequency that the motor was commanded to turn at [Hz]; None takes it from a name such as f1_50.
        controls: Path of a table of what drove the robot, on the camera's clock: time 0 is the first frame.
        sensors: Path of a table of what was measured, on the camera's clock.
        span: Stretch of the video that is tracked, on the camera's clock. The trial's time is 0 at its first frame.
        fps: Frames per second that the camera took; by default as the film states it.
        threads: Number of threads that decode the video; 0 for as many as the machine has cores.
        on_progress: Called after every frame.

    Raises:
        Swim2RealError: The video, a file or an argument can't be used; the message names it. Nothing is changed then.
    """
    if frequency is not None and not 0 < frequency < np.inf:
        raise ArgumentError(f"frequency is {frequency:g} Hz; it must be finite and above 0")
    source, out, names = Path(video), Path(folder), robot.marker_names
    title, name = film_title(source), composed(film_name(source))
    report_path = out / TRACKS / f"{name}.json"
    inputs = (None if points == AUTO else Path(points), settings.camera, controls, sensors, corrections)
    fingerprint = _fingerprint(source, inputs, settings, robot, frequency, span, fps)
    before = _finished(report_path, fingerprint, out, name)
    if before is not None:
        return TrackedVideo(name, before, True)
    check_folder(out, name, names)
    camera = None if settings.camera is None else read_camera(settings.camera)
    commands, readings = (None if table is None else read_signals(table) for table in (controls, sensors))
    _check_writable(report_path.parent)
    began = time.monotonic()
    how = HowToTrack(
        settings.tags if settings.tracker == "aruco" else None, settings.midline, camera, corrections, span, fps,
        settings.smooth, report_path.with_suffix(".mp4") if settings.overlay else None, threads,
    )  # fmt: skip
    film = track_film(source, points, robot.layout, how, on_progress)
    seconds = time.monotonic() - began
    tracker = "midline" if settings.midline else settings.tracker
    info, track, begin, scale = film.info, film.track, film.begin, film.camera.scale
    made = f"{info.width}x{info.height}, {info.codec}, {tracker} tracker, swim2real {versions()['swim2real']}"
    if not span.whole:
        end = begin + float(track.times[-1])
        commands = None if commands is None else commands.cut(begin, end, before=MEMORY)
        readings = None if readings is None else readings.cut(begin, end)
    origin = f"{f'frame at {begin:g} s' if begin else 'first frame'} of {title}"
    assert info.rate_from is not None  # without a rate no film is read
    clocks = {
        "track": Timebase(origin, fps or round(1 / float(np.median(np.diff(track.times))), 6), info.rate_from),
        **by_stamps(TABLES, controls=commands, sensors=readings),
    }
    trial = Trial(
        name, track, nominal_frequency(name) if frequency is None else frequency, scale.meters_per_pixel,
        ", ".join(filter(None, (f"video {title}", span.words, made))),
        video=source, video_begin=begin, controls=commands, sensors=readings,
        timebases=clocks, midline=settings.midline,
    )  # fmt: skip
    report_path.parent.mkdir(parents=True, exist_ok=True)
    report_path.unlink(missing_ok=True)  # it is of the track that is replaced now
    write_dlc(film.seen, names, report_path.with_suffix(".pixels.csv"))
    add_trial(out, trial, names)
    report = TrackingReport.model_validate(
        rounded(
            {
                "fingerprint": fingerprint, "trial": name, "video": title, "width": info.width, "height": info.height,
                "fps": info.fps, "rate_from": info.rate_from, "codec": info.codec, "mirrored": info.mirrored,
                "rotation": info.rotation, "frames": film.seen.frame_count,
                "tracker": tracker, "points": film.start.points,
                "points_from": AUTO if points == AUTO else "file",
                "meters_per_pixel": scale.meters_per_pixel, "scale_spread": scale.spread,
                "scales": dict(scale.estimates), "confidence": film.seen.confidence.mean(axis=0),
                "lost_share": film.quality.lost_share, "filled_share": film.filled_share,
                "usable": film.quality.usable,
                "findings": [
                    *film.notes, *contradictions(trial), *film.camera.findings(), *film.quality.findings(names),
                ],
                "seconds": round(seconds, 2),
            }
        )
    )  # fmt: skip
    write_json(report_path, report.model_dump())
    return TrackedVideo(name, report, False)


def _fingerprint(
    video: Path, inputs: tuple[Path | None, ...], settings: TrackingSettings, robot: Robot, frequency: float | None,
    span: Span, fps: float | None,
) -> str:  # fmt: skip
    """A hash of all that a track depends on; empty where a file can't be read, which tracking then refuses."""
    digest = hashlib.sha256()
    try:
        files = film_files(video)
        for one in (files[0], files[-1]):
            with one.open("rb") as file:
                digest.update(file.read(_ENDS))
                file.seek(max(one.stat().st_size - _ENDS, 0))
                digest.update(file.read())
        about = [
            [(one.name, one.stat().st_size) for one in files], fps, settings.tracker, settings.tags, settings.midline,
            settings.smooth, settings.overlay, robot.name, frequency, versions()["swim2real"], span.begin, span.until,
        ]  # fmt: skip
        digest.update(json.dumps(about).encode())
        for path in inputs:
            digest.update(b"\0" if path is None else path.read_bytes())
    except OSError:
        return ""
    return digest.hexdigest()


def _finished(path: Path, fingerprint: str, folder: Path, name: str) -> TrackingReport | None:
    """The report of a finished track of the same video, points and settings; None without one."""
    try:
        report = TrackingReport.model_validate(read_json(path))
        finished = report.fingerprint == fingerprint and name in load_reference(folder).names
    except (OSError, ValueError, TrialError):
        return None
    return report if finished else None


def _check_writable(folder: Path) -> None:
    """Refuses a folder that can't be made or written; makes nothing."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    # the file has no name, so that an interruption leaves nothing
    with writing(folder, TrackingError, "choose another with --to", what="folder"), TemporaryFile(dir=there):
        pass
