"""Trials of what other programs wrote, tracks and logs of controllers or encoders; and tracks as they read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from markertrack.camera import Camera, camera_for
from markertrack.camera_file import CameraFile, read_camera
from markertrack.span import Span, spans
from markertrack.track import MarkerTrack
from swim2real.pipeline.recording import Recorded, Wanted, recorded
from swim2real.pipeline.tracking import TRACKS
from swim2real.robots.robot import Robot
from swim2real.trials import Trial, load_reference
from swim2real.trials.log_table import read_log
from swim2real.trials.midline_tables import read_midlines
from swim2real.trials.pose_tables import read_dlc, read_poses, write_poses
from swim2real.trials.published import nominal_frequency
from swim2real.trials.reference import INDEX, add_trial, check_folder
from swim2real.trials.signals import read_signals
from swim2real.trials.timebase import TABLES, Timebase, by_stamps, contradictions
from swimbase.errors import ArgumentError
from swimbase.names import composed

Format = Literal["deeplabcut", "sleap", "movement"]
_MILLIMETER = 1e-3  # m
_ENDINGS: dict[Format, str] = {"deeplabcut": ".csv", "sleap": ".h5", "movement": ".nc"}


@dataclass(frozen=True)
class Imported:
    """A trial that was made of a table of tracks.

    Attributes:
        trial: The trial.
        notes: Sentences on its clocks, its markers and its scale.
    """

    trial: Trial
    notes: tuple[str, ...]


def import_tracks(
    tables: Sequence[str | Path], robot: Robot, to: str | Path, *, fps: float, camera: str | Path | None = None,
    frequency: Sequence[float] = (), controls: Sequence[str | Path] = (), sensors: Sequence[str | Path] = (),
    begin: Sequence[float] = (), until: Sequence[float] = (), midline: bool = False,
) -> list[Imported]:  # fmt: skip
    """Makes trials of other programs' tracks: tables of DeepLabCut, SLEAP, or others with columns NAME.x and NAME.y.

    Args:
        tables: N tables, one per trial, in pixels; their frames are counted from the video's first, 0.
        robot: Robot whose markers they are.
        to: Reference folder that gets the trials.
        fps: Frames per second of the videos [Hz].
        camera: JSON file with known lengths, camera height, plane or lens.
        frequency: Motor command in each trial [Hz]; N or none.
        controls: Tables of what drove the robot; N or none.
        sensors: Tables of what was measured; N or none.
        begin: Times from which tracks are used [s]; none, one for all, or N.
        until: Times up to which they are used [s]; likewise.
        midline: Whether the tables are midlines of swimmers without markers, as trackter, fishmechr, TRex and
            WormTracer write them.

    Raises:
        ArgumentError: Two tables would make trials of the same name.
        Swim2RealError: A table or the camera can't be read.
    """
    paths = [Path(path) for path in tables]
    stretches = spans(tuple(begin), tuple(until), len(paths), "tables")
    robot.check_markers("import")
    known = None if camera is None else read_camera(Path(camera))
    # all tables are read before anything is written
    read = {
        _trial_name(path): (path, span, *_read_track(path, fps, known, robot, span, midline))
        for path, span in zip(paths, stretches, strict=True)
    }
    if len(read) < len(paths):
        raise ArgumentError(f"two tables would make a trial of the same name ({', '.join(read)}); rename one")
    none, kind = [None] * len(paths), "midlines" if midline else "pose table"
    driven, measured = ([read_signals(Path(path)) for path in one] or none for one in (controls, sensors))
    made: list[Imported] = []
    for i, (name, (path, span, pixels, scale, notes)) in enumerate(read.items()):
        clocks = {"track": Timebase(f"first frame of the video of {path.name}", fps, "given")}
        trial = Trial(
            name, scale.to_meters(pixels), frequency[i] if frequency else nominal_frequency(name),
            scale.scale.meters_per_pixel,
            f"{kind} {path.name}, {fps:g} fps" + ("" if camera is None else f", camera {Path(camera).name}"),
            controls=driven[i], sensors=measured[i],
            timebases=clocks | by_stamps(TABLES, controls=driven[i], sensors=measured[i]), midline=midline,
        ).within(span)  # fmt: skip
        add_trial(Path(to), trial, robot.marker_names)
        found = (
            *(f"{stream} at {clock}" for stream, clock in trial.timebases.items()), *notes, *contradictions(trial),
            *scale.findings(),
        )  # fmt: skip
        made.append(Imported(trial, found))
    return made


def _trial_name(path: Path) -> str:
    """Name of a trial: the video's, without what DeepLabCut or `track` adds to it."""
    return composed(path.stem.removesuffix(".pixels").split("DLC_")[0] or path.stem)


