"""A tracker over a film: forward, backward from points in a later frame, and again around corrections."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from markertrack.both_ways import Seen, both_ways
from markertrack.corrections import corrected, gaps_to_correct
from markertrack.gaps import follow_gaps
from markertrack.overlay import TrackOverlay
from markertrack.points import Anchor
from markertrack.quality import DOUBTFUL, MOST_NAMED
from markertrack.span import Span
from markertrack.track import MarkerTrack
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.tracker import Tracker
from markertrack.video import Frame, VideoReader, frames_backwards
from swimbase.arrays import Array
from swimbase.errors import TrackingError, TrialError

FIRST_LOOK = 2.0  # s after which is reported what can't be tracked in most frames
BLURRED, AROUND = 0.3, 20  # sharpness of the first picture, as a share of later ones', and px around markers it is of
BLURRED_FRAME = "the frame in which the points were picked is blurred: pick them in a sharp one (`pick --from`)"
SLACK = 30  # frames by which a file may have more than it says


@dataclass(frozen=True)
class FrameProgress:
    """How far the tracking of a video is.

    Attributes:
        name: Name of the trial.
        done: Number of frames that are tracked.
        total: Number of frames in all, as the file states it; None if it doesn't.
        lost: Number of markers that are lost in the newest frame.
        note: A sentence that a person should read before the rest is tracked.
        positions: Where the markers, or points of a midline, are in the newest frame [px]. Shape (M, 2).
    """

    name: str
    done: int
    total: int | None
    lost: int
    note: str = ""
    positions: Array | None = None


@dataclass(frozen=True)
class Film:
    """What is tracked.

    Attributes:
        name: Name of the trial.
        path: Path of the video.
        span: Stretch of it.
        names: Names of the markers.
        bodies: Number of the rigid body that carries each.
        threads: Number of threads that decode.
        overlay: Path of the overlay video; None for none.
        fps: Frames per second that the camera took; None as the film states it.
    """

    name: str
    path: Path
    span: Span
    names: tuple[str, ...]
    bodies: tuple[int, ...]
    threads: int
    overlay: Path | None
    fps: float | None = None

    def drawn(self, reader: VideoReader) -> TrackOverlay | nullcontext[None]:
        """The overlay video, to be drawn."""
        if self.overlay is None:
            return nullcontext()
        info = reader.info
        rate = float(np.clip(info.fps, 0.1, 1e4))  # that a film can be written with; each frame has its own time
        return TrackOverlay(self.overlay, info.width, info.height, rate, self.names)


def follow(
    film: Film, reader: VideoReader, first: Frame, frames: Iterator[Frame], start: Anchor, anchors: Sequence[Anchor],
    make_tracker: Callable[[], Tracker], on_progress: Callable[[FrameProgress], None],
) -> MarkerTrack:  # fmt: skip
    """Tracks a film in pixels, its first frame at time 0, and draws the overlay.

    Args:
        film: What is tracked.
        reader: Its frames, of which the first one is taken.
        first: That frame.
        frames: Those after it, to the end of the span.
        start: Places of all markers in one of the frames.
        anchors: Corrections.
        make_tracker: Makes a tracker that has seen nothing.
        on_progress: Called after every frame.

    Raises:
        TrackingError: The points or corrections aren't of these frames, or there is one frame only.
    """
    count = _count(reader, film.span)
    if count is not None:  # as far as the file says
        _check_frames(film, first.index, first.index + count + SLACK, (start, *anchors))
    later = bool(anchors) or start.frame > first.index
    with nullcontext() if later else film.drawn(reader) as overlay:
        track = _forward(film, reader, chain([first], frames), start, make_tracker(), overlay, on_progress)
    _check_frames(film, first.index, first.index + track.frame_count - 1, (start, *anchors))
    if start.frame > first.index:
        track = _backward(film, track, first.index, start, make_tracker())
    if anchors:
        track = correct(film, reader, track, first.index, anchors)
    if later:
        draw_track(film, reader, track)
    return track


def correct(film: Film, reader: VideoReader, track: MarkerTrack, first: int, anchors: Sequence[Anchor]) -> MarkerTrack:
    """The track with markers followed anew, both ways, where a person's corrections say more than it knew.

    Args:
        film: What was tracked.
        reader: Its frames.
        track: Track in pixels.
        first: Number in the video of the track's first frame.
        anchors: Corrections.
    """
    said = [Anchor(anchor.frame - first, anchor.points, anchor.hidden) for anchor in anchors]
    cleaned, gaps = gaps_to_correct(track, said, film.bodies)
    if gaps:
        begin, end = min(gap.begin for gap in gaps), max(gap.end for gap in gaps)
        last = first + min(end, track.frame_count - 1)
        back = frames_backwards(film.path, first + max(begin, 0), last, film.threads, film.fps)
        for frames, ahead in ((within(reader, film.span), True), (back, False)):
            follow_gaps(gaps, ((frame.index - first, frame) for frame in frames), ahead)
    return corrected(cleaned, gaps)


def draw_track(film: Film, reader: VideoReader, track: MarkerTrack) -> None:
    """Draws the overlay video of a track in pixels, where one is asked for."""
    with film.drawn(reader) as overlay:
        for k, frame in enumerate(within(reader, film.span) if overlay is not None else ()):
            _draw(overlay, frame, reader.info.width, track.times[k], track.positions[k], track.confidence[k])


def _check_frames(film: Film, first: int, last: int, anchors: Sequence[Anchor]) -> None:
    for anchor in anchors:
        if not first <= anchor.frame <= last:
            raise TrackingError(
                f"a marker was picked in frame {anchor.frame} of video '{film.path}', of which frames {first} to "
                f"{last} are tracked; begin or end there (--from, --until), or take that frame out of the file"
            )


def _forward(
    film: Film, reader: VideoReader, frames: Iterable[Frame], start: Anchor, tracker: Tracker,
    overlay: TrackOverlay | None, on_progress: Callable[[FrameProgress], None],
) -> MarkerTrack:  # fmt: skip
    """Tracks from the frame with the points on; markers are lost before."""
    times: list[float] = []
    positions: list[Array] = []
    confidences: list[Array] = []
    count, begin, looked = _count(reader, film.span), 0.0, False
    picked: int | None = None
    sharp = 0.0
    for frame, position, confidence in _from(start, frames, tracker):
        begin = begin if times else frame.time
        time = frame.time - begin
        times.append(time)
        positions.append(position)
        confidences.append(confidence)
        _draw(overlay, frame, reader.info.width, time, position, confidence)
        if frame.index == start.frame:
            picked, sharp = len(times) - 1, _sharpness(frame.image, position)
        note = ""
        if picked is not None and not looked and time - times[picked] >= FIRST_LOOK:
            at = np.where(np.isfinite(position), position, start.points)
            blurred = sharp < BLURRED * _sharpness(frame.image, at)
            looked, note = True, _first_look(film.names, np.array(confidences[picked:]), tracker, blurred)
        lost = int(np.count_nonzero(confidence <= 0))
        on_progress(FrameProgress(film.name, len(times), count, lost, note, position))
    if len(times) < 2:
        where = f" {film.span.words}" if film.span.words else ""
        raise TrackingError(f"'{film.path}' has one frame only{where}; a trial needs at least 2")
    return MarkerTrack(times, np.array(positions), np.array(confidences))


def _from(start: Anchor, frames: Iterable[Frame], tracker: Tracker) -> Iterator[Seen]:
    """Frames with positions [px] and confidence: none before that with the points."""
    frames = iter(frames)
    for frame in frames:
        if frame.index == start.frame:
            yield from both_ways(tracker, chain([frame], frames), start.points)
        else:
            yield frame, np.full_like(start.points, np.nan), np.zeros(len(start.points))


def _backward(film: Film, track: MarkerTrack, first: int, start: Anchor, tracker: Tracker) -> MarkerTrack:
    """The track with what comes before the frame with the points."""
    positions, confidence = track.positions.copy(), track.confidence.copy()
    frames = frames_backwards(film.path, first, start.frame, film.threads, film.fps)
    for frame, places, sure in islice(both_ways(tracker, frames, start.points), 1, None):
        positions[frame.index - first], confidence[frame.index - first] = places, sure
    return MarkerTrack(track.times, positions, confidence)


def _draw(
    overlay: TrackOverlay | None, frame: Frame, width: int, time: float, position: Array, confidence: Array
) -> None:
    if overlay is not None and overlay.wants(time, confidence):
        small = frame.scaled(overlay.width)
        overlay.add(small, overlay.width / width, time, position, confidence, detail=frame.image)


def _sharpness(image: NDArray[np.uint8], places: Array) -> float:
    """Median over the markers of the variance of the picture's Laplacian around each [levels²]. `places`: (M, 2) px."""
    values: list[float] = []
    for x, y in places[np.isfinite(places[:, 0])].astype(np.int64).clip(0).tolist():
        part = image[max(y - AROUND, 0) : y + AROUND, max(x - AROUND, 0) : x + AROUND]
        values.append(float(cv2.Laplacian(cv2.cvtColor(part, cv2.COLOR_RGB2GRAY), cv2.CV_64F).var()))
    return float(np.median(values)) if values else 0.0


