"""Overlays of a calibrated simulator for people: over real markers, and on a person's own film of a trial.

On a film the simulated markers are drawn through the camera that tracked it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markertrack import frames
from markertrack.camera import fixed_camera
from markertrack.camera_file import CameraFile
from markertrack.drawing import to_png
from markertrack.overlay import FilmOverlay
from markertrack.span import Span
from markertrack.video import VideoReader, film_name
from swim2real.calibration import Problem
from swim2real.objective import ComparedTrial, Comparison
from swim2real.parameters import Values
from swim2real.pipeline.tracking import TRACKS
from swim2real.rendering.album import Album
from swim2real.robots.robot import Robot
from swim2real.trials import Trial, TrialSet
from swim2real.trials.pose_tables import read_dlc
from swimbase import store
from swimbase.arrays import Array
from swimbase.errors import ArgumentError, TrialError

ALL = "all.png"
_MOMENTS, _COLUMNS, _TILE, _SMALL_TILE = 8, 4, 480, 240  # px for the tiles of a sheet
FAR = 3.0  # px, by which real markers may lie beside their track before the camera is doubted


def write_overlays(
    comparison: Comparison, robot: Robot, folder: str | Path, fps: float = 30.0, width: int = 960,
    on_file: Callable[[Path], None] = lambda path: None,
) -> list[Path]:  # fmt: skip
    """Writes simulated (blue) over real (red) trials.

    Args:
        comparison: What is drawn.
        robot: The robot whose trials they are.
        folder: Where to; it is made if it isn't there.
        fps: Frames a second of the films [Hz].
        width: Width of the films, even [px].
        on_file: Called after every file.

    Returns:
        The files: `NAME.mp4` and `NAME.png` a trial, and last `all.png`.

    Raises:
        ArgumentError: The folder can't be written, or a number is not allowed.
    """
    album, out = Album(comparison, robot), Path(folder)
    files: list[Path] = []

    def done(path: Path) -> None:
        files.append(path)
        on_file(path)

    with store.writing(out, ArgumentError, "choose another folder"):
        out.mkdir(parents=True, exist_ok=True)
        for scene in album.trials:
            film, sheet = out / f"{scene.name}.mp4", out / f"{scene.name}.png"
            scene.write_clip(film, fps, width)
            done(film)
            store.write_bytes(sheet, to_png(scene.sheet(_MOMENTS, _COLUMNS, _TILE)))
            done(sheet)
        store.write_bytes(out / ALL, to_png(album.overview(_MOMENTS, _SMALL_TILE)))
        done(out / ALL)
    return files


@dataclass(frozen=True)
class _DrawnFilm:
    """A film with simulated markers on it.

    Attributes:
        path: Where it is.
        frames: How many it has.
        notes: What a person should know.
    """

    path: Path
    frames: int
    notes: tuple[str, ...]


def chosen_trials(videos: tuple[Path, ...], reference: TrialSet) -> TrialSet:
    """The trials of films, by the films' names.

    Raises:
        TrialError: A film has no trial of its name.
        ArgumentError: Two films have one name.
    """
    names = [film_name(video) for video in videos]
    if len(set(names)) < len(names):
        raise ArgumentError(f"two films of --video have one name ({', '.join(names)}); draw them one after another")
    return TrialSet(tuple(reference[name] for name in names), reference.marker_names)


def draw_on_film(
    video: Path, problem: Problem, values: Values, known: CameraFile | None, span: Span, reference: Path, out: Path,
) -> _DrawnFilm:  # fmt: skip
    """Draws the simulated trial on its film: the markers and links in blue, the tracked markers as red rings.

    A swim is laid over the real one as the loss sees it: in phase, registered, along the real path.

    Args:
        video: The film.
        problem: With one trial, that of the film.
        values: Values of the robot's parameters.
        known: What the camera file says by which the film was tracked; None without one.
        span: Where the trial's time 0 is in the film, and up to when it is drawn.
        reference: Folder of the trial, where `track` left the track in pixels.
        out: Folder to write.

    Raises:
        Swim2RealError: The film or the camera can't be used, the simulation diverges, or nothing can be written.
    """
    (compared,), (trial,) = problem.evaluate(values).trials, problem.trials
    if compared.divergence is not None:
        raise TrialError(f"trial '{trial.name}': the simulation diverged: {compared.divergence}; nothing can be drawn")
    with store.writing(out, ArgumentError, "choose another folder"):
        out.mkdir(parents=True, exist_ok=True)
    target, count = out / f"{trial.name}.on-film.mp4", len(compared.times)
    real = trial.track.positions[:count]
    with VideoReader(video, fps=trial.film_rate) as reader:
        size = (reader.info.width, reader.info.height)
        camera = fixed_camera(known, trial.meters_per_pixel, problem.robot.marker_heights, size)
        tracked, drawn = camera.to_pixels(real), camera.to_pixels(in_world(compared, real))
        times = compared.times - compared.times[0]
        most = 0.6 * float(np.median(np.diff(times)))
        done = 0
        lines = problem.robot.links if compared.frequency is None else (tuple(range(len(problem.robot.marker_names))),)
        with FilmOverlay(target, size, reader.info.fps, lines) as overlay:
            for frame in reader:
                time = frame.time - span.begin
                if span.after(frame.time) or time > times[-1] + most:
                    break
                nearest = int(np.abs(times - time).argmin())
                if abs(times[nearest] - time) > most:
                    continue
                overlay.add(frame.scaled(overlay.width), frame.time, tracked[nearest], drawn[nearest])
                done += 1
            if not done:
                raise TrialError(
                    f"'{video}' has no frame of trial '{trial.name}', which begins at {span.begin:g} s and is "
                    f"{times[-1]:g} s long; give its begin in the film with --from"
                )
    return _DrawnFilm(target, done, off_its_film(trial, tracked, reference))


def in_world(compared: ComparedTrial, real: Array) -> Array:
    """Simulated markers where the loss sees them beside the real ones, in the world of the real track [m].

    What the frame of comparison takes out, such as the course of a swim, is that of the real robot. Where that isn't
    seen, it is taken from the frames around.

    Args:
        compared: The trial.
        real: Real positions in the world [m]. Shape (T, M, 2).

    Returns:
        Positions in the world [m]. Shape (T, M, 2).
    """
    if compared.frame is None:
        return compared.simulated
    pair = compared.frame
    seen = np.isfinite(real[:, list(pair)]).all(axis=(1, 2)) & (compared.weights[:, list(pair)] > 0).all(axis=1)
    axes = frames.body_axes(real, pair)
    angle = np.arctan2(axes[:, 1], axes[:, 0])
    if compared.head is not None and compared.head.simulated is not None:
        head = compared.head.real
        seen &= np.isfinite(head.place).all(axis=1)
        angle = angle - head.yaw
        places = compared.head.simulated.to_path(compared.simulated + compared.registration)
        origin, anchor = frames.heads(real, pair), head.place
    else:
        places = compared.simulated + compared.registration + _behind(compared)
        origin, anchor = real[:, pair[0]], np.zeros((len(real), 2))
    if not seen.any():
        raise TrialError(f"trial '{compared.name}': its frame is never seen, so it can't be laid on a film")
    times, known = compared.times, compared.times[seen]
    turn = np.interp(times, known, np.unwrap(angle[seen]))
    origin, anchor = (
        np.column_stack([np.interp(times, known, one[seen, axis]) for axis in (0, 1)]) for one in (origin, anchor)
    )
    along = np.column_stack([np.cos(turn), np.sin(turn)])
    return origin[:, None] + frames.composed(places - anchor[:, None], along[:, None])


def _behind(compared: ComparedTrial) -> Array:
    """Lag of the simulated robot behind the real one, along the frame's x [m]. Shape (T, 1, 2)."""
    behind = np.zeros_like(compared.times)
    if compared.progress is not None:
        behind = np.nan_to_num(compared.progress.real - compared.progress.simulated)
    return np.column_stack([behind, np.zeros_like(behind)])[:, None]


def off_its_film(trial: Trial, tracked: Array, reference: Path) -> tuple[str, ...]:
    """A sentence when the real markers don't fall on where they were tracked; nothing where that isn't known."""
    table = reference / TRACKS / f"{trial.name}.pixels.csv"
    if not table.is_file():
        return ()
    pixels, _ = read_dlc(table, trial.fps)
    if pixels.frame_count < len(tracked) or pixels.marker_count != tracked.shape[1]:
        return ()
    apart = np.linalg.norm(pixels.positions[: len(tracked)] - tracked, axis=2)
    known = apart[np.isfinite(apart)]
    if not known.size or np.median(known) <= FAR:
        return ()
    return (
        f"the red rings lie {np.median(known):.0f} px beside the markers, so this isn't the camera that tracked them; "
        f"give the same --camera as to track",
    )