def _read_track(
    path: Path, fps: float, known: CameraFile | None, robot: Robot, span: Span, midline: bool
) -> tuple[MarkerTrack, Camera, list[str]]:
    """A stretch of a track in pixels with the robot's markers in order, its camera, and notes on it."""
    layout = robot.layout.level if midline else robot.layout
    track, notes = read_midlines(path, fps, layout.places_along) if midline else read_poses(path, fps, layout.names)
    track = span.of_track(track, str(path))
    return track, camera_for(track, layout, known), notes


def import_recording(
    tables: Sequence[str | Path], robot: Robot, to: str | Path, *, time: Sequence[str] = (),
    controls: Sequence[str] = (), sensors: Sequence[str] = (), markers: Sequence[str] = (),
    control_tables: Sequence[str | Path] = (), frequency: Sequence[float] = (), begin: Sequence[float] = (),
    until: Sequence[float] = (),
) -> list[Recorded]:  # fmt: skip
    """Makes trials of logs: text tables with a header, of any program and in any units.

    Args:
        tables: N tables, one per trial; their names become the trials' names.
        robot: Robot whose recordings they are.
        to: Reference folder that gets the trials; the track of one that is there is kept where the log has no markers.
        time: Column of the time stamps, as `COLUMN:UNIT`.
        controls: Columns of the actuators, as `NAME=COLUMN:UNIT`.
        sensors: Columns of the sensors, likewise.
        markers: Columns of the markers, as `NAME=XCOLUMN,YCOLUMN:UNIT`.
        control_tables: Separate tables of the controls; N or none.
        frequency: Motor command in each trial [Hz]; N or none.
        begin: Times after a table's first row that become 0 of the trials [s]; none, one for all, or N.
        until: Times up to which tables are used [s]; likewise.

    Raises:
        ArgumentError: Two tables would make trials of the same name.
        Swim2RealError: A table can't be read, or lacks a column.
    """
    paths, folder = [Path(path) for path in tables], Path(to)
    stretches = spans(tuple(begin), tuple(until), len(paths), "tables")
    wanted = Wanted.of(robot, tuple(time), tuple(controls), tuple(sensors), tuple(markers))
    names = [composed(path.stem) for path in paths]
    if len(set(names)) < len(names):
        raise ArgumentError(f"two tables would make a trial of the same name ({', '.join(names)}); rename one")
    for name in names:
        check_folder(folder, name, robot.marker_names)
    there = {trial.name: trial for trial in load_reference(folder)} if (folder / INDEX).is_file() else {}
    made: list[Recorded] = []
    for i, (name, path) in enumerate(zip(names, paths, strict=True)):  # all are read before any is written
        commands = read_log(Path(control_tables[i])) if control_tables else None
        made.append(
            recorded(
                name, read_log(path), robot, wanted, span=stretches[i], from_first_row=bool(begin), commands=commands,
                tracked=there.get(name), frequency=frequency[i] if frequency else None,
            )
        )  # fmt: skip
    for one in made:
        add_trial(folder, one.trial, robot.marker_names)
    return made


def export_tracks(
    reference: str | Path, to: str | Path, kind: Format = "deeplabcut", trials: Sequence[str] = ()
) -> list[tuple[Path, float]]:
    """Writes the tracks of a reference for other programs, in pixels with y down, a file per trial.

    What `track` saw in a video is written as it was seen, before it was smoothed or filled in. Of a trial without a
    video the positions are turned into pixels of the trial's scale, or of 1 mm where it has none.

    Args:
        reference: Reference folder.
        to: Folder to write.
        kind: Whose format: a DeepLabCut table, an analysis of SLEAP, or a data set of movement.
        trials: Names of the trials; by default all.

    Returns:
        The files, and the frames per second of each [Hz].

    Raises:
        TrialError: There is no such trial, or a file can't be written.
        MissingExtraError: The library for the format isn't installed.
    """
    known, folder, made = load_reference(reference), Path(to), list[tuple[Path, float]]()
    for trial in [known[name] for name in trials or known.names]:
        table, rate = Path(reference) / TRACKS / f"{trial.name}.pixels.csv", trial.fps
        seen = read_dlc(table, rate)[0] if table.is_file() else None
        if seen is None or seen.frame_count != trial.track.frame_count:  # of another trial of that name
            pixels = trial.track.positions / (trial.meters_per_pixel or _MILLIMETER) * (1, -1)
            seen = MarkerTrack(np.arange(trial.track.frame_count) / rate, pixels, trial.track.confidence)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{trial.name}{_ENDINGS[kind]}"
        write_poses(seen, known.marker_names, path, rate)
        made.append((path, rate))
    return made
