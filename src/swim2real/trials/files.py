"""Reference folders and the published tracks, read and written.

A reference folder holds `reference.json` and a table a trial (`time_s`, then `M0_x_m, M0_y_m, M0_confidence, …`), and
where they were recorded tables of controls and sensors (`time_s`, then a column each).
A folder of the prior work's raw CSVs (pixels, two columns a marker, 60 fps, no header) is read as well.
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.trials.recorded import RECORDED, SIGNALS, recorded_entry, recorded_tables, with_recorded
from swim2real.trials.tables import TIME, read_lines, read_numbers
from swim2real.trials.trial import MarkerTrack, Trial, TrialSet

FORMAT = 1
INDEX, LOCK = "reference.json", ".lock"
_LOCK_TIMEOUT = 60  # s, longer than anybody writes a trial
PUBLISHED_FPS = 60.0
PUBLISHED_MARKERS = 9
PUBLISHED_HEAD_LENGTH = 0.142  # m, distance of the first two markers on the robot
_PUBLISHED_NAME = re.compile(r"(?:markers_)?(f(\d+)_(\d+))$")


def load_reference(folder: str | Path) -> TrialSet:
    """Trials of a reference folder, or of a folder of raw published CSVs, sorted by name.

    Raises:
        TrialError: The folder or a file in it is missing, or can't be read; the message names file and line.
    """
    path = Path(folder)
    if not path.is_dir():
        kind = "a file, not a folder" if path.exists() else "not there"
        raise TrialError(f"reference '{path}' is {kind}; give a folder with {INDEX} or with published CSVs")
    if (path / INDEX).is_file():
        return _load_folder(path)
    tables = sorted(path.glob("*.csv"))
    if not tables:
        raise TrialError(
            f"reference '{path}' holds neither {INDEX} nor any .csv; `swim2real fetch --to {path}` gets one"
        )
    return TrialSet(tuple(read_published(table) for table in tables))


def read_published(path: str | Path, fps: float = PUBLISHED_FPS) -> Trial:
    """One raw published CSV: pixels with y down, x and y of nine markers a row, to meters with y up.

    The scale is the median distance of the first two markers, which are 0.142 m apart on the robot.
    """
    table = Path(path)
    if not (np.isfinite(fps) and fps > 0):
        raise TrialError(f"{table.name}: fps is {fps}; it must be finite and above 0")
    rows = read_numbers(table, read_lines(table), first_line=1)
    width = 2 * PUBLISHED_MARKERS
    _check_table(table, rows, width, f"{width} numbers a row (x and y of {PUBLISHED_MARKERS} markers)")
    pixels = rows.reshape(len(rows), PUBLISHED_MARKERS, 2)
    lengths = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1)
    seen = lengths[np.isfinite(lengths)]
    head_px = float(np.median(seen)) if seen.size else 0.0
    if not head_px > 0:
        raise TrialError(f"{table.name}: the first two markers coincide or are never seen, so there is no scale")
    scale = PUBLISHED_HEAD_LENGTH / head_px
    times = np.arange(len(rows)) / fps
    found = _PUBLISHED_NAME.match(table.stem)
    trial = Trial(
        name=found.group(1) if found else table.stem,
        track=MarkerTrack(times, pixels * scale * [1.0, -1.0]),
        nominal_frequency=nominal_frequency(table.stem),
        meters_per_pixel=scale,
        provenance=f"published marker track {table.name}, {fps:g} fps, markers placed by hand",
    )
    return _check_motion(trial, table)


def nominal_frequency(name: str) -> float | None:
    """The frequency in a trial's name [Hz], such as 1.5 in `f1_50`; None for other names."""
    found = _PUBLISHED_NAME.match(name)
    return (float(f"{found.group(2)}.{found.group(3)}") or None) if found else None  # in f0_00 the motor stands still


