"""Doubtful places of a track, and corrections by hand, from which a marker is followed in both directions.

Markers that fail at about the same time, near one another, are one stretch: a person sees to them together.

A track keeps what it was sure of, except where a correction contradicts it. Between two places that are known, clicks
or sure frames, a marker is followed anew by flow and looks (`gaps`), forward from the first and backward from the
second. A way that arrives elsewhere than where the marker is known to be is doubtful; `both_ways` joins the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from markertrack.gaps import Gap
from markertrack.points import Anchor
from markertrack.quality import DOUBTFUL, SAMPLES
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import AGREE, DOUBT, Array, Mask

NEAR = 1.25  # times the usual spacing of markers, within which those of one stretch lie
NEIGHBORS = 3  # markers with which a lost one is expected to move on
JUMP_SHARE = 0.4  # of the markers' usual spacing, by which the velocity of a marker may change per frame
MEANWHILE = 5  # frames for which what befalls a marker goes on: between two failures, around one that it is hidden in


@dataclass(frozen=True)
class Stretch:
    """A time in which markers of a track fail.

    Attributes:
        markers: Indices of the markers, which are near one another.
        first: Number of the first frame in which one of them fails, in the track.
        last: Number of the last one.
        reason: What happens to them in most frames.
        failures: Number of marker-frames that are lost or doubtful.
    """

    markers: tuple[int, ...]
    first: int
    last: int
    reason: Literal["lost", "doubtful"]
    failures: int


def find_stretches(track: MarkerTrack) -> list[Stretch]:
    """Finds where a track is lost (without a position, or with confidence 0) or doubtful.

    Args:
        track: Track in pixels.

    Returns:
        Stretches, the one with the most failures first. None where nothing is doubtful.
    """
    lost = ~np.isfinite(track.positions).all(axis=2) | (track.confidence <= 0)
    failing = lost | (track.confidence < DOUBTFUL)
    expected = expected_places(track)
    near = NEAR * spacing(expected)
    runs = [(first, last, m) for m in range(track.marker_count) for first, last in _runs(failing[:, m])]
    groups: list[list[tuple[int, int, int]]] = []
    going: list[list[tuple[int, int, int]]] = []  # groups that a later run can belong to
    for first, last, m in sorted(runs):
        going = [group for group in going if group[0][1] >= first]
        for group in going:
            begin, end, other = group[0]
            common = min(last, end) - first + 1
            apart = expected[first + common // 2, m] - expected[first + common // 2, other]
            if 2 * common >= max(last, end) - begin + 1 and np.hypot(*apart) <= near:
                group.append((first, last, m))
                break
        else:
            groups.append([(first, last, m)])
            going.append(groups[-1])
    stretches: list[Stretch] = []
    for group in groups:
        count = sum(int(failing[first : last + 1, m].sum()) for first, last, m in group)
        missed = sum(int(lost[first : last + 1, m].sum()) for first, last, m in group)
        begin, end = min(run[0] for run in group), max(run[1] for run in group)
        reason = "lost" if 2 * missed >= count else "doubtful"
        stretches.append(Stretch(tuple(sorted({run[2] for run in group})), begin, end, reason, count))
    return sorted(stretches, key=lambda stretch: (-stretch.failures, stretch.first))


def expected_places(track: MarkerTrack) -> Array:
    """Expected places of each marker: between its sure frames it moves with its neighbors [px]. Shape (T, M, 2).

    NaN for a marker that was never seen.
    """
    seen = np.isfinite(track.positions).all(axis=2) & (track.confidence > 0)
    sure = seen & (track.confidence >= DOUBTFUL)
    known = np.where(sure.any(axis=0), sure, seen)
    filled = _filled(track.positions, known)
    apart = _apart(filled)
    expected = filled.copy()
    for m in np.flatnonzero(~known.all(axis=0)).tolist():
        beside = np.argsort(apart[m])[:NEIGHBORS]
        beside = beside[np.isfinite(apart[m, beside])]
        if len(beside):
            carried = filled[:, beside].mean(axis=1)
            offset = (track.positions[:, m] - carried)[:, None]
            expected[:, m] = carried + _filled(offset, known[:, m : m + 1])[:, 0]
    return expected


def spacing(places: Array) -> float:
    """Usual distance of a marker from the next one [px]; NaN where there is one marker."""
    nearest = _apart(places).min(axis=1)
    return float(np.median(nearest[np.isfinite(nearest)])) if np.isfinite(nearest).any() else float("nan")


def gaps_to_correct(
    track: MarkerTrack, anchors: Sequence[Anchor], bodies: Sequence[int]
) -> tuple[MarkerTrack, list[Gap]]:
    """The track without what corrections contradict, and the stretches in which markers are followed anew.

    A click on a place that was doubted of a body of several markers says which of its markers is which: it confirms all
    of them, in this frame and in those around it that were doubted and through which the marker moves on steadily.

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
            same = np.flatnonzero(np.asarray(bodies) == bodies[m])
            if len(same) > 1 and off < AGREE[1]:
                part = _steady(positions[:, m], seen[:, m] & ~sure[:, m], anchor.frame, JUMP_SHARE * apart)
                sure[part, same[:, None]] |= seen[part, same[:, None]]
                continue
            clicks.setdefault(m, {})[anchor.frame] = anchor.points[m]
            if sure[anchor.frame, m]:
                first, last = _around(~sure[:, m], anchor.frame)
                sure[first : last + 1, m] = False
        for m in np.flatnonzero(anchor.hidden).tolist():
            hidden.setdefault(m, set()).add(anchor.frame)
            near = slice(max(anchor.frame - MEANWHILE, 0), anchor.frame + MEANWHILE + 1)
            sure[near, m] = False
            positions[near, m], confidence[near, m] = np.nan, 0.0
    for m, places in clicks.items():
        for frame, place in places.items():
            positions[frame, m] = place
    confidence = np.where(sure, np.maximum(confidence, DOUBTFUL), np.minimum(confidence, DOUBT))
    for m, places in clicks.items():
        confidence[list(places), m] = 1.0
    cleaned = MarkerTrack(track.times, positions, confidence)
    gaps: list[Gap] = []
    for m, places in clicks.items():
        certain = sure[:, m].copy()
        certain[list(places)] = False
        for first, last in sorted({_around(certain, frame) for frame in places}):
            known = {frame: place for frame, place in places.items() if first <= frame <= last}
            known |= {frame: positions[frame, m] for frame in (first - 1, last + 1) if 0 <= frame < len(sure)}
            inside = frozenset(frame for frame in hidden.get(m, ()) if first <= frame <= last)
            gaps.append(Gap(m, first, last, known, inside))
    return cleaned, gaps


