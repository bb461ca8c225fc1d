"""Where a track is doubtful: stretches of it in which markers are lost, or their positions not to be believed.

Markers that fail at about the same time, near one another, are one stretch: a person sees to them together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swim2real.tracking.quality import DOUBTFUL
from swim2real.trials.trial import MarkerTrack

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GAP = 5  # frames between two failures of a marker that are one stretch
OVERLAP = 0.5  # share of their common time in which two markers of one stretch fail at once
NEAR = 1.25  # times the usual spacing of markers, within which those of one stretch lie
NEIGHBORS = 3  # markers with which a lost one is expected to move on
_SAMPLES = 50  # frames that tell how far apart markers are


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


def find_stretches(track: MarkerTrack, gap: int = GAP) -> list[Stretch]:
    """Finds where a track is lost (without a position, or with confidence 0) or doubtful.

    Args:
        track: Track in pixels.
        gap: Number of frames between two failures of a marker that don't part them.

    Returns:
        Stretches, the one with the most failures first. None where nothing is doubtful.
    """
    lost = ~np.isfinite(track.positions).all(axis=2) | (track.confidence <= 0)
    failing = lost | (track.confidence < DOUBTFUL)
    expected = expected_places(track)
    near = NEAR * spacing(expected)
    runs = [(first, last, m) for m in range(track.marker_count) for first, last in _runs(failing[:, m], gap)]
    groups: list[list[tuple[int, int, int]]] = []
    going: list[list[tuple[int, int, int]]] = []  # groups that a later run can belong to
    for first, last, m in sorted(runs):
        going = [group for group in going if group[0][1] >= first]
        for group in going:
            begin, end, other = group[0]
            common = min(last, end) - first + 1
            apart = expected[first + common // 2, m] - expected[first + common // 2, other]
            if common >= OVERLAP * (max(last, end) - begin + 1) and np.hypot(*apart) <= near:
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
    """Where each marker should be by its sure frames, between which it moves with its neighbors [px]. Shape (T, M, 2).

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


def _runs(mask: Mask, gap: int) -> list[tuple[int, int]]:
    """First and last frames of what is true, over gaps of at most so many frames."""
    at = np.flatnonzero(mask)
    parts = np.split(at, np.flatnonzero(np.diff(at) > gap + 1) + 1)
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
    sample = places[np.linspace(0, len(places) - 1, min(len(places), _SAMPLES)).astype(int)]
    apart = np.median(np.linalg.norm(sample[:, :, None] - sample[:, None], axis=3), axis=0)
    return np.where(np.eye(len(apart), dtype=bool) | np.isnan(apart), np.inf, apart)
