"""A film's points, corrections and track, in the files of `pick`, `track` and the page of doubtful stretches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from markertrack.corrections import find_stretches
from markertrack.following import FrameProgress
from markertrack.points import MarkersFile
from markertrack.video import film_name
from swim2real.pipeline.tracking import TRACKS, TrackingReport, track_video
from swim2real.settings import TrackingSettings
from swim2real.trials import load_reference
from swim2real.trials.pose_tables import read_dlc
from swim2real.ui.fit import camera_of, places
from swim2real.ui.jobs import Job
from swim2real.ui.project import Project
from swimbase.checking import check, read
from swimbase.errors import ArgumentError, TrackingError
from swimbase.store import write_json, writing


def about_film(project: Project, film: Path, robot: str) -> dict[str, Any]:
    """A film as the page shows it: size, rate, markers, what was clicked, and the track where there is one."""
    about, body = project.films.opened(film), project.robot(robot)
    clicked = {
        kind: read(MarkersFile, path, kind, TrackingError).model_dump(exclude_unset=True) if path.is_file() else None
        for kind in ("points", "corrections")
        for path in [_file(film, kind)]
    }
    along = np.linalg.norm(np.diff(body.rest_markers, axis=0), axis=1) if len(body.marker_names) else np.zeros(0)
    sketch = np.concatenate([[0.0], np.cumsum(along)]) / max(float(along.sum()), 1e-9)
    listed = project.film(film)
    track = _track(project, listed, about["fps"], body.marker_names) if "reference" in listed else None
    names = {"names": list(body.marker_names), "places": sketch.round(4).tolist()}
    return {**about, **clicked, **names, "video": film.name, "track": track}


def _track(project: Project, listed: dict[str, Any], fps: float, names: tuple[str, ...]) -> dict[str, Any] | None:
    folder = project.folder(listed["reference"])
    table, page = (folder / TRACKS / f"{listed['trial']}.{kind}" for kind in ("pixels.csv", "json"))
    if not table.is_file() or not page.is_file():
        return None
    track, there = read_dlc(table, fps)
    if there != names:
        return None
    begin = load_reference(folder)[listed["trial"]].video_begin
    stretches = [(one.first, one.last, one.reason, list(one.markers)) for one in find_stretches(track)]
    findings = read(TrackingReport, page, "report of a track", TrackingError).findings
    first, found = round(begin * fps), places(track.positions)
    return {"first": first, "positions": found, "stretches": stretches, "findings": findings, **listed}


def save(film: Path, kind: str, content: dict[str, Any]) -> dict[str, Any]:
    """Writes points or corrections beside the film, as `track` takes them."""
    path = _file(film, kind)
    checked = check(MarkersFile, content, kind, TrackingError)
    with writing(path, TrackingError, "allow writing there"):
        write_json(path, checked.model_dump(exclude_unset=True))
    return {"said": f"{path.name} is saved"}


def track(project: Project, film: Path, robot: str, job: Job) -> str:
    """Tracks a film from its points, around its corrections where there are any, into the reference of its trial."""
    listed = project.film(film)
    folder = project.folder(listed.get("reference", "reference"))
    page, camera = folder / TRACKS / f"{film_name(film)}.json", camera_of(film, project.root)
    if page.is_file():
        before = read(TrackingReport, page, "report of a track", TrackingError)
        begun = load_reference(folder)[before.trial].video_begin
        if before.tracker != "detection" or before.rate_from == "given" or begun:
            raise ArgumentError(
                f"'{film.name}' was tracked with options that the page doesn't have; go on with `swim2real track` and "
                f"--corrections {_file(film, 'corrections').name}"
            )
    points, corrections = _file(film, "points"), _file(film, "corrections")

    def noted(progress: FrameProgress) -> None:
        job.note(done=progress.done, total=progress.total, **({"warning": progress.note} if progress.note else {}))
        job.heed()

    report = track_video(
        film, points if points.is_file() else "auto", project.robot(robot), TrackingSettings(camera=camera), folder,
        corrections=corrections if corrections.is_file() else None, on_progress=noted,
    ).report  # fmt: skip
    lost = max(report.lost_share, default=0.0)
    return f"{report.trial}: {report.frames} frames, at most {100 * lost:.1f} % of them without a marker"


def _file(film: Path, kind: str) -> Path:
    path = film.with_name(f"{film_name(film)}.{kind}.json")
    if path.is_symlink():
        raise ArgumentError(f"'{path.name}' is a link, which isn't followed; put the file itself there")
    return path
