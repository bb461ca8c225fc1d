"""Pose tables: x, y and likelihood per marker, a row per frame. Pixels, y down.

Written as DeepLabCut does it, which DeepLabCut, movement and napari read. Read are its tables, SLEAP's, and any other
whose columns are named after a marker and a coordinate; no library of theirs is needed for it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.trials.text_table import TextTable, read_table, write_table
from swim2real.trials.trial import MarkerTrack

Array = NDArray[np.float64]

_COORDS = ("x", "y", "likelihood")
_SURE = re.compile("likelihood|score|confidence|conf|p|prob|probability", re.IGNORECASE)
_COLUMN = re.compile(rf"(.+)[._: ](x|y|{_SURE.pattern})", re.IGNORECASE)
_FRAME = re.compile(r"frame.*|coords|bodyparts|", re.IGNORECASE)
_ROUNDING = 1e-6  # by which a likelihood may lie outside 0 and 1 without a word


@dataclass(frozen=True)
class _Poses:
    """A pose table as it is read.

    Attributes:
        times: Times of the rows after the film's first frame [s]. Shape (T,).
        animals: Places of the columns x, y and likelihood of each marker, -1 where there is none, by animal and name.
        table: The cells.
    """

    times: Array
    animals: Mapping[str, Mapping[str, list[int]]]
    table: TextTable

    def track(self, markers: Mapping[str, list[int]]) -> tuple[MarkerTrack, list[str]]:
        """The track of some markers, and what was understood without being said.

        Where a marker has a position, a likelihood that isn't there is one of 1: unknown isn't lost.
        """
        columns = list(markers.values())
        positions = np.array([[self.table.numbers(place) for place in places[:2]] for places in columns])
        unsaid = np.full(len(self.times), np.nan)
        likelihood = np.array([self.table.numbers(at) if at >= 0 else unsaid for *_, at in columns])
        notes: list[str] = []
        outside = likelihood[(likelihood < -_ROUNDING) | (likelihood > 1 + _ROUNDING)]
        if outside.size:
            notes.append(
                f"{outside.size} likelihoods lie outside 0 and 1, from {outside.min():.3g} to {outside.max():.3g}: "
                f"above 1 counts as sure, below 0 as lost"
            )
        unknown = np.isnan(likelihood) & np.isfinite(positions).all(axis=1)
        if unknown.any():
            notes.append(f"{unknown.sum()} positions have no likelihood, and count as seen")
        sure = np.where(unknown, 1.0, np.clip(likelihood, 0, 1))
        return MarkerTrack(self.times, positions.transpose(2, 0, 1), np.nan_to_num(sure).T), notes


def write_dlc(track: MarkerTrack, names: Sequence[str], path: str | Path, scorer: str = "swim2real") -> None:
    """Writes a track as a DeepLabCut table; time stamps become the number of the frame, NaN an empty cell.

    Args:
        track: Track in pixels. Confidences become likelihoods.
        names: Names of its M markers.
        path: Path of the table, which is written whole or not at all.
        scorer: Name of the tracker, for the first header row.

    Raises:
        TrialError: The names aren't the track's, or the file can't be written.
    """
    if len(names) != track.marker_count or len(set(names)) != len(names):
        raise TrialError(
            f"{len(names)} names ({', '.join(names)}) for {track.marker_count} markers; each needs its own"
        )
    cells = np.concatenate([track.positions, track.confidence[:, :, None]], axis=2).reshape(track.frame_count, -1)
    heads = [
        ["scorer", *[scorer] * cells.shape[1]],
        ["bodyparts", *(name for name in names for _ in _COORDS)],
        ["coords", *_COORDS * len(names)],
    ]
    try:
        write_table(Path(path), heads, ([frame, *row] for frame, row in enumerate(cells.tolist())))
    except OSError as error:
        raise TrialError(f"can't write '{path}': {error.strerror or error}") from error


def read_dlc(path: str | Path, fps: float) -> tuple[MarkerTrack, tuple[str, ...]]:
    """Reads a pose table of one animal.

    Args:
        path: Path of the table.
        fps: Frames a second of its video.

    Returns:
        The track in pixels, its time 0 at the video's first frame, and the names of its markers.

    Raises:
        TrialError: The file isn't there or isn't such a table; the message names the line.
    """
    poses = _read(Path(path), fps)
    markers = _alone(poses, path)
    return poses.track(markers)[0], tuple(markers)


def read_poses(path: Path, fps: float, names: Sequence[str]) -> tuple[MarkerTrack, list[str]]:
    """Reads the markers of one robot from a pose table.

    Args:
        path: Path of the table.
        fps: Frames a second of its video.
        names: Names of the markers. The animal that has them all is taken, else one that has as many, in its order.

    Returns:
        The track in pixels with the markers in their order, its time 0 at the video's first frame, and notes.

    Raises:
        TrialError: The file isn't there or isn't such a table, or has other markers.
    """
    poses = _read(path, fps)
    whole = {name: places for markers in poses.animals.values() for name, places in markers.items()}
    named = [markers for markers in poses.animals.values() if set(names) <= set(markers)]
    alike = [markers for markers in poses.animals.values() if len(markers) == len(names)]
    if not named and sum(map(len, poses.animals.values())) == len(whole) and set(names) <= set(whole):
        named = [whole]
    notes: list[str] = []
    if len(named) == 1:
        chosen = {name: named[0][name] for name in names}
        if others := [name for name in whole if name not in chosen]:
            notes.append(f"what else the table has isn't taken: {', '.join(others)}")
    elif not named and len(alike) == 1:
        chosen = alike[0]
        pairs = ", ".join(f"{ours} is {theirs}" for ours, theirs in zip(names, chosen, strict=True))
        notes.append(f"markers are taken in the table's order: {pairs}")
    else:
        found = _alone(poses, path)
        raise TrialError(
            f"{path}: {len(found)} markers ({', '.join(found)}); {len(names)} are wanted ({', '.join(names)})"
        )
    track, more = poses.track(chosen)
    return track, notes + more


def _alone(poses: _Poses, path: str | Path) -> Mapping[str, list[int]]:
    """The markers of the only animal."""
    if len(poses.animals) > 1:
        raise TrialError(
            f"{path}: {len(poses.animals)} animals ({', '.join(poses.animals)}); one swimmer is needed, so export it "
            f"by itself"
        )
    return next(iter(poses.animals.values()))


def _read(path: Path, fps: float) -> _Poses:
    """The columns and times of a pose table."""
    if not (np.isfinite(fps) and fps > 0):
        raise TrialError(f"{path}: fps is {fps}; it must be finite and above 0")
    table = read_table(path)
    rows = {head[0]: head[1:] for head in table.heads}
    if "bodyparts" in rows and "coords" in rows:
        animals = rows.get("individuals", ("",) * len(rows["coords"]))
        columns = list(zip(animals, rows["bodyparts"], rows["coords"], strict=True))
    else:
        matches = [_COLUMN.fullmatch(name) for name in table.names[1:]]
        columns = [("", match[1], match[2]) if match else ("", "", "") for match in matches]
    found: dict[str, dict[str, list[int]]] = {}
    for place, (animal, part, coordinate) in enumerate(columns, start=1):
        axis = "xy".find(coordinate.lower())  # -1, the last one, for anything else
        if part and (axis >= 0 or _SURE.fullmatch(coordinate)):
            places = found.setdefault(animal, {}).setdefault(part, [-1, -1, -1])
            if places[axis] >= 0:
                raise TrialError(f"{path}: column '{coordinate}' of marker '{part}' comes twice; leave one out")
            places[axis] = place
    markers = {animal: {part: at for part, at in parts.items() if min(at[:2]) >= 0} for animal, parts in found.items()}
    markers = {animal: parts for animal, parts in markers.items() if parts}
    if not markers:
        raise TrialError(
            f"{path}: no pose table; it needs DeepLabCut's header rows scorer, bodyparts, coords, or columns NAME.x "
            f"and NAME.y as SLEAP writes them, and then a row per frame"
        )
    if table.left_out:
        raise TrialError(f"{path}: {table.left_out}; expected a row per frame")
    if len(table.lines) < 2:
        raise TrialError(f"{path}: {len(table.lines)} frames; a track needs at least 2")
    return _Poses(_frames(table) / fps, markers, table)


def _frames(table: TextTable) -> Array:
    """Numbers of the frames, counted from the film's first, 0. Shape (T,)."""
    place = next((i for i, name in enumerate(table.names) if _FRAME.fullmatch(name)), 0)
    try:
        frames = table.numbers(place)
    except TrialError as error:
        raise TrialError(
            f"{error}, as the number of a frame must be; tables of single labeled pictures are no track, analyze the "
            f"video instead"
        ) from None
    for row in np.flatnonzero(~(frames >= 0) | (frames % 1 != 0))[:1]:
        raise TrialError(f"{table.place(row, place)}: {frames[row]:g} is no frame number; it must be whole, 0 or above")
    for row in np.flatnonzero(np.diff(frames) <= 0)[:1]:
        raise TrialError(
            f"{table.place(row + 1)}: frame {frames[row + 1]:g} comes after frame {frames[row]:g}; they must rise: of "
            f"several animals or tracks, export one by itself"
        )
    return frames
