"""Reference folders and the published tracks, read and written.

A reference folder holds `reference.json` and a table a trial (`time_s`, then `M0_x_m, M0_y_m, M0_confidence, …`), and
where they were recorded tables of controls and sensors (`time_s`, then a column each). Where nothing was filmed there
are no tracks: `NAME.sensors.csv`, with `NAME.controls.csv` where something was commanded, is a trial, and
`reference.json` may be left out.
A folder of the prior work's raw CSVs (pixels, two columns per marker, 60 fps, no header) is read as well.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, Field, model_validator

from markertrack.track import MarkerTrack
from swim2real.trials.published import read_published
from swim2real.trials.signals import TIME, read_signals, write_signals
from swim2real.trials.text_table import read_table, write_table
from swim2real.trials.timebase import Timebase
from swim2real.trials.trial import Perspective, Trial, TrialSet, check_motion, check_trial_name
from swimbase.checking import FileName, Label, Number, PathText, Positive, read
from swimbase.errors import TrialError, about
from swimbase.names import composed, file_key
from swimbase.store import locked, path_from, write_json, writing

INDEX = "reference.json"
_SENSORS, _CONTROLS = ".sensors.csv", ".controls.csv"  # after the name of a trial that wasn't filmed
_LOCK_TIMEOUT = 60  # s, longer than anybody writes a trial
FILMS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".ts", ".mts", ".mpg", ".mpeg", ".webm", ".wmv")
_MOST_FILMS = 3  # that a sentence names
_NEARLY = 0.8  # how alike names are that mean the same
_SAME_FPS = 0.01  # relative difference of a rate that was rounded
_SAID, _KEPT = ("meters_per_pixel", "provenance"), ("start", "start_velocities", "perspective", "timebases", "midline")
_RECORDED = ("controls", "sensors", "start", "start_velocities")  # kept when the video is tracked again


class _Open(BaseModel, extra="allow"):
    """May have other keys, but none that is nearly a known one, which is a mistake in its name."""

    @model_validator(mode="after")
    def _known(self) -> _Open:
        for key in self.model_extra or {}:
            if near := get_close_matches(key, type(self).model_fields, 1, _NEARLY):
                raise ValueError(f"there is no '{key}'; did you mean '{near[0]}'?")
        return self


class _TrialEntry(_Open):
    """Entry of a trial in the index of a reference folder. Other keys are kept as they are.

    Attributes:
        name: Name of the trial.
        table: File with its track, in the same folder; by default `NAME.csv`. A reference without markers has none.
        nominal_frequency_hz: Frequency that the motor was commanded to turn at [Hz].
        fps: Frames a second, for a person who reads the file; the time stamps must have as many.
        meters_per_pixel: Scale of the video [m].
        provenance: Where the trial comes from, in words.
        video: Path of its video, from the folder.
        video_begin_s: Time of that video at which the trial's time is 0 [s].
        controls: File with the commands that drove the robot, in the same folder.
        sensors: File with what sensors measured, in the same folder.
        start: Positions of joints at the first time stamp [m or rad].
        start_velocities: Velocities of joints at the first time stamp [m/s or rad/s].
        perspective: What the camera did to the track and nobody has corrected.
        timebases: Clocks of the trial's streams, by `track`, `controls` and `sensors`, as far as they are known.
        midline: True where markers are places along the midline of a swimmer without markers.
    """

    name: FileName
    table: PathText | None = None
    nominal_frequency_hz: Positive | None = None
    fps: Positive | None = None
    meters_per_pixel: Positive | None = None
    provenance: str = ""
    video: PathText | None = None
    video_begin_s: Number = 0.0
    controls: PathText | None = None
    sensors: PathText | None = None
    start: dict[str, Number] = Field(default_factory=dict)
    start_velocities: dict[str, Number] = Field(default_factory=dict)
    perspective: Perspective | None = None
    timebases: dict[str, Timebase] = Field(default_factory=dict)
    midline: bool = False

    def files(self, *, filmed: bool = True) -> dict[str, str]:
        """Names of the trial's files in the folder, by `table`, `controls` and `sensors`, as far as it has them."""
        table = (self.table or f"{self.name}.csv") if filmed else None
        sensors = self.sensors or (None if filmed else f"{self.name}{_SENSORS}")
        found = {"table": table, "controls": self.controls, "sensors": sensors}
        return {kind: name for kind, name in found.items() if name}