def corrected(track: MarkerTrack, gaps: Sequence[Gap]) -> MarkerTrack:
    """The track with the markers as they were followed in gaps that have seen all of their pictures."""
    positions, confidence = track.positions.copy(), track.confidence.copy()
    for gap in gaps:
        part, beside = slice(gap.first, gap.last + 1), np.arange(track.marker_count) != gap.marker
        places, sure = gap.followed()
        away = np.linalg.norm(track.positions[part] - places[:, None], axis=2)[:, beside]
        taken = (away < gap.radius) & (track.confidence[part][:, beside] >= DOUBTFUL)
        positions[part, gap.marker] = places
        confidence[part, gap.marker] = np.where(taken.any(axis=1), np.minimum(sure, DOUBT), sure)
    return MarkerTrack(track.times, positions, confidence)


def _steady(places: Array, doubted: Mask, frame: int, most: float) -> NDArray[np.int64]:
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


def _around(known: Mask, frame: int) -> tuple[int, int]:
    """First and last of the frames around one that lie between two that are known."""
    before, after = np.flatnonzero(known[:frame]), np.flatnonzero(known[frame + 1 :])
    first = int(before[-1]) + 1 if len(before) else 0
    return first, (frame + int(after[0]) if len(after) else len(known) - 1)


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """First and last frames of what is true, over gaps of at most `MEANWHILE` frames."""
    at = np.flatnonzero(mask)
    parts = np.split(at, np.flatnonzero(np.diff(at) > MEANWHILE + 1) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts if len(part)]


def _filled(positions: Array, known: Mask) -> Array:
    """Positions with straight lines between known frames, and the nearest known one at the ends. Shape (T, M, 2)."""
    out, frames = np.full(positions.shape, np.nan), np.arange(len(positions))
    for m in np.flatnonzero(known.any(axis=0)).tolist():
        at = np.flatnonzero(known[:, m])
        for axis in range(2):
            out[:, m, axis] = np.interp(frames, at, positions[at, m, axis])
    return out


def _apart(places: Array) -> Array:
    """Usual distance of each two markers, infinite of a marker from itself or one never seen [px]. Shape (M, M)."""
    sample = places[np.linspace(0, len(places) - 1, min(len(places), SAMPLES)).astype(int)]
    apart = np.median(np.linalg.norm(sample[:, :, None] - sample[:, None], axis=3), axis=0)
    return np.where(np.eye(len(apart), dtype=bool) | np.isnan(apart), np.inf, apart)