def save_reference(trials: TrialSet, folder: str | Path) -> None:
    """Writes a reference folder; NaN positions become empty cells.

    Raises:
        TrialError: The folder can't be written, or a trial's name can't be a file's.
    """
    path = Path(folder)
    for name in trials.names:
        _check_name(name)
    entries = [_entry(trial, path) for trial in trials]
    for entry in entries:
        _check_files(entry, entries, path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        for trial in trials:
            _write_tables(path, trial, trials.marker_names)
        _write_index(path, list(trials.marker_names), entries)
    except OSError as error:
        raise TrialError(f"can't write reference folder '{path}': {error.strerror or error}") from error


def check_folder(folder: str | Path, name: str, marker_names: tuple[str, ...]) -> None:
    """Whether a trial of this name and with these markers can be added to a folder.

    Raises:
        TrialError: The folder holds something else, or trials with other markers.
    """
    if Path(folder).is_dir():
        _entries(Path(folder), marker_names, f"{name}.csv")


def add_trial(folder: str | Path, trial: Trial, marker_names: tuple[str, ...]) -> None:
    """Adds a trial to a reference folder, in place of one of the same name; makes the folder if it isn't there.

    What was recorded beside the replaced trial's track stays, if the new one brings nothing like it: a video that is
    tracked again keeps its controls, sensors and start.

    Files are replaced at once and the index last, so that a reader never sees half of one, and processes that add
    trials at the same time wait for one another.

    Args:
        folder: A reference folder, an empty one, or one to make.
        trial: In meters.
        marker_names: Of its M markers; the same as of the trials that are there.

    Raises:
        TrialError: The folder holds something else or other markers, the trial couldn't be read back, or the folder
            can't be written.
    """
    path = Path(folder)
    _check_name(trial.name)
    TrialSet((trial,), marker_names)
    table = f"{trial.name}.csv"
    _check_motion(trial, path / table)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with FileLock(path / LOCK, timeout=_LOCK_TIMEOUT):
            entries = _entries(path, marker_names, table)
            old = next((entry for entry in entries if entry["name"] == trial.name), {})
            new = {**{key: old[key] for key in RECORDED if key in old}, **_entry(trial, path)}
            entries = [*(entry for entry in entries if entry is not old), new]
            _check_files(new, entries, path)
            entries.sort(key=lambda entry: str(entry["name"]))  # whoever was added first
            _write_tables(path, trial, marker_names)
            _write_index(path, list(marker_names), entries)
    except Timeout:
        raise TrialError(f"another process has been writing to '{path}' for {_LOCK_TIMEOUT} s; try again") from None
    except OSError as error:
        raise TrialError(f"can't write reference folder '{path}': {error.strerror or error}") from error


def _entries(path: Path, marker_names: tuple[str, ...], table: str) -> list[dict[str, Any]]:
    """Entries of the trials that a folder's index lists; none in a new folder."""
    if not (path / INDEX).is_file():
        others = sorted(other.name for other in path.glob("*.csv") if other.name != table)
        if others:
            raise TrialError(f"'{path}' holds {others[0]} but no {INDEX}, so it is no reference folder; choose another")
        return []
    there = _load_folder(path)
    if there.marker_names != marker_names:
        raise TrialError(
            f"reference '{path}' has the markers {', '.join(there.marker_names)}; the new trial has "
            f"{', '.join(marker_names)}; choose another folder"
        )
    return json.loads((path / INDEX).read_text(encoding="utf-8"))["trials"]


def _check_name(name: str) -> None:
    if Path(f"{name}.csv").name != f"{name}.csv":
        raise TrialError(f"trial name {name!r} can't be the name of a file; give it another")


def _check_files(entry: dict[str, Any], entries: list[dict[str, Any]], path: Path) -> None:
    """Whether no other trial has a table of the same name."""
    for other in entries:
        shared = sorted(_tables(entry) & _tables(other))
        if other["name"] != entry["name"] and shared:
            raise TrialError(f"table '{shared[0]}' in '{path}' is trial '{other['name']}'; choose another name")


def _tables(entry: dict[str, Any]) -> set[str]:
    return {entry.get("table", f"{entry['name']}.csv"), *(entry[kind] for kind in SIGNALS if kind in entry)}


def _entry(trial: Trial, folder: Path) -> dict[str, Any]:
    video = {} if trial.video is None else {"video": _from(folder, trial.video)}
    return {
        "name": trial.name,
        "table": f"{trial.name}.csv",
        "nominal_frequency_hz": trial.nominal_frequency,
        "fps": round(trial.fps, 6),
        "meters_per_pixel": trial.meters_per_pixel,
        "provenance": trial.provenance,
        **video,
        **recorded_entry(trial),
    }


def _from(folder: Path, video: Path) -> str:
    """The way from the folder, so that both can be moved together; the whole path where there is none."""
    try:
        return Path(os.path.relpath(video.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return video.resolve().as_posix()


def _write_index(path: Path, markers: list[str], entries: list[dict[str, Any]]) -> None:
    part = path / f"{INDEX}.part"
    part.write_text(
        json.dumps({"format": FORMAT, "markers": markers, "trials": entries}, indent=2) + "\n", encoding="utf-8"
    )
    part.replace(path / INDEX)


def _load_folder(path: Path) -> TrialSet:
    where = path / INDEX
    try:
        index = json.loads(where.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TrialError(f"{where}: not readable as JSON ({error})") from error
    if not isinstance(index, dict) or index.get("format") != FORMAT:
        found = index.get("format") if isinstance(index, dict) else type(index).__name__
        raise TrialError(f"{where}: format is {found!r}; this version reads format {FORMAT}")
    entries = index.get("trials")
    if not isinstance(entries, list) or not entries:
        raise TrialError(f"{where}: 'trials' must be a list with at least one trial")
    names = index.get("markers")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrialError(f"{where}: 'markers' must be a list of marker names")
    return TrialSet(tuple(_load_trial(path, entry, names) for entry in entries), tuple(names))


def _load_trial(folder: Path, entry: Any, markers: list[str]) -> Trial:
    where = folder / INDEX
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise TrialError(f"{where}: every trial needs a 'name'")
    name = entry["name"]
    for key in ("nominal_frequency_hz", "fps", "meters_per_pixel"):
        value = entry.get(key)
        if value is not None and not (isinstance(value, int | float) and np.isfinite(value) and value > 0):
            raise TrialError(f"{where}: {key} of trial '{name}' is {value!r}; it must be a number above 0")
    file_name = entry.get("table", f"{name}.csv")
    table = folder / str(file_name)
    if not table.is_file() or table.parent != folder:
        raise TrialError(f"{where}: table '{file_name}' of trial '{name}' is not in {folder}")
    lines = read_lines(table)
    columns = _columns(markers)
    header = next(csv.reader(lines[:1]), [])
    if header != columns:
        raise TrialError(f"{table}, line 1: the header must be {','.join(columns[:4])},… ({len(columns)} columns)")
    rows = read_numbers(table, lines[1:], first_line=2)
    _check_table(table, rows, len(columns), f"{len(columns)} columns, as the header")
    cells = rows[:, 1:].reshape(len(rows), len(markers), 3)
    try:
        track = MarkerTrack(rows[:, 0], cells[:, :, :2], np.nan_to_num(cells[:, :, 2]))
    except TrialError as error:
        raise TrialError(f"{table}: {error}") from error
    video = entry.get("video")
    if not isinstance(video, str | None):
        raise TrialError(f"{where}: video of trial '{name}' is {video!r}; it must be a path")
    trial = Trial(
        name, track, entry.get("nominal_frequency_hz"), entry.get("meters_per_pixel"), str(entry.get("provenance", "")),
        video=None if video is None else folder / video,
    )  # fmt: skip
    trial = with_recorded(trial, entry, folder, where)
    return _check_motion(trial, table)


def _columns(markers: tuple[str, ...] | list[str]) -> list[str]:
    return [TIME, *(f"{m}_{part}" for m in markers for part in ("x_m", "y_m", "confidence"))]


def _write_tables(folder: Path, trial: Trial, markers: tuple[str, ...]) -> None:
    """The trial's tables, each whole or not at all."""
    written: dict[str, Callable[[Path], None]] = {
        f"{trial.name}.csv": lambda path: _write_track(path, trial.track, markers), **recorded_tables(trial)
    }  # fmt: skip
    for name, write in written.items():
        write(folder / f"{name}.part")
        (folder / f"{name}.part").replace(folder / name)


def _write_track(path: Path, track: MarkerTrack, markers: tuple[str, ...]) -> None:
    cells = np.concatenate([track.positions, track.confidence[:, :, None]], axis=2).reshape(track.frame_count, -1)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_columns(markers))
        for time, row in zip(track.times, cells, strict=True):
            writer.writerow([f"{time:.6f}", *("" if np.isnan(value) else f"{value:.6f}" for value in row)])


def _check_table(table: Path, rows: NDArray[np.float64], width: int, wanted: str) -> None:
    if len(rows) == 0:
        raise TrialError(f"{table}: the table is empty; expected {wanted}")
    if rows.shape[1] != width:
        raise TrialError(f"{table}: {rows.shape[1]} columns; expected {wanted}")
    if len(rows) < 2:
        raise TrialError(f"{table}: one frame only; a trial needs at least 2")


def _check_motion(trial: Trial, table: Path) -> Trial:
    positions = trial.track.positions
    highest = np.where(np.isnan(positions), -np.inf, positions).max(axis=0)
    lowest = np.where(np.isnan(positions), np.inf, positions).min(axis=0)
    if not np.any(highest > lowest):
        raise TrialError(f"{table}: no marker moves; is this the right file?")
    return trial
