"""From one video to a trial in a reference folder: points, tracker, camera, cleaning, quality, overlay.

Beside the trial's table, the folder `tracks` gets the track in pixels (a DeepLabCut table), an overlay video to judge
it by, and what was done and found. The last file is written last: with it the video is done, and isn't tracked again
as long as it, the points and the settings are the same.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real import __version__
from swim2real.errors import ArgumentError, TrackingError, TrialError
from swim2real.objective.comparison import rounded
from swim2real.robots.compiled import rigid_markers
from swim2real.robots.robot import Robot
from swim2real.settings import TrackingSettings
from swim2real.tracking.camera import camera_for, read_camera
from swim2real.tracking.cleaning import fill_gaps, smooth
from swim2real.tracking.csrt import CsrtTracker
from swim2real.tracking.detector import DetectionTracker
from swim2real.tracking.picking import label_markers, load_points
from swim2real.tracking.quality import LostMarkers, check_track, unseen
from swim2real.tracking.tracker import Tracker
from swim2real.trials import MarkerTrack, Trial
from swim2real.trials.pose_tables import write_dlc
from swim2real.trials.reference import add_trial, check_folder, load_reference, nominal_frequency
from swim2real.trials.signals import read_signals
from swim2real.video import Frame, VideoReader

Array = NDArray[np.float64]

TRACKS = "tracks"
SMEARED = 0.4  # most confidence in a picture that may be smeared: doubtful to `check_track`
_SHARE = 1 << 20  # bytes of a video's beginning and end that tell it from others


@dataclass(frozen=True)
class FrameProgress:
    """How far a video is.

    Attributes:
        name: Of the trial.
        done: Frames so far.
        total: Frames in all, as far as the file says.
        lost: Markers that are lost in this frame.
    """

    name: str
    done: int
    total: int | None
    lost: int


@dataclass(frozen=True)
class Filmed:
    """What came of a video.

    Attributes:
        name: Of the trial.
        report: What was done and found, as in `tracks/NAME.json`.
        again: Whether it was all there already.
    """

    name: str
    report: dict[str, Any]
    again: bool


def track_film(
    video: str | Path, points: str | Path | None, robot: Robot, settings: TrackingSettings, folder: str | Path, *,
    frequency: float | None = None, controls: Path | None = None, sensors: Path | None = None, threads: int = 0,
    on_progress: Callable[[FrameProgress], None] = lambda progress: None,
) -> Filmed:  # fmt: skip
    """Tracks a video and adds it to a reference folder as a trial of the video's name.

    Args:
        video: The video.
        points: File with the markers in its first frame; None finds them.
        robot: Whose markers they are.
        settings: How.
        folder: Reference folder.
        frequency: That was asked of the motor [Hz]; None takes it from a name such as f1_50, where there is one.
        controls: Table of what drove the robot, on the video's clock.
        sensors: Likewise of what was measured.
        threads: That decode the video, 0 for all cores.
        on_progress: Called after every frame.

    Raises:
        Swim2RealError: With a sentence that names what is wrong. Nothing is changed then.
    """
    if frequency is not None and not 0 < frequency < np.inf:
        raise ArgumentError(f"frequency is {frequency:g} Hz; it must be finite and above 0")
    source, out = Path(video), Path(folder)
    name = source.stem
    asked = nominal_frequency(name) if frequency is None else frequency
    place = out / TRACKS / f"{name}.json"
    with VideoReader(source, threads) as reader:
        frames = iter(reader)
        first = next(frames)
        size = (reader.info.width, reader.info.height)
        clicked = _labeled(first, robot) if points is None else load_points(points, robot.marker_names, *size)
        known = None if settings.camera is None else read_camera(settings.camera)
        driven, measured = (None if table is None else read_signals(table) for table in (controls, sensors))
        mark = _fingerprint(source, clicked, settings, robot, frequency, (controls, sensors))
        before = _done(place, mark, out, name)
        if before is not None:
            return Filmed(name, before, True)
        check_folder(out, name, robot.marker_names)
        _make_folder(place.parent)
        tracker: Tracker = DetectionTracker() if settings.tracker == "detection" else CsrtTracker()
        began = time.monotonic()
        seen = _follow(reader, first, frames, clicked, tracker, settings, place, robot, on_progress)
        notes = list(reader.notes)
        info = reader.info
    spent = time.monotonic() - began
    pixels = fill_gaps(smooth(seen) if settings.smooth else seen)
    camera = camera_for(
        pixels, robot.rest_markers, robot.marker_heights, robot.marker_names, rigid_markers(robot), known, size
    )
    track = camera.to_meters(pixels)
    quality = check_lost(track, robot)
    trial = Trial(
        name, track, asked, camera.scale.meters_per_pixel,
        f"video {source.name}, {size[0]}x{size[1]}, {info.codec}, {settings.tracker} tracker, swim2real {__version__}",
        video=source, controls=driven, sensors=measured,
    )  # fmt: skip
    place.unlink(missing_ok=True)  # what it says is of the track that is replaced now
    write_dlc(seen, robot.marker_names, place.with_suffix(".pixels.csv"))
    add_trial(out, trial, robot.marker_names)
    report = rounded(
        {
            "fingerprint": mark, "trial": name, "video": source.name, "width": size[0], "height": size[1],
            "fps": info.fps, "codec": info.codec, "rotation": info.rotation, "frames": seen.frame_count,
            "tracker": settings.tracker, "points": clicked, "points_from": "auto" if points is None else "file",
            "meters_per_pixel": camera.scale.meters_per_pixel, "scale_spread": camera.scale.spread,
            "scales": dict(camera.scale.estimates), "confidence": seen.confidence.mean(axis=0),
            "lost_share": quality.lost_share, "filled_share": _filled_share(seen, pixels), "usable": quality.usable,
            "findings": [*notes, *camera.findings(), *quality.findings(robot.marker_names)],
            "seconds": round(spent, 2),
        }
    )  # fmt: skip
    part = place.with_name(place.name + ".part")
    part.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    part.replace(place)
    return Filmed(name, report, False)


def check_lost(track: MarkerTrack, robot: Robot) -> LostMarkers:
    """Which markers of a real track are lost; a swimmer's, which bends little, also by their spacing."""
    return check_track(track, robot.rest_markers) if robot.trials.nearly_straight else unseen(track)


