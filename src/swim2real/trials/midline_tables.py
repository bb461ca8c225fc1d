"""Midlines of other programs: points along an animal in each frame, of which places at a robot's sites are made.

Three ways to write them are read: a table with a row per frame and point, as trackter and fishmechr (R) have it; TRex's
`…_posture_….npz`; and a pair of tables, `…_x.csv` and `…_y.csv`, with a row per frame and a column per point, as
WormTracer writes them. Whatever the points' distances are, sites are put at their own, from the head.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from markertrack.midline.places import places_along, tail_first
from markertrack.track import MarkerTrack
from swim2real.trials.text_table import TextTable, read_table
from swimbase.arrays import Array
from swimbase.errors import TrialError
from swimbase.store import read_arrays, reason

_FRAME, _POINT = re.compile("frame(_idx)?", re.IGNORECASE), re.compile("point|n", re.IGNORECASE)
_X_TABLE = re.compile(r"(.*_)x(_rev)?(\.\w+)")
_POSTURE = ("frames", "midline_points", "midline_lengths")  # arrays of TRex
_FEWEST = 4  # points of a midline
_WANTED = (
    "expected are columns frame, point (or n), and x and y of a point, as trackter and fishmechr have them, the npz "
    "that TRex's setting output_posture_data adds, or the first of a pair of tables NAME_x.csv and NAME_y.csv, as "
    "WormTracer writes them"
)

Midlines = Mapping[int, Array]
"""Points of each frame, head first [px]. Shape (N, 2), N of its own in each."""


def read_midlines(path: Path, fps: float, places: Array) -> tuple[MarkerTrack, list[str]]:
    """Reads midlines as places at a robot's sites.

    Args:
        path: The table, the npz, or the first of the two tables.
        fps: Frames a second of the video.
        places: Where the sites are along the body, from 0 at the head to 1 at the tail. Shape (M,).

    Returns:
        The track in pixels, its time 0 at the video's first frame, NaN beyond the end that is seen, and notes.

    Raises:
        TrialError: The file isn't there or isn't such a table, or has several animals.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise TrialError(f"{path}: fps is {fps}; it must be finite and above 0")
    notes: list[str] = []
    if path.suffix.lower() == ".npz":
        midlines = _posture(path)
    elif pair := _X_TABLE.fullmatch(path.name):
        midlines = _pair(path, path.with_name(f"{pair[1]}y{pair[2] or ''}{pair[3]}"))
    else:
        midlines, notes = _rows(read_table(path))
    frames = sorted(midlines)
    known = [points for points in midlines.values() if len(points) >= _FEWEST]
    if len(known) < 2:
        raise TrialError(f"{path}: {len(known)} frames have a midline of {_FEWEST} points or more; 2 are needed")
    if frames[0] < 0:
        raise TrialError(f"{path}: {frames[0]} is no frame number; it must be 0 or above")
    empty = np.empty((0, 2))
    seen = [midlines[t] if len(midlines[t]) >= _FEWEST else empty for t in frames]
    positions = places_along(seen, places)
    track = MarkerTrack(np.array(frames) / fps, positions, np.isfinite(positions[..., 0]).astype(float))
    length = float(np.nanmedian(np.hypot(*np.diff(positions, axis=1).T).sum(axis=0)))
    return track, notes + tail_first(track, length)


def _rows(table: TextTable) -> tuple[Midlines, list[str]]:
    """Midlines of a table with a row per frame and point, and which columns were taken."""
    names = list(table.names)
    frame, point = (next(filter(kind.fullmatch, names), "") for kind in (_FRAME, _POINT))
    pairs = [
        (one, other) for one in names for other in names
        if any(one[k] in "xX" and other == f"{one[:k]}{chr(ord(one[k]) + 1)}{one[k + 1 :]}" for k in range(len(one)))
    ]  # fmt: skip
    if not (frame and point and pairs):
        raise TrialError(f"{table.path}: no midlines; columns are {', '.join(names) or 'not named'}, and {_WANTED}")
    pair = next((pair for pair in pairs if pair[0].endswith((".sm", "_s"))), pairs[0])  # smoothed
    number, order, x, y = (table.numbers(names.index(name)) for name in (frame, point, *pair))
    if not (np.isfinite(number).all() and np.isfinite(order).all()):
        raise TrialError(f"{table.path}: a row has no '{frame}' or no '{point}'; leave such rows out")
    if (number % 1).any():
        raise TrialError(f"{table.path}: column '{frame}' must have whole numbers of frames")
    places = np.stack([number, order], axis=1)
    if len(np.unique(places, axis=0)) < len(places):
        raise TrialError(
            f"{table.path}: a '{point}' comes twice in a '{frame}', as with several animals; export one by itself"
        )
    rows = np.lexsort((order, number))
    points, ends = np.stack([x, y], axis=1)[rows], np.flatnonzero(np.diff(number[rows])) + 1
    others = [name for names in pairs if names != pair for name in names]
    notes = [f"points are at '{pair[0]}' and '{pair[1]}', not at {', '.join(others)}"] * bool(others)
    headless = order[rows][np.append(0, ends)] > order.min()
    parts = [part[:0] if none else part for part, none in zip(np.split(points, ends), headless, strict=True)]
    return dict(zip(map(int, np.unique(number)), map(_seen, parts), strict=True)), notes


def _posture(path: Path) -> Midlines:
    """Midlines of TRex: all as long, or one after the other."""
    try:
        arrays = read_arrays(path)
    except (OSError, ValueError) as error:
        raise TrialError(f"{path}: {reason(error) if isinstance(error, OSError) else error}; {_WANTED}") from error
    if missing := [name for name in _POSTURE if name not in arrays]:
        raise TrialError(f"{path}: array '{missing[0]}' isn't there; {_WANTED}")
    frames, points, counts = (np.asarray(arrays[name], dtype=float) for name in _POSTURE)
    counts = counts.ravel().astype(int)
    if points.shape[-1:] != (2,) or points.size != 2 * counts.sum() or frames.size != len(counts):
        raise TrialError(
            f"{path}: midline_points has shape {points.shape}, where midline_lengths add up to {counts.sum()} and "
            f"there are {frames.size} frames; each midline needs its points, x and y"
        )
    parts = np.split(points.reshape(-1, 2), np.cumsum(counts)[:-1])
    return dict(zip(map(int, frames.ravel()), map(_seen, parts), strict=True))


def _pair(first: Path, second: Path) -> Midlines:
    """Midlines of a table of all x and one of all y."""
    x, y = (read_table(path).matrix("a row per frame and a column per point", least=2) for path in (first, second))
    if x.shape != y.shape:
        raise TrialError(f"{first}: {x.shape} rows and columns, and {y.shape} in '{second.name}'; they must be as many")
    return dict(enumerate(map(_seen, np.stack([x, y], axis=2))))


def _seen(points: Array) -> Array:
    """Points that are known, none where the head isn't: what follows would be at no known distance from it."""
    known = np.isfinite(points).all(axis=1)
    return points[known] if np.flatnonzero(known)[:1].tolist() == [0] else points[:0]