def _first_look(names: Sequence[str], confidence: Array, tracker: Tracker, blurred: bool) -> str:
    """What can't be tracked, why, and what would help; nothing where all is well. `confidence` has shape (T, M)."""
    share = (confidence < DOUBTFUL).mean(axis=0)
    bad: list[int] = [m for m in np.argsort(-share, kind="stable").tolist() if share[m] > 0.5]
    if not bad:
        return ""
    if blurred:
        return f"{BLURRED_FRAME}; lost or doubtful since: {', '.join(names[m] for m in bad[:MOST_NAMED])}"
    reasons = tracker.reasons if isinstance(tracker, MarkerTracker) else {}
    named: list[str] = []
    for m in bad[:MOST_NAMED]:
        why = max(reasons, key=lambda reason: int(reasons[reason][m]), default="")
        named.append(f"{names[m]} in {100 * share[m]:.0f} % of frames" + (f" ({why})" if why else ""))
    more = f" and {len(bad) - MOST_NAMED} more" if len(bad) > MOST_NAMED else ""
    return (
        f"lost or doubtful in the first {FIRST_LOOK:g} s: {', '.join(named)}{more}; larger markers, more contrast, a "
        f"shorter shutter or tags (--tracker aruco) would help; a few of them can be put right by hand (--corrections)"
    )


def within(reader: VideoReader, span: Span) -> Iterator[Frame]:
    """The frames of a video within a stretch of it, one at least.

    Raises:
        TrialError: The stretch isn't within the video, as far as the file says how long it is, or holds no frame.
    """
    info, last, found = reader.info, 0.0, False
    what = f"video '{info.path}'"
    if info.duration is not None:  # before hours of film are decoded
        span.check(info.duration, what)
    for frame in reader:
        last = frame.time
        if span.after(last):
            break
        if not span.before(last):
            found = True
            yield frame
    if not found:
        span.check(last, what)
        raise TrialError(f"{what} has no frame {span.words}; make the stretch longer")


def _count(reader: VideoReader, span: Span) -> int | None:
    """The number of frames in a stretch of a video, as far as the file says it."""
    info = reader.info
    if span.until is not None:
        return round((span.until - span.begin) * info.fps) + 1
    return None if info.frame_count is None else max(1, info.frame_count - round(span.begin * info.fps))