def _labeled(first: Frame, robot: Robot) -> Array:
    """Where the markers are in a first frame, without a click [px]. Shape (M, 2)."""
    if not robot.trials.nearly_straight:
        raise TrackingError(
            f"the markers of robot '{robot.name}' can't be found by themselves: that takes a straight swimmer, and its "
            f"trials are recordings; pick the points with `swim2real pick`"
        )
    return label_markers(first.image, robot.rest_markers, robot.marker_heights).points


def _follow(
    reader: VideoReader, first: Frame, frames: Any, clicked: Array, tracker: Tracker, settings: TrackingSettings,
    place: Path, robot: Robot, on_progress: Callable[[FrameProgress], None],
) -> MarkerTrack:  # fmt: skip
    """The track in pixels, with the overlay on the way."""
    times: list[float] = []
    positions: list[Array] = []
    confidences: list[Array] = []
    info = reader.info
    with ExitStack() as stack:
        overlay = None
        if settings.overlay:
            from swim2real.rendering.overlay import TrackOverlay

            target = place.with_suffix(".mp4")
            overlay = stack.enter_context(TrackOverlay(target, info.width, info.height, info.fps, robot.marker_names))
        frame: Frame | None = first
        while frame is not None:
            if positions:
                position, confidence = tracker.follow(frame.image, frame.time)
            else:
                position, confidence = tracker.start(frame.image, clicked, frame.time)
            if not frame.intact:  # predicted from a broken one: what it shows may be of another time
                confidence = np.minimum(confidence, SMEARED)
            times.append(frame.time)
            positions.append(position)
            confidences.append(confidence)
            if overlay is not None:
                small = frame.scaled(overlay.width)
                overlay.add(small, overlay.width / info.width, frame.time, position, confidence, detail=frame.image)
            lost = int(np.count_nonzero(confidence <= 0))
            on_progress(FrameProgress(place.stem, len(times), info.frame_count, lost))
            frame = next(frames, None)
        if len(times) < 2:
            raise TrackingError(f"'{info.path}' has one frame only; a trial needs at least 2")
    return MarkerTrack(times, np.array(positions), np.array(confidences))


def _filled_share(seen: MarkerTrack, pixels: MarkerTrack) -> Array:
    """Share of frames that were filled, per marker. Shape (M,)."""
    return (~np.isfinite(seen.positions[:, :, 0]) & np.isfinite(pixels.positions[:, :, 0])).mean(axis=0)


def _fingerprint(
    video: Path, clicked: Array, settings: TrackingSettings, robot: Robot, frequency: float | None,
    tables: tuple[Path | None, ...],
) -> str:  # fmt: skip
    mark = hashlib.sha256()
    with video.open("rb") as file:
        mark.update(file.read(_SHARE))
        size = file.seek(0, 2)
        file.seek(max(size - _SHARE, 0))
        mark.update(file.read())
    about = [
        size, clicked.tolist(), settings.tracker, settings.smooth, settings.overlay, robot.name, frequency, __version__
    ]  # fmt: skip
    mark.update(json.dumps(about).encode())
    for file in (settings.camera, *tables):
        mark.update(b"\0" if file is None else file.read_bytes())
    return mark.hexdigest()


def _done(place: Path, mark: str, folder: Path, name: str) -> dict[str, Any] | None:
    """What a finished track of just this found, None for another or none."""
    try:
        report = json.loads(place.read_text(encoding="utf-8"))
        whole = report["fingerprint"] == mark and name in load_reference(folder).names
    except (OSError, ValueError, KeyError, TypeError, TrialError):
        return None
    return report if whole else None


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):  # without a name, so that an interruption leaves nothing
            pass
    except OSError as error:
        raise TrackingError(
            f"can't write folder '{folder}': {error.strerror or error}; choose another with --to"
        ) from error
