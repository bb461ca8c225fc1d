"""The midline of a swimmer without markers: where it is, which end is the head, and where it is in doubt."""

from pathlib import Path

import numpy as np
import pytest
from swimmers import FPS, Swimmer, film

from markertrack import HowToTrack, Layout, TrackedFilm, save_points, track_film
from markertrack.quality import DOUBTFUL
from swimbase.errors import TrackingError

COUNT = 9
LAYOUT = Layout.of([f"S{m}" for m in range(COUNT)], np.linspace([0, 0], [0.2, 0], COUNT))
LAYOUT = Layout(LAYOUT.names, LAYOUT.rest, LAYOUT.heights, (0,) * COUNT)


def track(video: Path, ends: np.ndarray, frame: int = 0, **how) -> TrackedFilm:
    points = video.with_suffix(".json")
    markers = ", ".join(f'"{name}": [{x}, {y}]' for name, (x, y) in zip(("S0", "S8"), ends, strict=True))
    points.write_text(f'{{"format": 1, "frame": {frame}, "markers": {{{markers}}}}}')
    return track_film(video, points, LAYOUT, HowToTrack(midline=True, **how))


def errors(found: TrackedFilm, swimmer: Swimmer) -> np.ndarray:
    """Distances of reported places from the truth [px], NaN where lost or doubtful. Shape (T, M)."""
    true = np.array([swimmer.midline(k / FPS)[:: 200 // (COUNT - 1)] for k in range(found.seen.frame_count)])
    off = np.linalg.norm(found.seen.positions - true, axis=2)
    return np.where(found.seen.confidence >= DOUBTFUL, off, np.nan)


def test_places_along_the_midline_are_found_from_two_clicks(tmp_path):
    swimmer = Swimmer()
    found = track(film(tmp_path / "swim.mp4", [swimmer]), swimmer.midline(0)[[0, -1]])
    off = errors(found, swimmer)
    print(np.isfinite(off).mean(), np.sqrt(np.nanmean(off**2, axis=0)), np.nanmax(off), found.notes)
