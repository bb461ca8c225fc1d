"""A film both ways: forth from the points that were clicked and, over each break, back from where all is certain again.

A break is a time in which markers are lost or doubtful. A marker is where one of the ways is certain of it. What a way
is certain of after a break may be another marker: it is believed unless the other way, followed from there without a
break, arrives at another place than where the marker was last certain.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np

from markertrack.quality import DOUBTFUL, runs
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.tracker import DOUBT, Array, Mask, Tracker, contradict
from markertrack.video import Frame, most_frames

SETTLED = 5  # frames in which all markers are certain, after which a break is over
SMEARED = 0.4  # highest confidence in a picture that may be smeared: doubtful to `check_track`

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
    kept: list[Seen] = []  # from the last frame on in which all markers were certain
    clock, settled = 0.0, 0
    last: Frame | None = None
    for frame in frames:
        if last is None:
            positions, confidence = tracker.start(frame.image, points, clock)
        else:
            clock += abs(frame.time - last.time)
            positions, confidence = tracker.follow(frame.image, clock)
        last = frame
        if not frame.intact:  # predicted from a broken one: what it shows may be of another time
            confidence = np.minimum(confidence, SMEARED)
        kept.append((replace(frame), positions, confidence))  # without its converted picture
        settled = settled + 1 if (confidence >= DOUBTFUL).all() else 0
        if settled >= len(kept) or not isinstance(tracker, MarkerTracker):
            yield from kept[:-1]
            del kept[:-1]
        elif settled == SETTLED or len(kept) == most_frames(*frame.image.shape[1::-1]):
            yield from _looked_back(tracker, kept, clock)[:-1]
            del kept[:-1]
    if isinstance(tracker, MarkerTracker) and len(kept) > 1:
        kept = _looked_back(tracker, kept, clock)
    yield from kept


def _looked_back(tracker: MarkerTracker, kept: list[Seen], clock: float) -> list[Seen]:
    """Frames, by the way back as well from the last of them, up to which a tracker has come."""
    tracker = deepcopy(tracker)
    tracker.turn()
    frames, places, sure = zip(*kept, strict=True)
    forth = np.array(places), np.array(sure)
    back = np.full_like(forth[0], np.nan), np.zeros_like(forth[1])
    for k in range(len(frames) - 2, -1, -1):
        clock += abs(frames[k + 1].time - frames[k].time)
        back[0][k], back[1][k] = tracker.follow(replace(frames[k]).image, clock)
    return list(zip(frames, *joined(forth, back, tracker.radii), strict=True))


def joined(forth: tuple[Array, Array], back: tuple[Array, Array], radii: Array) -> tuple[Array, Array]:
    """Positions and confidence by both ways.

    Args:
        forth: Positions [px], shape (T, M, 2), and confidence, shape (T, M).
        back: Those of the way back, in the same order of frames.
        radii: Radii of the markers [px]. Shape (M,).
    """
    positions, confidence = forth[0].copy(), forth[1].copy()
    between = np.linalg.norm(forth[0] - back[0], axis=2)
    apart = contradict(forth[0], back[0], radii)
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
        confidence[~known & ~fill, m] = np.minimum(confidence[~known & ~fill, m], DOUBT)
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
