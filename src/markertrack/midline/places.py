"""Places of sites on midlines: each at its distance from the head, along the body; lost beyond the end that is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from markertrack.track import MarkerTrack
from swimbase.arrays import Array

BEYOND = 0.03  # lengths beyond the visible end at which a place still is there
BACKWARD = 0.5  # lengths that a swimmer goes tail first, from which it is reported
FINER = 16  # times, in which a curve through points is followed


def places_at(points: Array, travel: Array, wanted: Array, length: float) -> Array:
    """Places at arc lengths from the head of a line, NaN beyond its end.

    Args:
        points: Points of the line. Shape (N, 2).
        travel: Arc lengths of these, from 0. Shape (N,).
        wanted: Arc lengths of the places. Shape (M,).
        length: Usual length of the body.

    Returns:
        In the unit of all of these. Shape (M, 2).
    """
    end = travel[-1]
    wanted = np.where((wanted > end) & (wanted < end + BEYOND * length), end, wanted)
    return np.stack([np.interp(wanted, travel, points[:, k], right=np.nan) for k in (0, 1)], axis=1)


def places_along(midlines: Sequence[Array], places: Array) -> Array:
    """Places along a body whose midline is known by points at any distances; its length is the median over frames.

    Args:
        midlines: Points of each frame, head first. Shapes (N, 2), of N = 0 where there is no midline.
        places: Where the sites are, from 0 at the head to 1 at the tail. Shape (M,).

    Returns:
        In the unit of the midlines. Shape (T, M, 2).
    """
    lines = [_curve(points) for points in midlines]
    length = float(np.median([travel[-1] for _, travel in lines if len(travel)]))
    out = np.full((len(lines), len(places), 2), np.nan)
    for t, (points, travel) in enumerate(lines):
        if len(travel):
            out[t] = places_at(points, travel, places * length, length)
    return out


def tail_first(track: MarkerTrack, length: float) -> list[str]:
    """A sentence where a swimmer of a length [px] goes tail first by more than some of them."""
    seen = np.isfinite(track.positions[:, [0, -1]]).all(axis=(1, 2))
    ends, middle = track.positions[seen][:, [0, -1]], track.positions[seen].mean(axis=1)
    axes = ends[:-1, 0] - ends[:-1, 1]
    ahead = (np.diff(middle, axis=0) * axes).sum(axis=1) / np.hypot(*axes.T)
    way = float(np.nansum(ahead)) / length
    if way > -BACKWARD:
        return []
    return [f"the swimmer goes tail first for {-way:.1f} of its lengths: are head and tail the wrong way round?"]


def _curve(points: Array) -> tuple[Array, Array]:
    """A smooth curve through points (N, 2), and the arc lengths of its own. Shapes (K, 2), (K,)."""
    points = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 0)] if len(points) else points
    if len(points) < 2:
        return np.empty((0, 2)), np.empty(0)
    chords = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    fine = np.interp(np.linspace(0, len(points) - 1, FINER * (len(points) - 1) + 1), np.arange(len(points)), chords)
    curve = np.asarray(CubicSpline(chords, points)(fine))
    return curve, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
