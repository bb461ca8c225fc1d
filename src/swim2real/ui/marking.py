"""A film's points, corrections and track, in the files of `pick` and `track`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from markertrack.corrections import find_stretches
from markertrack.following import FrameProgress
from markertrack.points import MarkersFile, load_points
from markertrack.tracking.tags import dictionary_at
from markertrack.video import film_name
from swim2real.pipeline.tracking import TRACKS, TrackingReport, track_video
from swim2real.robots.robot import Robot
from swim2real.settings import TrackingSettings
from swim2real.trials import load_reference
from swim2real.trials.pose_tables import read_dlc
from swim2real.ui.films import FilmCache, packed
from swim2real.ui.jobs import Job
from swim2real.ui.project import Project
from swimbase.checking import check, read
from swimbase.errors import ArgumentError, TrackingError
from swimbase.store import write_json, writing

Marks = dict[int, dict[str, list[float] | None]]  # places of markers [px] by frame and name; None where hidden


@dataclass(frozen=True)
class Tracked:
    """Track of a film.

    Attributes:
        first: Number of its first frame in the film.
        frames: Number of its frames.
        positions: Places of the markers, `packed` [px]. Shape (T, M, 2).
        stretches: First and last frame of each lost or doubtful stretch, which it is, and its markers.
        findings: Sentences of its report.
    """

    first: int
    frames: int
    positions: str
    stretches: list[tuple[int, int, str, tuple[int, ...]]]
    findings: list[str]


def about_film(
    project: Project, film: str, robot: str, reference: str | None, trial: str | None, midline: bool
) -> dict[str, object]:
    """A film as the page shows it: its frames, markers, and the track where there is one.

    Args:
        project: The folder.
        film: Path of the film.
        robot: The robot in it.
        reference: Path of the reference that its track is in; None without one.
        trial: Name of the trial.
        midline: Whether the ends of a midline are clicked.
    """
    path, body = project.place(film), project.robot(robot)
    shown, track = project.shown(film), None
    if reference is not None and trial is not None:
        track = _track(project.folder(reference), trial, project.films.opened(path).fps, body)
    kept = slice(None, None, max(len(body.marker_names) - 1, 1) if midline and track is None else 1)  # head and tail
    along = np.linalg.norm(np.diff(body.rest_markers[kept], axis=0), axis=1) if body.marker_names else np.zeros(0)
    sketch = np.concatenate([[0.0], np.cumsum(along)]) / max(float(along.sum()), 1e-9)
    names = {"names": body.marker_names[kept], "places": sketch.round(4).tolist()}
    return {**shown, **names, "track": track}


def clicked(film: Path, robot: Robot, kind: str) -> Marks:
    """Places in a points or corrections file; none without one."""
    file = _file(film, kind)
    if not file.is_file():
        return {}
    content = read(MarkersFile, file, kind, TrackingError)
    single = content.markers or dict(zip(robot.marker_names, content.points or (), strict=False))
    marks = {one.frame: one.markers for one in content.frames or ()} or {content.frame or 0: single}
    _check_names(f"{kind} of '{film.name}'", [name for one in marks.values() for name in one], robot)
    return marks


def _check_names(what: str, names: Iterable[str], robot: Robot) -> None:
    """Refuses what has markers that the robot doesn't have."""
    if other := [name for name in dict.fromkeys(names) if name not in robot.marker_names]:
        raise TrackingError(
            f"the {what} have {', '.join(other[:3])}, which robot '{robot.name}' doesn't have; choose the film's robot"
        )


def _track(folder: Path, trial: str, fps: float, robot: Robot) -> Tracked | None:
    table, page = (folder / TRACKS / f"{trial}.{kind}" for kind in ("pixels.csv", "json"))
    if not table.is_file() or not page.is_file():
        return None
    track, there = read_dlc(table, fps)
    _check_names(f"markers of trial '{trial}'", there, robot)
    if there != robot.marker_names:
        return None
    begin = load_reference(folder)[trial].video_begin
    stretches = [(one.first, one.last, one.reason, one.markers) for one in find_stretches(track)]
    findings = read(TrackingReport, page, "report of a track", TrackingError).findings
    return Tracked(round(begin * fps), track.frame_count, packed(track.positions), stretches, findings)


