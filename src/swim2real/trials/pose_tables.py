"""Pose tables as DeepLabCut writes them: three header rows, then x, y and likelihood per marker, a row per frame.

Pixels, y down. Read by DeepLabCut, movement and napari; no library of theirs is needed for it.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from swim2real.errors import TrialError
from swim2real.store import MOST_ROWS, MOST_TABLE, read_text, whole_file
from swim2real.trials.trial import MarkerTrack

_COORDS = ("x", "y", "likelihood")
_FAR = 1e9  # px
_DIGITS = 12  # of the number of a frame
_ROUNDING = 1e-6  # by which a likelihood may lie outside 0 and 1


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
    place = Path(path)
    try:
        with whole_file(place) as part, part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["scorer", *[scorer] * cells.shape[1]])
            writer.writerow(["bodyparts", *(name for name in names for _ in _COORDS)])
            writer.writerow(["coords", *_COORDS * len(names)])
            for frame, row in enumerate(cells.tolist()):
                writer.writerow([frame, *("" if value != value else repr(value) for value in row)])
    except OSError as error:
        raise TrialError(f"can't write '{place}': {error.strerror or error}") from error


def read_dlc(path: str | Path, fps: float) -> tuple[MarkerTrack, tuple[str, ...]]:
    """Reads a DeepLabCut table of one animal.

    Args:
        path: Path of the table.
        fps: Frames a second of its video.

    Returns:
        The track in pixels, its time 0 at the first frame of the table, and the names of its markers.

    Raises:
        TrialError: The file isn't there or isn't such a table; the message names the line.
    """
    table = Path(path)
    if not (np.isfinite(fps) and fps > 0):
        raise TrialError(f"{table}: fps is {fps}; it must be finite and above 0")
    try:
        text = read_text(table, MOST_TABLE, "utf-8-sig")
        if text.count("\n") > MOST_ROWS:
            raise TrialError(f"{table}: more than {MOST_ROWS} rows; cut it into shorter trials")
        reader = csv.reader(io.StringIO(text, newline=""))
        lines = [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except (OSError, ValueError, csv.Error) as error:
        raise TrialError(f"{table}: not readable as a table ({error})") from error
    names, lines = _header(table, lines)
    width = 1 + len(_COORDS) * len(names)
    frames: list[int] = []
    rows: list[list[float]] = []
    for line, cells in lines:
        if len(cells) != width:
            raise TrialError(f"{table}, line {line}: {len(cells)} columns; the header has {width}")
        frame = cells[0].strip()
        if not (frame.isdecimal() and len(frame) <= _DIGITS):
            raise TrialError(
                f"{table}, line {line}, column 1: '{frame}' is no frame number; tables of single labeled pictures "
                f"are no track, analyze the video instead"
            )
        if frames and int(frame) <= frames[-1]:
            raise TrialError(f"{table}, line {line}: frame {frame} comes after frame {frames[-1]}; they must rise")
        frames.append(int(frame))
        rows.append([_number(table, line, column, cell) for column, cell in enumerate(cells[1:], start=2)])
    if len(rows) < 2:
        raise TrialError(f"{table}: {len(rows)} frames; a track needs at least 2")
    values = np.array(rows).reshape(len(rows), len(names), 3)
    return MarkerTrack((np.array(frames) - frames[0]) / fps, values[:, :, :2], np.nan_to_num(values[:, :, 2])), names


def _header(table: Path, lines: list[tuple[int, list[str]]]) -> tuple[tuple[str, ...], list[tuple[int, list[str]]]]:
    """Names of the markers, and the lines below the header."""
    rows = {cells[0].strip(): (line, [cell.strip() for cell in cells[1:]]) for line, cells in reversed(lines[:4])}
    wanted = ["scorer", "bodyparts", "coords"]
    if "individuals" in rows:
        wanted.insert(1, "individuals")
        animals = list(dict.fromkeys(rows["individuals"][1]))
        if len(animals) > 1:
            raise TrialError(
                f"{table}, line {rows['individuals'][0]}: {len(animals)} animals ({', '.join(animals)}); "
                f"one swimmer is needed, so export it by itself"
            )
    for (line, cells), key in zip(lines, wanted, strict=False):
        if cells[0].strip() != key:
            raise TrialError(
                f"{table}, line {line}: begins with '{cells[0].strip()}'; a DeepLabCut table begins with rows "
                f"{', '.join(wanted)}"
            )
    if len(lines) < len(wanted):
        raise TrialError(f"{table}: no DeepLabCut table; it needs rows {', '.join(wanted)} and then one per frame")
    (_, parts), (line, coords) = rows["bodyparts"], rows["coords"]
    if not parts or len(parts) != len(coords) or coords != list(_COORDS) * (len(coords) // 3):
        raise TrialError(f"{table}, line {line}: coords must be {', '.join(_COORDS)} for each marker above them")
    names = tuple(parts[::3])
    if parts != [name for name in names for _ in _COORDS]:
        raise TrialError(f"{table}, line {rows['bodyparts'][0]}: each marker's name must stand above its three columns")
    if len(set(names)) < len(names):
        raise TrialError(f"{table}, line {rows['bodyparts'][0]}: a marker's name comes twice in {', '.join(names)}")
    return names, lines[len(wanted) :]


def _number(table: Path, line: int, column: int, cell: str) -> float:
    try:
        value = float(cell) if cell.strip() else float("nan")
    except ValueError:
        raise TrialError(f"{table}, line {line}, column {column}: '{cell}' is not a number") from None
    if (column - 1) % 3 == 0:
        if not (-_ROUNDING <= value <= 1 + _ROUNDING or np.isnan(value)):
            raise TrialError(f"{table}, line {line}, column {column}: likelihood {cell} must lie within 0 and 1")
        return value if np.isnan(value) else min(max(value, 0.0), 1.0)
    if np.isfinite(value) and abs(value) > _FAR:
        raise TrialError(
            f"{table}, line {line}, column {column}: {value:g} px is beyond ±{_FAR:g}; no picture is as large"
        )
    return value if np.isfinite(value) else float("nan")
