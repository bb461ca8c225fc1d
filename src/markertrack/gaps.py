"""Stretches of a track in which one marker is followed anew, and what two ways through them know together.

A marker is where one of the ways is certain of it. What a way is certain of after a break may be another marker: it is
believed unless the other way, followed from there without a break, arrives at another place than where the marker was
last certain.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from markertrack.quality import DOUBTFUL, runs
from markertrack.tracking.looks import Looks
from markertrack.tracking.markers import RIGHT, SAME, MarkerTracker
from markertrack.tracking.tracker import DOUBT, Array, Image, Mask, contradict
from markertrack.video import Frame
from swimbase.errors import TrackingError


@dataclass
class Gap:
    """A stretch of a track in which one marker is followed anew, from what is known of it, both ways.

    Attributes:
        marker: Its index.
        first: Number of the first frame of the stretch in the track.
        last: Number of the last one.
        known: Places that are known in it and beside it, by frame [px].
        hidden: Frames of it in which the marker is hidden.
        seen: Places of what can only be the marker, by frame: a way that is elsewhere then is in doubt [px].
        looks: What the marker looks like; None where a person says where it is, and it is learned there.
    """

    marker: int
    first: int
    last: int
    known: dict[int, Array]
    hidden: frozenset[int] = frozenset()
    seen: dict[int, Array] = field(default_factory=dict)
    looks: Looks | None = None

    def __post_init__(self) -> None:
        self.forth, self.back = _Way(self), _Way(self)

    @property
    def radius(self) -> float:
        """Radius of the marker [px]."""
        return max(self.forth.radius, self.back.radius)

    @property
    def begin(self) -> int:
        """The frame before the stretch."""
        return self.first - 1

    @property
    def end(self) -> int:
        """The frame after it."""
        return self.last + 1

    def followed(self) -> tuple[Array, Array]:
        """Places, NaN where the marker is lost [px], and confidence in each frame. Shapes (L, 2), (L,)."""
        places, sure = np.full_like(self.forth.places, np.nan), np.zeros_like(self.forth.sure)
        for begin, end in pairwise(sorted({*self.known, *self.hidden, self.begin, self.end})):
            part = slice(begin - self.begin, end - self.begin + 1)
            places[part], sure[part] = self._between(begin, end, part)
        for frame in self.hidden:
            places[frame - self.begin], sure[frame - self.begin] = np.nan, 0.0
        return places[1:-1], sure[1:-1]

    def _between(self, begin: int, end: int, part: slice) -> tuple[Array, Array]:
        """Places and confidence from one stop to the next, by both ways."""
        forth, back = ((way.places[part].copy(), way.sure[part].copy()) for way in (self.forth, self.back))
        for (places, sure), at, stop in ((forth, -1, end), (back, 0, begin)):  # where a way arrives
            if stop in self.known and sure[at] >= DOUBTFUL and contradict(places[at], self.known[stop], self.radius):
                sure[:] = np.minimum(sure, DOUBT)  # at another marker: nobody knows since when
        for at, stop in ((0, begin), (-1, end)):
            for places, sure in (forth, back):
                places[at], sure[at] = self.known.get(stop, np.nan), stop in self.known
        one, other = ((places[:, None], sure[:, None]) for places, sure in (forth, back))
        places, sure = joined(one, other, np.array([self.radius]))
        return places[:, 0], sure[:, 0]


class _Way:
    """One way through a gap: the marker is picked in each frame in which it is known, and followed from there.

    Attributes:
        places: Where it led to in each frame, from the one before the gap to the one after it [px]. Shape (L + 2, 2).
        sure: Confidence. Shape (L + 2,).
        radius: Of the marker [px]; 0 as long as it wasn't picked.
    """

    def __init__(self, gap: Gap) -> None:
        count = gap.end - gap.begin + 1
        self.places, self.sure, self.radius = np.full((count, 2), np.nan), np.zeros(count), 0.0
        self._gap = gap
        self._tracker: MarkerTracker | None = None

    def see(self, image: Image, frame: int, clock: float) -> None:
        """Takes the next picture of the gap on the way, its number in the track, and a time that grows."""
        at, gap = frame - self._gap.begin, self._gap
        if self._tracker is not None:
            (self.places[at],), (self.sure[at],) = self._tracker.follow(image, clock)
            self.radius = float(self._tracker.radii[0])
            if frame in gap.seen and contradict(self.places[at], gap.seen[frame], self.radius):
                self.sure[at] = min(self.sure[at], DOUBT)
        if frame in gap.hidden:
            self._tracker = None
        elif frame in gap.known:
            self._tracker = self._begun(image, gap.known[frame], clock)
        elif frame in gap.seen and self.sure[at] < DOUBTFUL and gap.looks is not None:
            looks = gap.looks.of(np.array([0]))
            place, score, _ = looks.find_picture(image, 0, gap.seen[frame], float(looks.radii[0]))
            if score > SAME:
                self.places[at], self.sure[at] = place, RIGHT
                self._tracker = self._begun(image, self.places[at], clock)

    def _begun(self, image: Image, place: Array, clock: float) -> MarkerTracker | None:
        """A tracker that begins with the marker at a place (2,); None if nothing can be made out there."""
        tracker = MarkerTracker([0])
        if self._gap.looks is not None:
            looks = self._gap.looks.of(np.array([0]))
            tracker.take_over(image, looks, place[None], clock)
            return tracker
        try:
            tracker.start(image, place[None], clock)
        except TrackingError:
            return None
        return tracker


def follow_gaps(gaps: Sequence[Gap], frames: Iterable[tuple[int, Frame]], ahead: bool) -> None:
    """Follows markers through their gaps, on the way ahead or back, by numbered frames in that order."""
    for k, frame in frames:
        seen = replace(frame)  # its converted picture isn't kept
        for gap in gaps:
            if gap.begin <= k <= gap.end:  # other pictures aren't converted
                way, clock = (gap.forth, frame.time) if ahead else (gap.back, -frame.time)
                way.see(seen.image, k, clock)


def joined(forth: tuple[Array, Array], back: tuple[Array, Array], radii: Array) -> tuple[Array, Array]:
    """Positions and confidence by both ways.

    Args:
        forth: Positions [px], shape (T, M, 2), and confidence, shape (T, M).
        back: Those of the way back, in the same order of frames.
        radii: Radii of the markers [px]. Shape (M,).
    """
    positions, confidence = forth[0].copy(), forth[1].copy()
    between = np.linalg.norm(forth[0] - back[0], axis=2)
    apart, filled = contradict(forth[0], back[0], radii), np.zeros_like(confidence, dtype=bool)
    for m in range(positions.shape[1]):
        certain, again, other = forth[1][:, m] >= DOUBTFUL, back[1][:, m] >= DOUBTFUL, apart[:, m]
        known = certain & ~_refuted(certain, again, other)
        kept = again & ~_refuted(again[::-1], certain[::-1], other[::-1])[::-1]
        near = np.isfinite(between[:, m]) & ~other
        confirmed = near.copy()
        for first, end in runs(kept):
            begun = end == len(certain) - 1 and certain[-1]
            if begun or (near & known)[first:end].any():  # else nothing says that it is this marker
                confirmed[first + 1 : end - 1] = True  # not where it is lost next: no other place confirms that one
        fill = kept & ~known & confirmed
        positions[fill, m], confidence[fill, m] = back[0][fill, m], back[1][fill, m]
        unknown = ~known & ~fill | known & kept & other  # or they contradict one another
        confidence[unknown, m] = np.minimum(confidence[unknown, m], DOUBT)
        filled[:, m] = fill
    for k in np.flatnonzero(filled.any(axis=1)):  # one thing is one marker: that which both ways, or one, knew there
        near = np.linalg.norm(positions[k, :, None] - positions[k], axis=2) < np.minimum(radii[:, None], radii)
        near &= ~filled[k] & (confidence[k] >= DOUBTFUL) & ~np.eye(len(radii), dtype=bool)
        twice = filled[k] & near.any(axis=1)
        confidence[k, twice] = DOUBT
    return positions, confidence


def _refuted(certain: Mask, again: Mask, apart: Mask) -> Mask:
    """Frames in which a marker is certain from which the way back leads elsewhere than it came from. Shapes (T,)."""
    out = np.zeros_like(certain)
    stretches = runs(certain)
    known = stretches[0][1] - 1 if len(stretches) else 0  # last frame that is believed
    for first, end in stretches[1:]:
        same = np.flatnonzero(again[first:end] & ~apart[first:end])
        if len(same) and again[known : first + same[0]].all() and apart[known]:
            out[first:end] = True
        else:
            known = end - 1
    return out
