"""A film both ways: forth from the points that were clicked and, over each break, back from where all is certain again.

A break is a time in which markers are lost or doubtful. What neither way knows is looked for in the whole of it: a
marker that nothing connects is followed anew, both ways, from what can only be it (`tracklets`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from itertools import combinations

import numpy as np

from markertrack.corrections import corrected
from markertrack.gaps import Gap, follow_gaps, joined
from markertrack.quality import DOUBTFUL, runs
from markertrack.track import MarkerTrack
from markertrack.tracking.markers import RIGHT, MarkerTracker
from markertrack.tracking.tracker import DOUBT, Array, Tracker
from markertrack.tracklets import ENDS, Motion, Things, Tracklet, belonging, known_stretches
from markertrack.video import Frame, most_frames

BEFORE = ENDS + 1  # frames in which all are certain: after a break it is over, before one they tell how markers moved

Seen = tuple[Frame, Array, Array]


def both_ways(tracker: Tracker, frames: Iterable[Frame], points: Array) -> Iterator[Seen]:
    """Follows markers through frames that follow one another, or precede one another, from known points in the first.

    Args:
        tracker: A tracker that has seen nothing.
        frames: The first one with the points, and those after or before it.
        points: Places of the markers in the first one [px]. Shape (M, 2).

    Yields:
        Each frame with positions [px], shape (M, 2), and confidence, shape (M,). Those of a break come when it is over.
    """
    kept: list[Seen] = []  # from a little before the last frame on in which all markers were certain
    clock, settled = 0.0, 0
    past: dict[int, Tracklet] = {}  # where markers were known before that
    motion = Motion()
    last: Frame | None = None
    for frame in frames:
        if last is None:
            positions, confidence = tracker.start(frame.image, points, clock)
        else:
            clock += abs(frame.time - last.time)
            positions, confidence = tracker.follow(frame.image, clock)
        last = frame
        if not frame.intact:  # predicted from a broken one: what it shows may be of another time
            confidence = np.minimum(confidence, DOUBT)
        kept.append((replace(frame), positions, confidence))  # without its converted picture
        if len(kept) >= ENDS:
            places, sure = (np.array([one[n] for one in kept[-ENDS:]]) for n in (1, 2))
            motion.see(places, sure >= DOUBTFUL)
        settled = settled + 1 if (confidence >= DOUBTFUL).all() else 0
        if settled >= len(kept) or not isinstance(tracker, MarkerTracker):
            yield from kept[:-BEFORE]
            del kept[:-BEFORE]
        elif settled == BEFORE or len(kept) == most_frames(*frame.image.shape[1::-1]):
            kept = _looked_back(tracker, kept, clock, past, motion)
            past = _earlier(past, kept)
            yield from kept[:-BEFORE]
            del kept[:-BEFORE]
    if isinstance(tracker, MarkerTracker) and settled < len(kept):
        kept = _looked_back(tracker, kept, clock, past, motion)
    yield from kept


def _earlier(past: dict[int, Tracklet], kept: list[Seen]) -> dict[int, Tracklet]:
    """The last stretches in which markers were known, numbered from the last few of the frames on."""
    places, sure = (np.array([one[n] for one in kept]) for n in (1, 2))
    newer = {one.marker: one for one in known_stretches(places, sure)}
    gone = max(len(kept) - BEFORE, 0)
    return {m: Tracklet(one.first - gone, one.places, m) for m, one in (past | newer).items()}


def _looked_back(
    tracker: MarkerTracker, kept: list[Seen], clock: float, past: dict[int, Tracklet], motion: Motion
) -> list[Seen]:
    """Frames, by the way back as well from the last of them, up to which a tracker has come."""
    turned = deepcopy(tracker)
    turned.turn()
    frames, places, sure = zip(*kept, strict=True)
    forth = np.array(places), np.array(sure)
    back = np.full_like(forth[0], np.nan), np.zeros_like(forth[1])
    for k in range(len(frames) - 2, -1, -1):
        clock += abs(frames[k + 1].time - frames[k].time)
        back[0][k], back[1][k] = turned.follow(replace(frames[k]).image, clock)
    both = joined(forth, back, turned.radii)
    return list(zip(frames, *_found_again(tracker, frames, *both, past, motion), strict=True))


def _found_again(
    tracker: MarkerTracker,
    frames: Sequence[Frame],
    positions: Array,
    confidence: Array,
    past: dict[int, Tracklet],
    motion: Motion,
) -> tuple[Array, Array]:
    """Positions [px] and confidence, with markers that are lost followed from where they can only be."""
    stretches = known_stretches(positions, confidence)
    stretches += [one for one in past.values() if one.last < 0]
    known = np.where((confidence >= DOUBTFUL)[..., None], positions, np.nan)
    lost = set(np.flatnonzero((confidence < DOUBTFUL).sum(axis=0) > 1).tolist()) & {one.marker for one in stretches}
    looks = {m: tracker.looks[m] for m in sorted(lost & tracker.looks.keys())}
    if not looks:
        return positions, confidence
    things = {
        m: Things(tracker.colors, look.of(np.array([0])), m, float(tracker.radii[m])) for m, look in looks.items()
    }
    room = 0.0
    for k, frame in enumerate(frames):
        image = replace(frame).image
        room += image.shape[0] * image.shape[1]
        for m, one in things.items():
            one.see(image, k, known[k, m], known[k], tracker.radii + tracker.radii[m])
    seen: dict[int, dict[int, Array]] = {}
    for m, one in things.items():
        belong = belonging([*one.tracklets, *stretches], m, one.radius, motion, room, RIGHT)
        seen[m] = {one.first + k: place for one in belong for k, place in enumerate(one.places)}
    for m, n in combinations(seen, 2):  # one thing is one marker
        for k in seen[m].keys() & seen[n].keys():
            if np.hypot(*(seen[m][k] - seen[n][k])) < max(tracker.radii[m], tracker.radii[n]):
                del seen[m][k], seen[n][k]
    gaps: list[Gap] = []
    for m, places in seen.items():
        for first, end in runs(confidence[:, m] < DOUBTFUL).tolist():
            if any(first <= k < end for k in places):
                beside = {k: positions[k, m] for k in (first - 1, end) if 0 <= k < len(frames)}
                gaps.append(Gap(m, first, end - 1, beside, seen=places, looks=looks[m]))
    follow_gaps(gaps, enumerate(frames), ahead=True)
    follow_gaps(gaps, reversed(list(enumerate(frames))), ahead=False)
    track = corrected(MarkerTrack([frame.time for frame in frames], positions, confidence), gaps)
    return track.positions, track.confidence