class Index(_Open):
    """The content of `reference.json`.

    Attributes:
        format: Version of the format.
        markers: Names of the M markers.
        trials: The trials.
    """

    format: Literal[1]
    markers: list[Label]
    trials: list[_TrialEntry] = Field(min_length=1)


def load_reference(folder: str | Path) -> TrialSet:
    """Reads the trials of a reference folder, or of a folder of raw published CSVs, sorted by name.

    Args:
        folder: Path of the folder.

    Raises:
        TrialError: The folder or a file in it is missing, or can't be read; the message names file and line.
    """
    path = Path(folder)
    if not path.is_dir():
        if path.suffix.lower() in FILMS and path.is_file():
            raise TrialError(_films(f"'{path}' is a film", [path]))
        kind = "a file, not a folder" if path.exists() else "not there"
        raise TrialError(f"reference '{path}' is {kind}; give a folder with {INDEX} or with published CSVs")
    if (path / INDEX).is_file():
        return _load_folder(path, _read_index(path))
    tables = sorted(path.glob("*.csv"))
    readings = [table for table in tables if table.name.endswith(_SENSORS)]
    if readings and all(table.name.endswith((_SENSORS, _CONTROLS)) for table in tables):
        return TrialSet(tuple(_unfilmed(path, table.name.removesuffix(_SENSORS)) for table in readings))
    if not tables:
        if films := sorted(file for file in path.iterdir() if file.suffix.lower() in FILMS):
            raise TrialError(_films(f"'{path}' has films ('{films[0].name}', …)", films))
        raise TrialError(
            f"reference '{path}' holds neither {INDEX} nor any .csv; `swim2real track` makes one of films, and "
            f"`swim2real fetch --to {shlex.quote(str(path))}` gets the published one"
        )
    return TrialSet(tuple(read_published(table) for table in tables))


def _films(what: str, films: Sequence[Path]) -> str:
    """Commands that make tracks of films."""
    given = shlex.join(str(film) for film in films[:_MOST_FILMS])
    points = " ".join(shlex.quote(f"{film.stem}.points.json") for film in films[:_MOST_FILMS])
    more = " …" if len(films) > _MOST_FILMS else ""
    return (
        f"{what}, not tracks: click the markers with `swim2real pick {given}{more}`, then find them with "
        f"`swim2real track {given}{more} --markers {points}{more} --to REFERENCE`, both with --robot ROBOT.toml for a "
        f"robot of your own, and give REFERENCE here"
    )


def _unfilmed(folder: Path, name: str) -> Trial:
    """A trial of nothing but tables of sensors and, where there is one, of controls."""
    controls = f"{name}{_CONTROLS}" if (folder / f"{name}{_CONTROLS}").is_file() else None
    return _load_trial(folder, _TrialEntry(name=name, controls=controls, sensors=f"{name}{_SENSORS}"), [])


def save_reference(trials: TrialSet, folder: str | Path) -> None:
    """Writes a reference folder; NaN positions become empty cells.

    Raises:
        TrialError: The folder can't be written, or two trials would have the same files.
    """
    path = Path(folder)
    entries = [_entry(trial, path) for trial in trials]
    for entry in entries:
        _check_files(entry, entries, path)
    with writing(path, TrialError, what="reference folder"):
        path.mkdir(parents=True, exist_ok=True)
        for trial in trials:
            _write_tables(path, trial, trials.marker_names)
        _write_index(path, trials.marker_names, entries)


