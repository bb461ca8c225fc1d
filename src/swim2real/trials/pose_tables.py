"""Pose tables: x, y and likelihood per marker, a row per frame. Pixels, y down.

Written as DeepLabCut does it, which DeepLabCut, movement and napari read. Read are its tables, SLEAP's, and any other
whose columns are named after a marker and a coordinate; no library of theirs is needed for it. The files of SLEAP and
movement, which are no text, are read and written as well.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.trials import pose_files
from swim2real.trials.text_table import TextTable, read_table, write_table
from swimbase.arrays import Array
from swimbase.errors import TrialError

Markers = dict[str, Array]
"""Cells x, y and likelihood of each marker, infinite where there is no such column. Shape (T, 3)."""

_COORDS = ("x", "y", "likelihood")
_SURE = re.compile("likelihood|score|confidence|conf|p|prob|probability", re.IGNORECASE)
_COLUMN = re.compile(rf"(.+)[._: ](x|y|{_SURE.pattern})", re.IGNORECASE)
_FRAME = re.compile(r"frame.*|coords|bodyparts|", re.IGNORECASE)
_FILES = (*pose_files.SLEAP, *pose_files.MOVEMENT)
_ROUNDING = 1e-6  # by which a likelihood may lie outside 0 and 1 without a word


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
        count = f"{len(names)} names ({', '.join(names)}) for {track.marker_count} markers"
        raise TrialError(f"{count}; each needs its own")
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


def write_poses(track: MarkerTrack, names: Sequence[str], path: Path, fps: float) -> None:
    """Writes a track as its ending says: .csv of DeepLabCut, .h5 of SLEAP, or .nc of movement.

    Args:
        track: Track in pixels, its time 0 at the film's first frame.
        names: Names of its M markers.
        path: Path of the file, which is written whole or not at all.
        fps: Frames per second of the film.

    Raises:
        TrialError: The names aren't the track's, or the file can't be written.
        MissingExtraError: The library that writes it isn't installed.
    """
    if path.suffix.lower() not in _FILES:
        write_dlc(track, names, path)
    else:
        frames = np.rint(track.times * fps).astype(int)
        pose_files.write_file(path, frames.tolist(), track.positions, track.confidence, names, fps)


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
    times, animals = _read(Path(path), fps)
    markers = _alone(animals, path)
    return _track(times, markers)[0], tuple(markers)


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
    times, animals = _read(path, fps)
    whole = {name: cells for markers in animals.values() for name, cells in markers.items()}
    named = [markers for markers in animals.values() if set(names) <= set(markers)]
    alike = [markers for markers in animals.values() if len(markers) == len(names)]
    if not named and sum(map(len, animals.values())) == len(whole) and set(names) <= set(whole):
        named = [whole]
    if len(named) == 1:
        chosen, others = {name: named[0][name] for name in names}, [name for name in whole if name not in names]
        notes = [f"what else the table has isn't taken: {', '.join(others)}"] * bool(others)
    elif not named and len(alike) == 1:
        chosen = alike[0]
        pairs = ", ".join(f"{ours} is {theirs}" for ours, theirs in zip(names, chosen, strict=True))
        notes = [f"markers are taken in the table's order: {pairs}"]
    else:
        found, wanted = _alone(animals, path), f"{len(names)} are wanted ({', '.join(names)})"
        raise TrialError(f"{path}: {len(found)} markers ({', '.join(found)}); {wanted}")
    track, more = _track(times, chosen)
    return track, notes + more


def _track(times: Array, markers: Markers) -> tuple[MarkerTrack, list[str]]:
    """The track of some markers, and what was understood without being said.

    Where a marker has a position, a likelihood that isn't there is one of 1: unknown isn't lost.
    """
    positions, likelihood = np.split(np.stack(list(markers.values()), axis=1), [2], axis=2)
    likelihood = np.where(np.isinf(likelihood), np.nan, likelihood)[..., 0]
    notes: list[str] = []
    outside = likelihood[(likelihood < -_ROUNDING) | (likelihood > 1 + _ROUNDING)]
    if outside.size:
        notes.append(
            f"{outside.size} likelihoods lie outside 0 and 1, from {outside.min():.3g} to {outside.max():.3g}: "
            f"above 1 counts as sure, below 0 as lost"
        )
    unknown = np.isnan(likelihood) & np.isfinite(positions).all(axis=2)
    if unknown.any():
        notes.append(f"{unknown.sum()} positions have no likelihood, and count as seen")
    return MarkerTrack(times, positions, np.nan_to_num(np.where(unknown, 1.0, np.clip(likelihood, 0, 1)))), notes


def _alone(animals: Mapping[str, Markers], path: str | Path) -> Markers:
    """The markers of the only animal."""
    if len(animals) > 1:
        found = f"{len(animals)} animals ({', '.join(animals)})"
        raise TrialError(f"{path}: {found}; one swimmer is needed, so export it by itself")
    return next(iter(animals.values()))


def _read(path: Path, fps: float) -> tuple[Array, Mapping[str, Markers]]:
    """Times of the rows after the film's first frame [s], of shape (T,), and the markers of each animal."""
    if not (np.isfinite(fps) and fps > 0):
        raise TrialError(f"{path}: fps is {fps}; it must be finite and above 0")
    if path.suffix.lower() in _FILES:
        frames, seen = pose_files.read_file(path)
        if len(frames) < 2:
            raise TrialError(f"{path}: {len(frames)} frames; a track needs at least 2")
        return frames / fps, seen
    table = read_table(path)
    rows = {head[0]: head[1:] for head in table.heads}
    if "bodyparts" in rows and "coords" in rows:
        animals = rows.get("individuals", ("",) * len(rows["coords"]))
        columns = list(zip(animals, rows["bodyparts"], rows["coords"], strict=True))
    else:
        matches = [_COLUMN.fullmatch(name) for name in table.names[1:]]
        columns = [("", match[1], match[2]) if match else ("", "", "") for match in matches]
    found: dict[str, Markers] = {}
    for place, (animal, part, coordinate) in enumerate(columns, start=1):
        axis = "xy".find(coordinate.lower())  # -1, the last one, for anything else
        if part and (axis >= 0 or _SURE.fullmatch(coordinate)):
            cells = found.setdefault(animal, {}).setdefault(part, np.full((len(table.lines), 3), np.inf))
            if not np.isinf(cells[0, axis]):
                raise TrialError(f"{path}: column '{coordinate}' of marker '{part}' comes twice; leave one out")
            cells[:, axis] = table.numbers(place)
    for animal, parts in found.items():  # markers have both coordinates
        found[animal] = {part: cells for part, cells in parts.items() if not np.isinf(cells[0, :2]).any()}
    animals = {animal: markers for animal, markers in found.items() if markers}
    if not animals:
        raise TrialError(
            f"{path}: no pose table; it needs DeepLabCut's header rows scorer, bodyparts, coords, or columns NAME.x "
            f"and NAME.y as SLEAP writes them, and then a row per frame"
        )
    if table.left_out:
        raise TrialError(f"{path}: {table.left_out}; expected a row per frame")
    if len(table.lines) < 2:
        raise TrialError(f"{path}: {len(table.lines)} frames; a track needs at least 2")
    return _frames(table) / fps, animals


def _frames(table: TextTable) -> Array:
    """Numbers of the frames, counted from the film's first, 0. Shape (T,)."""
    place = next((i for i, name in enumerate(table.names) if _FRAME.fullmatch(name)), 0)
    try:
        frames = table.numbers(place)
    except TrialError as error:
        pictures = "tables of single labeled pictures are no track, analyze the video instead"
        raise TrialError(f"{error}, as the number of a frame must be; {pictures}") from None
    for row in np.flatnonzero(~(frames >= 0) | (frames % 1 != 0))[:1]:
        raise TrialError(f"{table.place(row, place)}: {frames[row]:g} is no frame number; it must be whole, 0 or above")
    for row in np.flatnonzero(np.diff(frames) <= 0)[:1]:
        remedy = "they must rise: of several animals or tracks, export one by itself"
        raise TrialError(
            f"{table.place(row + 1)}: frame {frames[row + 1]:g} comes after frame {frames[row]:g}; {remedy}"
        )
    return frames