def mark(
    film: Path, size: tuple[int, int], robot: Robot, kind: str, frame: int,
    put: Mapping[str, list[float] | None], drop: Iterable[str],
) -> None:  # fmt: skip
    """Changes places in a frame in the file beside the film that `track` takes; a points file has one frame alone.

    What isn't named stays: another page, or a person with an editor, may have put it there meanwhile.

    Args:
        film: Path of the film.
        size: Width and height of its picture [px].
        robot: The robot in it.
        kind: Whether they are points or corrections.
        frame: Number of the frame.
        put: New places by name [px]; None where a marker is hidden.
        drop: Names of which nothing is said any more.
    """
    path, marks = _file(film, kind), clicked(film, robot, kind)
    mine = {name: place for name, place in marks.get(frame, {}).items() if name not in set(drop)} | dict(put)
    if kind == "points":
        content = {"frame": frame, "markers": mine}
    else:
        frames = sorted((number, one) for number, one in {**marks, frame: mine}.items() if one)
        content = {"frames": [{"frame": number, "markers": one} for number, one in frames]}
    width, height = size
    content = {"format": 1, "video": film.name, "width": width, "height": height, **content}
    check(MarkersFile, content, kind, TrackingError)
    with writing(path, TrackingError, "allow writing there"):
        write_json(path, content)


def track(
    film: Path, robot: Robot, folder: Path, camera: Path | None, midline: bool, films: FilmCache, job: Job
) -> str:  # fmt: skip
    """Tracks a film from its points, with its tables and around its corrections where there are any, into a reference.

    Args:
        film: Path of the film.
        robot: Robot in it.
        folder: Reference folder.
        camera: Path of the camera file.
        midline: Whether a midline is followed.
        films: Films that are open.
        job: Where it says how far it is.
    """
    points, corrections, controls, sensors = (
        file if (file := _file(film, kind, suffix)).is_file() else None
        for kind, suffix in (("points", "json"), ("corrections", "json"), ("controls", "csv"), ("sensors", "csv"))
    )
    page = folder / TRACKS / f"{film_name(film)}.json"
    if page.is_file():
        before = read(TrackingReport, page, "report of a track", TrackingError)
        there = load_reference(folder)[before.trial]
        midline = before.tracker == "midline"
        elsewhere = any(a is not None and b is None for a, b in ((there.controls, controls), (there.sensors, sensors)))
        if before.rate_from == "given" or there.video_begin or elsewhere:
            raise ArgumentError(
                f"'{film.name}' was tracked with options that the page doesn't have; go on with `swim2real track` and "
                f"--corrections {_file(film, 'corrections').name}"
            )
    settings = TrackingSettings(camera=camera, midline=midline)
    if points is not None and not midline:
        about = films.opened(film)
        anchor = load_points(points, robot.marker_names, about.width, about.height)
        tags = dictionary_at(films.image(film, anchor.frame), anchor.points)
        settings = settings if tags is None else replace(settings, tracker="aruco", tags=tags)

    def noted(progress: FrameProgress) -> None:
        job.note(done=progress.done, total=progress.total, **({"warning": progress.note} if progress.note else {}))
        if progress.positions is not None:
            job.note(places=packed(progress.positions))
        job.heed()

    report = track_video(
        film, points or "auto", robot, settings, folder, corrections=corrections, controls=controls, sensors=sensors,
        on_progress=noted,
    ).report  # fmt: skip
    lost = max(report.lost_share, default=0.0)
    return f"{report.trial}: {report.frames} frames, at most {100 * lost:.1f} % of them without a marker"


def _file(film: Path, kind: str, suffix: str = "json") -> Path:
    path = film.with_name(f"{film_name(film)}.{kind}.{suffix}")
    if path.is_symlink():
        raise ArgumentError(f"'{path.name}' is a link, which isn't followed; put the file itself there")
    return path