def check_folder(folder: str | Path, name: str, marker_names: tuple[str, ...]) -> None:
    """Checks that a trial of this name and with these markers can be added to a folder.

    Raises:
        TrialError: The name can't be a file's, or the folder holds something else, or trials with other markers.
    """
    check_trial_name(name)
    if Path(folder).is_dir():
        _entries(Path(folder), marker_names, f"{name}.csv")


def add_trial(folder: str | Path, trial: Trial, marker_names: tuple[str, ...]) -> None:
    """Adds a trial to a reference folder, in place of one of the same name; makes the folder if it isn't there.

    What was recorded beside the replaced trial's track stays, if the new one brings nothing like it: a video that is
    tracked again from the same time on keeps its controls, sensors and start.

    Files are replaced at once and the index last, so that a reader never sees half of one, and processes that add
    trials at the same time wait for one another.

    Args:
        folder: A reference folder, an empty one, or one to make.
        trial: The trial, in meters.
        marker_names: Names of its M markers; the same as of the trials that are there.

    Raises:
        TrialError: The folder holds something else or other markers, the trial couldn't be read back, or the folder
            can't be written.
    """
    path = Path(folder)
    TrialSet((trial,), marker_names)
    table = f"{trial.name}.csv"
    check_motion(trial, path / table)
    busy = f"another process has been writing to '{path}' for {_LOCK_TIMEOUT} s; try again"
    with writing(path, TrialError, what="reference folder", busy=busy), locked(path, timeout=_LOCK_TIMEOUT):
        entries = _entries(path, marker_names, table)
        entry = _entry(trial, path)
        old = next((other for other in entries if composed(other.name) == composed(trial.name)), None)
        if old is not None and old.video_begin_s == entry.video_begin_s:
            kept = [key for key in _RECORDED if key in old.model_fields_set - entry.model_fields_set]
            entry = entry.model_copy(update={key: getattr(old, key) for key in kept})
            if clocks := {key: clock for key, clock in old.timebases.items() if key in kept} | entry.timebases:
                entry = entry.model_copy(update={"timebases": clocks})
        entries = [*(other for other in entries if other is not old), entry]
        _check_files(entry, entries, path)
        entries.sort(key=lambda other: other.name)  # whoever was added first
        _write_tables(path, trial, marker_names)
        _write_index(path, marker_names, entries)


def _entries(path: Path, marker_names: tuple[str, ...], table: str) -> list[_TrialEntry]:
    """Entries of the trials that a folder's index lists; none in a new folder."""
    if not (path / INDEX).is_file():
        others = sorted(other.name for other in path.glob("*.csv") if other.name != table)
        if others:
            raise TrialError(f"'{path}' holds {others[0]} but no {INDEX}, so it is no reference folder; choose another")
        return []
    index = _read_index(path)
    there = _load_folder(path, index)
    if there.marker_names != marker_names:
        raise TrialError(
            f"reference '{path}' has the markers {', '.join(there.marker_names)}; the new trial has "
            f"{', '.join(marker_names)}; choose another folder"
        )
    return index.trials


def _check_files(entry: _TrialEntry, entries: list[_TrialEntry], path: Path) -> None:
    """Checks that no other trial has a table of the same name."""
    ours = {file_key(table) for table in entry.files().values()}
    for other in entries:
        shared = sorted(table for table in other.files().values() if file_key(table) in ours)
        if composed(other.name) != composed(entry.name) and shared:
            raise TrialError(f"table '{shared[0]}' in '{path}' is trial '{other.name}'; choose another name")


