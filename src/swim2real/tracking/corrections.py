"""Corrections by hand: a marker that a person put right is followed from there in both directions.

A track keeps what it was sure of, except where a correction contradicts it. Between two places that are known, clicks
or sure frames, a marker is followed forward from the first and backward from the second by its picture (`patches`), and
moves with its neighbors meanwhile. Where both ways meet it is sure, where they don't it is doubtful.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swim2real.tracking.appearance import radius_at
from swim2real.tracking.patches import Patches
from swim2real.tracking.points import Anchor
from swim2real.tracking.quality import DOUBTFUL
from swim2real.tracking.stretches import expected_places, spacing
from swim2real.trials.trial import MarkerTrack

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
_Found = tuple[Array, float]  # place and score

ROOM = (32, 80)  # px around an expected place that are kept, at least and at most
AGREE = 0.5  # radii within which the ways from both sides agree, or
AGREE_PX = 2.0  # px
CLICK_PX, MOST_CLICK_PX = 2.0, 6.0  # by which a click that confirms a place may be off it, at least and at most
CLICK_SHARE = 0.05  # of the markers' usual spacing, likewise
JUMP_SHARE = 0.4  # of that spacing by which the velocity of a marker may change per frame
FAIR = 0.7  # correlation of a marker on which both ways agree
CHANGED = 0.9  # correlation below which its picture is taken anew
SURE = 0.8  # correlation of a marker that is followed without a doubt
MEANWHILE = 5  # frames that a click is believed against the track, on each side, where it says that a marker is hidden
DOUBT = 0.45  # confidence of a place on which the two ways don't agree


@dataclass
class Gap:
    """A stretch of a track in which one marker is followed anew.

    Attributes:
        marker: Its index.
        first: Number of the first frame of the stretch in the track.
        known: Places that are known in it and beside it, by frame [px].
        hidden: Frames of it in which the marker is hidden.
        expected: Where it may be in each frame. Shape (T, 2).
        room: Distance around the expected place that is kept of each picture [px].
    """

    marker: int
    first: int
    last: int
    known: dict[int, Array]
    hidden: frozenset[int]
    expected: Array
    room: int

    def __post_init__(self) -> None:
        self._windows: dict[int, tuple[Image, Array]] = {}

    def needs(self, frame: int) -> bool:
        """Whether a frame lies in the stretch or beside it."""
        return self.first - 1 <= frame <= self.last + 1

    def see(self, frame: int, image: Image) -> None:
        """Keeps what is needed of the picture of a frame."""
        left, top = np.maximum(np.round(self.expected[frame]).astype(int) - self.room, 0).tolist()
        right, bottom = np.round(self.expected[frame]).astype(int) + self.room + 1
        part = np.ascontiguousarray(image[top : max(int(bottom), top + 1), left : max(int(right), left + 1)])
        self._windows[frame] = part, np.array([left, top], dtype=float)

    def followed(self) -> tuple[Array, Array]:
        """Places, NaN where the marker is lost [px], and confidence in each frame. Shapes (L, 2), (L,)."""
        count = self.last - self.first + 1
        places, confidence = np.full((count, 2), np.nan), np.zeros(count)
        stops = sorted({*self.known, *self.hidden, self.first - 1, self.last + 1})
        for begin, end in pairwise(stops):
            frames = range(begin + 1, end)
            forward = self._follow(begin, list(frames)) if begin in self.known else {}
            backward = self._follow(end, list(reversed(frames))) if end in self.known else {}
            for frame in frames:
                place, sure = self._joined(frame, begin, end, forward.get(frame), backward.get(frame))
                places[frame - self.first], confidence[frame - self.first] = place, sure
        for frame, place in self.known.items():
            if self.first <= frame <= self.last:
                places[frame - self.first], confidence[frame - self.first] = place, 1.0
        return places, confidence

    def _follow(self, begin: int, frames: list[int]) -> dict[int, _Found]:
        """Places and scores in frames one after the other, from a known one on."""
        image, corner = self._windows[begin]
        place = self.known[begin]
        self._radius = radius_at(image, (place - corner)[None])
        patches = Patches(image, (place - corner)[None], np.array([self._radius]), np.full((1, 3), 85.0))
        found: dict[int, _Found] = {}
        before = begin
        for frame in frames:
            image, corner = self._windows[frame]
            place = place + self.expected[frame] - self.expected[before]
            before = frame
            peaks = patches.find(image, 0, place - corner, 1.5 * self._radius + 3.0)
            if peaks:
                place = np.array([peaks[0].x, peaks[0].y]) + corner
                found[frame] = place, peaks[0].score
                if SURE < peaks[0].score < CHANGED:  # each time it is taken anew, its place is off by a little
                    patches.learn(image, 0, place - corner)
        return found

    def _joined(
        self, frame: int, begin: int, end: int, forward: _Found | None, backward: _Found | None
    ) -> tuple[Array | float, float]:
        """Place and confidence in a frame between two stops."""
        if forward is None and backward is None:
            return np.nan, 0.0
        if forward is not None and backward is not None:
            if np.hypot(*(forward[0] - backward[0])) < max(AGREE * self._radius, AGREE_PX):
                share = (frame - begin) / (end - begin)
                score = max(forward[1], backward[1])
                return (1 - share) * forward[0] + share * backward[0], score if score > FAIR else DOUBT
            return (forward if frame - begin < end - frame else backward)[0], DOUBT
        place, score = forward or backward or (np.full(2, np.nan), 0.0)
        other = end if forward is not None else begin
        return place, score if score > SURE and other not in self.known else min(score, DOUBT)


def gaps_to_correct(
    track: MarkerTrack, anchors: Sequence[Anchor], bodies: Sequence[int]
) -> tuple[MarkerTrack, list[Gap]]:
    """The track without what corrections contradict, and the stretches in which markers are followed anew.

    A click on a place that was doubted confirms it, and with it all markers of the rigid body, in this frame and in
    those around it that were doubted and through which the marker moves on steadily.

    Args:
        track: Track in pixels.
        anchors: What a person says of frames of the track; frame numbers are those of the track.
        bodies: Number of the rigid body that carries each marker. Shape (M,).
    """
    positions, confidence = track.positions.copy(), track.confidence.copy()
    sure, seen = confidence >= DOUBTFUL, np.isfinite(positions[:, :, 0])
    apart = np.nan_to_num(spacing(expected_places(track)), nan=np.inf)
    clicks: dict[int, dict[int, Array]] = {}
    hidden: dict[int, set[int]] = {}
    for anchor in anchors:
        for m in np.flatnonzero(np.isfinite(anchor.points[:, 0])).tolist():
            off = np.hypot(*(positions[anchor.frame, m] - anchor.points[m]))
            if off < max(CLICK_PX, min(CLICK_SHARE * apart, MOST_CLICK_PX)):
                part = _steady(positions[:, m], seen[:, m] & ~sure[:, m], anchor.frame, JUMP_SHARE * apart)
                same = np.flatnonzero(np.asarray(bodies) == bodies[m])
                sure[part, same[:, None]] |= seen[part, same[:, None]]
                continue
            clicks.setdefault(m, {})[anchor.frame] = anchor.points[m]
            if sure[anchor.frame, m]:
                sure[_run(sure[:, m], anchor.frame), m] = False
        for m in np.flatnonzero(anchor.hidden).tolist():
            hidden.setdefault(m, set()).add(anchor.frame)
            near = slice(max(anchor.frame - MEANWHILE, 0), anchor.frame + MEANWHILE + 1)
            sure[near, m] = False
            positions[near, m], confidence[near, m] = np.nan, 0.0
    for m, places in clicks.items():
        for frame, place in places.items():
            positions[frame, m], confidence[frame, m] = place, 1.0
    confidence = np.where(sure, np.maximum(confidence, DOUBTFUL), np.minimum(confidence, DOUBT))
    for m, places in clicks.items():
        confidence[list(places), m] = 1.0
    cleaned = MarkerTrack(track.times, positions, confidence)
    expected = expected_places(cleaned)
    room = int(np.clip(np.nan_to_num(spacing(expected), nan=ROOM[1]), *ROOM))
    gaps: list[Gap] = []
    for m, places in clicks.items():
        certain = sure[:, m].copy()
        certain[list(places)] = False
        for first, last in sorted({_around(certain, frame) for frame in places}):
            known = {frame: place for frame, place in places.items() if first <= frame <= last}
            known |= {frame: positions[frame, m] for frame in (first - 1, last + 1) if 0 <= frame < len(sure)}
            inside = frozenset(frame for frame in hidden.get(m, ()) if first <= frame <= last)
            gaps.append(Gap(m, first, last, known, inside, expected[:, m], room))
    return cleaned, gaps


def corrected(track: MarkerTrack, gaps: Sequence[Gap]) -> MarkerTrack:
    """The track with the markers as they were followed in gaps that have seen all of their pictures."""
    positions, confidence = track.positions.copy(), track.confidence.copy()
    for gap in gaps:
        part = slice(gap.first, gap.last + 1)
        positions[part, gap.marker], confidence[part, gap.marker] = gap.followed()
    return MarkerTrack(track.times, positions, confidence)


def _run(mask: NDArray[np.bool_], frame: int) -> slice:
    """The frames around one in which a mask is as there."""
    first, last = _around(mask != mask[frame], frame)
    return slice(first, last + 1)


def _steady(places: Array, doubted: NDArray[np.bool_], frame: int, most: float) -> NDArray[np.int64]:
    """The doubted frames around one, up to where a marker's velocity changes by more than some way per frame [px]."""
    found = [frame]
    for step in (-1, 1):
        t = frame + step
        while 0 <= t < len(places) and doubted[t]:
            before = t - 2 * step
            last = places[t - step] - places[before] if frame != t - step and 0 <= before < len(places) else np.zeros(2)
            if not np.hypot(*(places[t] - places[t - step] - last)) < most:
                break
            found.append(t)
            t += step
    return np.array(sorted(found))


def _around(known: NDArray[np.bool_], frame: int) -> tuple[int, int]:
    """First and last of the frames around one that lie between two that are known."""
    before, after = np.flatnonzero(known[:frame]), np.flatnonzero(known[frame + 1 :])
    first = int(before[-1]) + 1 if len(before) else 0
    return first, (frame + int(after[0]) if len(after) else len(known) - 1)
