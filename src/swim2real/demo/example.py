"""The whole pipeline on the embedded example: film, track, calibrate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pool import Glare, PoolCamera

from markertrack.camera_file import CameraFile, write_camera
from swim2real.calibration import Outcome, Progress
from swim2real.demo.synthetic import film_swims, points_file
from swim2real.pipeline import FrameProgress, TrackedVideo, calibrate, track_videos
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings, TrackingSettings
from swim2real.trials import TrialSet, load_reference
from swimbase.errors import RunError, Swim2RealError

DEMO_FREQUENCIES = (0.5, 0.75, 1.0, 1.25)
FULL_FREQUENCIES = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25)
HELD_OUT = "f0_75"
_MINUTES = 1.5  # of search
_HIDDEN_SEED = 2026
SECONDS = 4.0
CAMERA = PoolCamera(width=1280, height=720, view=2.4, camera_height=3.5, glints=3.0)
_GLARE = Glare(1.0, 1.15, over=(4, 5))  # in the last film
# a fish that swims: the hidden parameters are drawn around these points of the cube, one per parameter group
_CENTER, _SPREAD = np.repeat([0.55, 0.6, 0.5, 0.85, 0.5, 0.55, 0.55, 0.3], [1, 1, 1, 1, 1, 1, 5, 5]), 0.12


@dataclass(frozen=True)
class DemoCallbacks:
    """Called with what a person wants to see: a line, the state of a video, what came of one."""

    line: Callable[[str], None] = lambda text: None
    frame: Callable[[FrameProgress], None] = lambda progress: None
    film: Callable[[str, TrackedVideo | Swim2RealError], None] = lambda name, result: None


def hidden_values() -> dict[str, float]:
    """The parameters of the demo's 'real' fish. Tracking and calibration never see them."""
    rng = np.random.default_rng(_HIDDEN_SEED)
    point = np.clip(_CENTER + rng.uniform(-_SPREAD, _SPREAD, len(_CENTER)), 0, 1)
    return replace(FISH.space, scale="log").to_values(point)


def demo_settings(budget: int | None = None, seed: int = 2, workers: int | None = None) -> CalibrationSettings:
    """Settings of the demo's calibration.

    Raises:
        ArgumentError: A value is outside what is allowed.
    """
    minutes = _MINUTES if budget is None else None
    return CalibrationSettings(budget=budget, minutes=minutes, seed=seed, hold_out=(HELD_OUT,), threads=workers)


def film_and_track(
    out: str | Path, *, frequencies: Sequence[float] = DEMO_FREQUENCIES, seconds: float = SECONDS,
    camera: PoolCamera = CAMERA, resume: bool = False, workers: int | None = None,
    callbacks: DemoCallbacks | None = None,
) -> TrialSet:  # fmt: skip
    """Films a fish with hidden parameters, and tracks its markers.

    Args:
        out: Folder; gets `videos/`, `camera.json` and `reference/`.
        frequencies: Frequencies of the motor, one film each [Hz].
        seconds: Length of each film [s].
        camera: That films; the last film gets glare over two markers as well.
        resume: Go on with an interrupted demo.
        workers: Videos filmed or tracked at a time.
        callbacks: Called with the progress.

    Raises:
        RunError: The folder holds a demo already, or can't be written.
    """
    folder, callbacks = Path(out), callbacks or DemoCallbacks()
    if not resume and any((folder / part).exists() for part in ("videos", "camera.json", "reference", "run")):
        raise RunError(f"'{folder}' holds a demo already; remove it, choose another --out or go on with --resume")
    cameras = [(f, replace(camera, glares=(_GLARE,)) if f == frequencies[-1] else camera) for f in frequencies]
    callbacks.line(f"Filming {len(frequencies)} swims of a fish with hidden parameters, {seconds:g} s each")
    films = film_swims(
        FISH, hidden_values(), cameras, seconds, _HIDDEN_SEED, folder / "videos", workers=workers,
        on_done=lambda path: callbacks.line(f"{path}: filmed"),
    )  # fmt: skip
    # what a person can measure: how high the camera hangs over the head's markers
    known = folder / "camera.json"
    write_camera(known, CameraFile(camera_height=camera.camera_height - float(FISH.marker_heights[0])))
    callbacks.line("Tracking the markers")
    results = track_videos(
        films, [points_file(film) for film in films], FISH, TrackingSettings(camera=known), folder / "reference",
        workers=workers, on_progress=callbacks.frame, on_done=callbacks.film,
    )  # fmt: skip
    for result in results:
        if isinstance(result, Swim2RealError):
            raise result
    return load_reference(folder / "reference")


def fit(
    out: str | Path, settings: CalibrationSettings | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> Outcome:  # fmt: skip
    """Calibrates against the tracked trials, one of them left out; goes on with a run that is there.

    Args:
        out: Folder with `reference/`; gets `run/`.
        settings: Settings of the calibration.
        on_progress: Called after every evaluation.

    Returns:
        The run's outcome.
    """
    folder = Path(out)
    return calibrate(
        load_reference(folder / "reference"), FISH, settings or demo_settings(), folder / "run",
        source=str(folder / "reference"), resume=(folder / "run" / "settings.json").exists(),
        on_progress=on_progress,
    )  # fmt: skip
