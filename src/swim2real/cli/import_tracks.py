"""`import-tracks`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swim2real.cli import tables
from swim2real.cli.hints import for_robot
from swim2real.errors import ArgumentError, TrialError
from swim2real.robots import robot_named
from swim2real.robots.compiled import rigid_markers
from swim2real.robots.robot import Robot
from swim2real.tracking.camera import Camera, CameraFile, camera_for, read_camera
from swim2real.trials import MarkerTrack, Trial
from swim2real.trials.pose_tables import read_dlc
from swim2real.trials.reference import add_trial, nominal_frequency
from swim2real.trials.signals import read_signals

if TYPE_CHECKING:
    from swim2real.cli.arguments import ImportTracks


def import_tracks(a: ImportTracks) -> int:
    """Turns pose tables into trials of a reference folder; all tables are read before anything is written."""
    if a.frequency and len(a.frequency) != len(a.tables):
        raise ArgumentError(
            f"--frequency has {len(a.frequency)} values for {len(a.tables)} tables; give one for each table, or none"
        )
    for option, given in (("controls", a.controls), ("sensors", a.sensors)):
        if given and len(given) != len(a.tables):
            raise ArgumentError(
                f"--{option} has {len(given)} tables for {len(a.tables)} tracks; give one for each, or none"
            )
    for frequency in a.frequency:
        if not (np.isfinite(frequency) and frequency > 0):
            raise ArgumentError(f"--frequency is {frequency:g} Hz; it must be finite and above 0")
    if not (np.isfinite(a.fps) and a.fps > 0):
        raise ArgumentError(f"--fps is {a.fps:g}; it must be finite and above 0")
    robot = robot_named(a.robot)
    known = None if a.camera is None else read_camera(a.camera)
    read = {_name(path): (path, *_read(path, a.fps, known, robot)) for path in a.tables}
    controls, sensors = ([read_signals(one) for one in given] for given in (a.controls, a.sensors))
    if len(read) < len(a.tables):
        raise ArgumentError(f"two tables would make a trial of the same name ({', '.join(read)}); rename one")
    for i, (name, (path, track, camera, said)) in enumerate(read.items()):
        asked = a.frequency[i] if a.frequency else nominal_frequency(name)
        trial = Trial(
            name, camera.to_meters(track), asked, camera.scale.meters_per_pixel,
            f"pose table {path.name}, {a.fps:g} fps" + ("" if a.camera is None else f", camera {a.camera.name}"),
            controls=controls[i] if controls else None, sensors=sensors[i] if sensors else None,
        )  # fmt: skip
        add_trial(a.to, trial, robot.marker_names)
        mm_per_pixel = 1e3 * camera.scale.meters_per_pixel
        _say(f"{name}: {track.frame_count} frames, {track.duration:.2f} s, {mm_per_pixel:.4f} mm per pixel")
        for line in (*said, *camera.findings()):
            _say(f"{name}: {line}")
    _say(f"{a.to}: check the tracks with: swim2real quality {a.to}{for_robot(a.robot)}")
    return 0


def _name(path: Path) -> str:
    """What the trial is called: the video's name, without what DeepLabCut or `track` adds to it."""
    return path.stem.removesuffix(".pixels").split("DLC_")[0] or path.stem


def _read(path: Path, fps: float, known: CameraFile | None, robot: Robot) -> tuple[MarkerTrack, Camera, list[str]]:
    """The track in pixels with the robot's markers in order, its camera, and what to tell."""
    track, names = read_dlc(path, fps)
    said: list[str] = []
    if set(names) == set(robot.marker_names):
        order = [names.index(name) for name in robot.marker_names]
        track = MarkerTrack(track.times, track.positions[:, order], track.confidence[:, order])
    elif len(names) == len(robot.marker_names):
        pairs = ", ".join(f"{ours} is {theirs}" for ours, theirs in zip(robot.marker_names, names, strict=True))
        said.append(f"markers are taken in the table's order: {pairs}")
    else:
        raise TrialError(
            f"{path}: {len(names)} markers ({', '.join(names)}); robot '{robot.name}' has {len(robot.marker_names)} "
            f"({', '.join(robot.marker_names)})"
        )
    rigid = rigid_markers(robot)
    camera = camera_for(track, robot.rest_markers, robot.marker_heights, robot.marker_names, rigid, known)
    return track, camera, said


def _say(line: str) -> None:
    tables.console.print(line, soft_wrap=True, markup=False)
