"""From one film to a track in meters: points, tracker or midline, cleaning, camera, quality."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markertrack.camera import Camera, camera_for
from markertrack.camera_file import CameraFile
from markertrack.cleaning import fill_gaps, smooth
from markertrack.following import Film, FrameProgress, draw_track, follow, within
from markertrack.layout import Layout
from markertrack.midline import follow_midline
from markertrack.points import Anchor, load_anchors, load_points
from markertrack.quality import LostMarkers, check_lost
from markertrack.span import WHOLE, Span
from markertrack.track import MarkerTrack
from markertrack.tracking.labeling import label_markers
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.tags import TagTracker
from markertrack.tracking.tracker import Tracker
from markertrack.video import Frame, VideoInfo, VideoReader, film_name, film_title
from swimbase.arrays import Array
from swimbase.errors import TrackingError

AUTO = "auto"  # in place of a points file: the markers are found without a click


@dataclass(frozen=True)
class HowToTrack:
    """Decisions of a person about a film's tracking.

    Attributes:
        tags: Dictionary of ArUco or AprilTag markers, as OpenCV names it; None for markers that are dots.
        midline: Follow the midline of a swimmer without markers; the points are its first and last marker alone.
        camera: Known lengths, height, plane or lens; None without a camera file.
        corrections: Path of a file of corrections, or of the points of another frame.
        span: Stretch of the film that is tracked, on the camera's clock.
        fps: Frames per second that the camera took; None as the film states it.
        smooth: Smooth the track over time.
        overlay: Path of the overlay video to write; None for none.
        threads: Number of threads that decode; 0 for as many as the machine has cores.
    """

    tags: str | None = None
    midline: bool = False
    camera: CameraFile | None = None
    corrections: Path | None = None
    span: Span = WHOLE
    fps: float | None = None
    smooth: bool = False
    overlay: Path | None = None
    threads: int = 0


@dataclass(frozen=True)
class TrackedFilm:
    """Results of tracking a film.

    Attributes:
        info: What the film is.
        begin: Time of the first tracked frame on the camera's clock [s].
        first: Number of that frame in the film.
        start: Places of all markers in one of the frames [px].
        corrections: Those of a person.
        seen: The track in pixels, where markers were seen.
        pixels: The same, smoothed where that was asked for, with short gaps filled.
        camera: The camera that took it.
        track: The track in meters, its time 0 at the first frame.
        quality: Which markers are lost in it.
        notes: Sentences on what is unusual about the film.
    """

    info: VideoInfo
    begin: float
    first: int
    start: Anchor
    corrections: tuple[Anchor, ...]
    seen: MarkerTrack
    pixels: MarkerTrack
    camera: Camera
    track: MarkerTrack
    quality: LostMarkers
    notes: tuple[str, ...]

    @property
    def filled_share(self) -> Array:
        """Share of frames in which each marker was filled in. Shape (M,)."""
        filled = ~np.isfinite(self.seen.positions[:, :, 0]) & np.isfinite(self.pixels.positions[:, :, 0])
        return filled.mean(axis=0)


def track_film(
    video: str | Path, points: str | Path, layout: Layout, how: HowToTrack | None = None,
    on_progress: Callable[[FrameProgress], None] = lambda progress: None,
) -> TrackedFilm:  # fmt: skip
    """Tracks the markers of one body in a film.

    Args:
        video: Path of the film, of a folder of pictures, or a pattern of their names such as `frame_%04d.png`.
        points: Path of the points file with the markers in one of the frames; "auto" finds them in the first one
            without a click, which is refused where it isn't sure.
        layout: The markers.
        how: What a person decides.
        on_progress: Called after every frame.

    Raises:
        Swim2RealError: The film, a file or an argument can't be used; the message names it.
    """
    how, source = how or HowToTrack(), Path(video)
    layout = layout.level if how.midline else layout
    with VideoReader(source, how.threads, how.fps) as reader:
        info = reader.info
        size = (info.width, info.height)
        frames = within(reader, how.span)
        first = next(frames)
        clicked = _clicked_names(layout, points, how)
        start = (
            Anchor(first.index, _labeled(first, layout, how.tags), np.zeros(len(layout.names), dtype=bool))
            if points == AUTO
            else load_points(points, clicked, *size, first.index)
        )
        title = film_title(source)
        anchors = load_anchors(how.corrections, layout.names, *size, title) if how.corrections else ()
        # a film without a scale is refused before it is tracked
        straight = _in_a_row(start.points, layout) if how.midline else start.points
        camera_for(MarkerTrack([0.0, 1.0], np.stack([straight] * 2)), layout, how.camera, size)
        bodies = tuple(range(len(layout.names))) if layout.chain else layout.bodies
        film = Film(film_name(source), source, how.span, layout.names, bodies, how.threads, how.overlay, how.fps)
        if how.overlay is not None:
            how.overlay.parent.mkdir(parents=True, exist_ok=True)
        said: tuple[str, ...] = ()
        if how.midline:
            midline = follow_midline(film, reader, first.index, start, layout.places_along, anchors, on_progress)
            seen, said = midline.track, midline.notes
            start = Anchor(start.frame, seen.positions[start.frame - first.index], np.zeros(len(clicked), dtype=bool))
            draw_track(film, reader, seen)
        else:
            seen = follow(film, reader, first, frames, start, anchors, lambda: _tracker(layout, how.tags), on_progress)
        notes = [*reader.notes, *said]
    pixels = fill_gaps(smooth(seen) if how.smooth else seen)
    camera = camera_for(pixels, layout, how.camera, size)
    track = camera.to_meters(pixels)
    end = first.time + float(track.times[-1])
    if how.span.until is not None and how.span.until - end > 2 / info.fps:
        notes.append(f"the last frame is at {end:.3f} s, before --until, {how.span.until:g} s")
    lost = check_lost(track, layout, how.midline)
    return TrackedFilm(
        info, first.time, first.index, start, tuple(anchors), seen, pixels, camera, track, lost, tuple(notes)
    )


def _clicked_names(layout: Layout, points: str | Path, how: HowToTrack) -> tuple[str, ...]:
    """Names of the markers that a points file must have."""
    if not how.midline:
        return layout.names
    if how.tags is not None or points == AUTO:
        other = "tags" if how.tags is not None else "points that are found without a click"
        raise TrackingError(
            f"a midline takes two clicks, head and tail, and no {other}; click them with `pick --midline`"
        )
    return layout.names[0], layout.names[-1]


def _in_a_row(ends: Array, layout: Layout) -> Array:
    """Places of all markers between two clicked ends (2, 2) of a straight swimmer [px]. Shape (M, 2)."""
    return ends[0] + layout.places_along[:, None] * (ends[1] - ends[0])


def _tracker(layout: Layout, tags: str | None) -> Tracker:
    """The tracker of a layout."""
    return TagTracker(tags) if tags is not None else MarkerTracker(layout.bodies, 0, layout.chain)


def _labeled(first: Frame, layout: Layout, tags: str | None) -> Array:
    """Places of the markers in a first frame, found without a click [px]. Shape (M, 2)."""
    if tags is not None:
        return TagTracker(tags).points(first.image, len(layout.names))
    if not layout.chain:
        raise TrackingError(
            f"the markers of {layout.body} can't be found by themselves: that takes a straight swimmer, and its trials "
            "are recordings; pick the points with `swim2real pick`"
        )
    return label_markers(first.image, layout.rest, layout.heights)