def _entry(trial: Trial, folder: Path) -> _TrialEntry:
    """Entry of a trial for the index; keys of what it doesn't have aren't set."""
    optional: dict[str, Any] = {
        "table": f"{trial.name}.csv" if trial.track.marker_count else None,
        "video": None if trial.video is None else path_from(folder, trial.video),
        "video_begin_s": round(trial.video_begin, 9),
        **{kind: f"{trial.name}.{kind}.csv" for kind in trial.signals},
        **{key: getattr(trial, key) for key in _KEPT},
    }
    return _TrialEntry(
        name=trial.name, nominal_frequency_hz=trial.nominal_frequency, fps=round(trial.fps, 6),
        **{key: getattr(trial, key) for key in _SAID}, **{key: value for key, value in optional.items() if value},
    )  # fmt: skip


def _read_index(path: Path) -> Index:
    return read(Index, path / INDEX, "reference", TrialError)


def _write_index(path: Path, markers: tuple[str, ...], entries: list[_TrialEntry]) -> None:
    write_json(path / INDEX, Index(format=1, markers=list(markers), trials=entries).model_dump(exclude_unset=True))


def _load_folder(path: Path, index: Index) -> TrialSet:
    trials = tuple(_load_trial(path, entry, index.markers) for entry in index.trials)
    return TrialSet(trials, tuple(index.markers))


def _load_trial(folder: Path, entry: _TrialEntry, markers: list[str]) -> Trial:
    paths = {kind: _file(folder, entry, kind, name) for kind, name in entry.files(filmed=bool(markers)).items()}
    tables = {kind: read_signals(path) for kind, path in paths.items() if kind != "table"}
    table = paths["table" if markers else "sensors"]
    track = _read_track(table, markers) if markers else MarkerTrack.without_markers(tables["sensors"].times)
    video = None if entry.video is None else folder / entry.video
    trial = Trial(
        entry.name, track, entry.nominal_frequency_hz, video=video, video_begin=entry.video_begin_s, **tables,
        **{key: getattr(entry, key) for key in (*_SAID, *_KEPT)},
    )  # fmt: skip
    check_motion(trial, table)
    if entry.fps is not None and abs(entry.fps / trial.fps - 1) > _SAME_FPS:
        raise TrialError(
            f"{folder / INDEX}: 'fps' of trial '{entry.name}' is {entry.fps:g}; the time stamps in {table.name}, which "
            f"are used, have {trial.fps:g} frames per second: correct them, or leave 'fps' out"
        )
    return trial


def _read_track(table: Path, markers: list[str]) -> MarkerTrack:
    read, columns = read_table(table), _columns(markers)
    if list(read.names) != columns:
        raise TrialError(f"{table}, line 1: the header must be {','.join(columns[:4])},… ({len(columns)} columns)")
    rows = read.matrix(f"{len(columns)} columns, as the header", len(columns), 2)
    cells = rows[:, 1:].reshape(len(rows), len(markers), 3)
    with about(table):
        return MarkerTrack(rows[:, 0], cells[:, :, :2], np.nan_to_num(cells[:, :, 2]))


def _file(folder: Path, entry: _TrialEntry, kind: str, name: str) -> Path:
    """Path of a trial's file, which must lie in the folder itself."""
    path = folder / name
    if not path.is_file() or path.parent != folder:
        raise TrialError(f"{folder / INDEX}: {kind} '{name}' of trial '{entry.name}' is not in {folder}")
    return path


def _columns(markers: tuple[str, ...] | list[str]) -> list[str]:
    return [TIME, *(f"{m}_{part}" for m in markers for part in ("x_m", "y_m", "confidence"))]


def _write_tables(folder: Path, trial: Trial, markers: tuple[str, ...]) -> None:
    """Writes the trial's tables, each whole or not at all."""
    if markers:
        track = trial.track
        cells = np.concatenate([track.positions, track.confidence[:, :, None]], axis=2).reshape(track.frame_count, -1)
        write_table(folder / f"{trial.name}.csv", [_columns(markers)], np.column_stack([track.times, cells]).tolist())
    for kind, signals in trial.signals.items():
        write_signals(signals, folder / f"{trial.name}.{kind}.csv")
