"""From a film and the clicked ends of a swimmer to places along its midline in every frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from markertrack.following import Film, FrameProgress, within
from markertrack.midline.centerline import POINTS, Curve, curves
from markertrack.midline.doubting import judge
from markertrack.midline.linking import APART, link
from markertrack.midline.places import places_at, tail_first
from markertrack.midline.silhouette import Silhouette
from markertrack.points import Anchor
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import DOUBT, Array, Image, Mask
from markertrack.video import Frame, VideoReader
from swimbase.errors import TrackingError

SAMPLES, SAMPLE_BYTES = 60, 2e8  # pictures of the film that tell the ground, at most, and their size
FINEST = 500.0  # px that a swimmer is long; where it is longer the pictures are looked at in a smaller size
CLICKS = 0.05, 0.2  # lengths by which the clicked head, and tail, may be off the curve; a tail may be faint
SNAP = 0.02  # lengths from its end, up to which a click means that


@dataclass(frozen=True)
class Midline:
    """A followed midline.

    Attributes:
        track: Places along the body, at time 0 in the first frame [px].
        lengths: Visible length in each frame, NaN where the swimmer isn't found [px]. Shape (T,).
        notes: Sentences on what is in doubt.
    """

    track: MarkerTrack
    lengths: Array
    notes: tuple[str, ...]


def follow_midline(
    film: Film, reader: VideoReader, first: int, clicks: Anchor, places: Array, anchors: Sequence[Anchor],
    on_progress: Callable[[FrameProgress], None],
) -> Midline:  # fmt: skip
    """Follows a swimmer without markers; the film is decoded twice.

    Args:
        film: What is tracked.
        reader: Its frames.
        first: Number of the first tracked frame in the film.
        clicks: First and last marker, which are its head and tail, in one of the frames. Points of shape (2, 2).
        places: Where each marker is along the body, from 0 at the first to 1 at the last. Shape (M,).
        anchors: Corrections: markers in other frames.
        on_progress: Called after every frame.

    Raises:
        TrackingError: No swimmer of one tone is seen between the clicks, or a click is in no tracked frame.
    """
    far = float(np.hypot(*(clicks.points[1] - clicks.points[0])))
    view = _View(reader, min(1.0, FINEST / far))
    clicked, samples, count = _samples(within(reader, film.span), clicks.frame, view)
    for frame in (clicks.frame, *(anchor.frame for anchor in anchors)):
        if not first <= frame < first + count:
            raise TrackingError(
                f"a marker was clicked in frame {frame} of video '{film.path}', of which frames {first} to "
                f"{first + count - 1} are tracked; begin or end there (--from, --until), or click in one of these"
            )
    if count < 2:
        raise TrackingError(f"'{film.path}' has one frame only {film.span.words}; a trial needs at least 2")
    assert clicked is not None  # it is one of these
    ends = view.seen(clicks.points)
    silhouette = Silhouette(samples, clicked, ends)
    del samples
    times: list[float] = []
    found: list[list[Curve]] = []
    trust = np.ones(count)
    for frame in within(reader, film.span):
        found.append(curves(silhouette.shapes(view.picture(frame)), silhouette.length))
        trust[len(times)] = 1.0 if frame.intact else DOUBT
        times.append(frame.time)
        seen = view.whole(found[-1][0].points) if found[-1] else None
        on_progress(FrameProgress(film.name, len(times), count, 0 if found[-1] else len(places), positions=seen))
    own = clicks.frame - first
    one, begin, length = _clicked(found[own], ends)
    at = begin + places * length
    known = {own: one}
    for anchor in anchors:
        t, said = anchor.frame - first, np.isfinite(anchor.points[:, 0])
        away = [np.hypot(*(_at(curve, at, length) - view.seen(anchor.points))[said].T).mean() for curve in found[t]]
        if said.any() and t != own:  # what no curve fits is taken as it is said
            known |= {t: int(np.argmin(away))} if min(away, default=np.inf) < APART * length else {}
            found[t] = found[t] if t in known else []
    linked = link(found, known)
    sure, reasons = judge(found, linked, known)
    positions, lengths = np.full((count, len(places), 2), np.nan), np.full(count, np.nan)
    for t in np.flatnonzero(linked.chosen >= 0).tolist():
        curve = found[t][linked.chosen[t]]
        positions[t], lengths[t] = view.whole(_at(curve, at, length)), curve.length / view.share
    confidence = np.repeat(np.minimum(sure, trust)[:, None], len(places), axis=1)
    for anchor in anchors:
        t, said = anchor.frame - first, np.isfinite(anchor.points[:, 0])
        positions[t, said], confidence[t, said] = anchor.points[said], 1.0
        positions[t, anchor.hidden] = np.nan
    track = MarkerTrack(np.array(times) - times[0], positions, confidence)
    return Midline(track, lengths, (*_doubts(linked.chosen < 0, reasons), *tail_first(track, length / view.share)))


class _View:
    """Pictures in the size in which they are looked at.

    Attributes:
        share: That size, as a share of the film's.
    """

    def __init__(self, reader: VideoReader, share: float) -> None:
        info = reader.info
        self._width = info.width if share == 1 else max(64, round(share * info.width))
        self.share = self._width / info.width
        height = info.height if share == 1 else max(2, 2 * round(self._width * info.height / info.width / 2))
        self._scale = np.array([self.share, height / info.height])
        self.bytes = 3 * self._width * height

    def picture(self, frame: Frame) -> Image:
        """The picture of a frame, RGB."""
        return frame.image if self.share == 1 else frame.scaled(self._width)

    def seen(self, places: Array) -> Array:
        """Places in it of such in the film [px]. Shapes (..., 2)."""
        return (places + 0.5) * self._scale - 0.5

    def whole(self, places: Array) -> Array:
        """Places in the film of such in it [px]. Shapes (..., 2)."""
        return (places + 0.5) / self._scale - 0.5


def _samples(frames: Iterable[Frame], wanted: int, view: _View) -> tuple[Image | None, list[Image], int]:
    """The picture of a frame, pictures from all over the film, and how many frames there are."""
    most = int(np.clip(SAMPLE_BYTES / view.bytes, 8, SAMPLES))
    picture: Image | None = None
    kept: list[Image] = []
    count, every = 0, 1
    for frame in frames:
        if frame.index == wanted:
            picture = view.picture(frame)
        if count % every == 0:
            kept.append(view.picture(frame))
            if len(kept) == 2 * most:
                kept, every = kept[::2], 2 * every
        count += 1
    return picture, kept, count


def _clicked(found: Sequence[Curve], ends: Array) -> tuple[int, float, float]:
    """Number of the curve between two clicked ends, arc length at the first of them, and from it to the second [px]."""
    off = [np.hypot(*(curve.points[[0, -1]] - ends).T).sum() for curve in found]
    curve = found[int(np.argmin(off))]
    arcs, ways = np.array([_foot(curve, end) for end in ends]).T
    if (ways > np.array(CLICKS) * curve.length).any():
        raise TrackingError(
            f"the shape in the clicked frame ends {ways.max():.0f} px from a click; click the tips "
            "of head and tail in a frame in which nothing touches the swimmer"
        )
    begin = 0.0 if arcs[0] < SNAP * curve.length else float(arcs[0])
    beyond = float(ways[1]) if arcs[1] == curve.length else 0.0
    end = float(arcs[1]) + (beyond if beyond > SNAP * curve.length else 0.0)
    end = curve.length if abs(end - curve.length) < SNAP * curve.length else end
    return int(np.argmin(off)), begin, end - begin


def _foot(curve: Curve, place: Array) -> tuple[float, float]:
    """Arc length at the place of a curve that is nearest another place (2,), and its distance from there [px]."""
    steps = np.diff(curve.points, axis=0)
    shares = ((place - curve.points[:-1]) * steps).sum(axis=1) / np.maximum((steps**2).sum(axis=1), 1e-9)
    shares = np.clip(shares, 0, 1)
    ways = np.hypot(*(curve.points[:-1] + shares[:, None] * steps - place).T)
    k = int(ways.argmin())
    return curve.length * (k + float(shares[k])) / (POINTS - 1), float(ways[k])


def _at(curve: Curve, at: Array, length: float) -> Array:
    """Places at arc lengths from the head of a curve, NaN beyond its end [px]. Shapes (M,), (M, 2)."""
    return places_at(curve.points, np.linspace(0, curve.length, POINTS), at, length)


def _doubts(lost: Mask, reasons: Mapping[str, Mask]) -> list[str]:
    """Sentences on where the midline is lost or in doubt."""
    counts = {name: int(frames.sum()) for name, frames in reasons.items() if frames.any()}
    why = "; ".join(f"{name}: {count}" for name, count in sorted(counts.items(), key=lambda item: -item[1]))
    out = [f"the swimmer isn't found in {lost.sum()} of {len(lost)} frames"] if lost.any() else []
    return out + ([f"the midline is in doubt, in frames: {why}"] if why else [])
