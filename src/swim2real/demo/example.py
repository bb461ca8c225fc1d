"""The whole pipeline on the embedded example: track, calibrate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from markertrack.following import FrameProgress
from swim2real.calibration import Outcome, Progress
from swim2real.demo.synthetic import swim_name
from swim2real.pipeline import TrackedVideo, calibrate, track_videos
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings, TrackingSettings
from swim2real.trials import TrialSet, load_reference
from swimbase.errors import RunError, Swim2RealError
from swimbase.store import write_bytes, writing

FILMS = Path(__file__).parent / "films"  # made by examples/swims.py
FREQUENCIES = (0.5, 0.75, 1.0, 1.25)
MORE_FREQUENCIES = (1.5, 1.75, 2.0, 2.25)  # of the films that only `--full` takes
HELD_OUT = "f0_75"
_HIDDEN_SEED = 2026
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
    """Settings of the demo's calibration: those of any, with one trial held out.

    Raises:
        ArgumentError: A value is outside what is allowed.
    """
    return CalibrationSettings(budget=budget, seed=seed, hold_out=(HELD_OUT,), threads=workers)


def track(
    out: str | Path, *, films: str | Path = FILMS, full: bool = False, resume: bool = False,
    workers: int | None = None, callbacks: DemoCallbacks | None = None,
) -> TrialSet:  # fmt: skip
    """Tracks the markers in films of a fish with hidden parameters.

    Args:
        out: Folder; gets `videos/`, `camera.json` and `reference/`.
        films: Folder of the films, `camera.json`, and beside each film its points.
        full: Track all films of the folder, not those of `FREQUENCIES` alone.
        resume: Go on with an interrupted demo.
        workers: Videos tracked at a time.
        callbacks: Called with the progress.

    Raises:
        RunError: The folder holds a demo already, or can't be written.
    """
    folder, callbacks = Path(out), callbacks or DemoCallbacks()
    if not resume and any((folder / part).exists() for part in ("videos", "camera.json", "reference", "run")):
        raise RunError(f"'{folder}' holds a demo already; remove it, choose another --out or go on with --resume")
    taken = set(map(swim_name, FREQUENCIES))
    names = [path.stem for path in sorted(Path(films).glob("*.mp4")) if full or path.stem in taken]
    videos = [folder / "videos" / f"{name}.mp4" for name in names]
    points = [video.with_suffix(".points.json") for video in videos]
    camera = folder / "camera.json"
    with writing(folder, RunError, what="folder"):
        (folder / "videos").mkdir(parents=True, exist_ok=True)
        for place in (camera, *videos, *points):
            write_bytes(place, (Path(films) / place.name).read_bytes())
    callbacks.line(f"Tracking the markers in {len(videos)} films of a fish with hidden parameters")
    results = track_videos(
        videos, points, FISH, TrackingSettings(camera=camera), folder / "reference",
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
