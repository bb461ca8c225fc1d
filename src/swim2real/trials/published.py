"""The prior work's published tracks, and what is known of the camera that filmed them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.trials.text_table import read_table
from swim2real.trials.trial import Perspective, Trial, check_motion
from swimbase.errors import TrialError
from swimbase.names import quoted

_FPS = 60.0
_MARKERS = 9
_HEAD_LENGTH = 0.142  # m, distance of the first two markers on the robot
_BELOW = 1920.0, 1080.0  # px, the middle of the published films' pictures
# Markers of the stiff body are nearer to the camera than those of the tail by 5 % of its distance, M8 by 2.5 %, from
# how the distances between markers change as the fish crosses the picture (experiments/perspective.py).
_NEARNESS = 0.0, 0.0, -0.001, -0.048, -0.048, -0.048, -0.048, -0.048, -0.024
_TILT = -0.027, -0.038  # 1/m
# m, one for all films, with which M0 and M1 are as far apart on average: in one film hand-placed markers miss it by 3 %
_METERS_PER_PIXEL = 1.0202e-3
_NAME = re.compile(r"(?:markers_)?(f(\d+)_(\d+))$")


def read_published(path: str | Path, fps: float = _FPS) -> Trial:
    """Reads a raw published CSV: pixels with y down, x and y of nine markers per row, to meters with y up.

    The scale is the median distance of the first two markers, which are 0.142 m apart on the robot.

    Args:
        path: Path of the table.
        fps: Frames a second of its video.

    Raises:
        TrialError: The table can't be read, or shows no scale or no motion.
    """
    table = Path(path)
    if not (np.isfinite(fps) and fps > 0):
        raise TrialError(f"{table.name}: fps is {fps}; it must be finite and above 0")
    read = read_table(table)
    if any(read.names):
        raise TrialError(
            f"{table}, line 1: it names columns ({quoted(read.names[0])}), and the published tables have none; of logs "
            f"`swim2real import-recording` makes a reference, of DeepLabCut's tables `swim2real import-tracks`"
        )
    rows = read.matrix(f"{2 * _MARKERS} numbers per row (x and y of {_MARKERS} markers)", 2 * _MARKERS, 2)
    pixels = rows.reshape(len(rows), _MARKERS, 2)
    lengths = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1)
    seen = lengths[np.isfinite(lengths)]
    head_px = float(np.median(seen)) if seen.size else 0.0
    if not head_px > 0:
        raise TrialError(f"{table.name}: the first two markers coincide or are never seen, so there is no scale")
    scale = _HEAD_LENGTH / head_px
    times = np.arange(len(rows)) / fps
    published = _NAME.match(table.stem)
    trial = Trial(
        name=published.group(1) if published else table.stem,
        track=MarkerTrack(times, pixels * scale * [1.0, -1.0]),
        nominal_frequency=nominal_frequency(table.stem),
        meters_per_pixel=scale,
        provenance=f"published marker track {table.name}, {fps:g} fps, markers placed by hand",
        perspective=Perspective((_BELOW[0] * scale, -_BELOW[1] * scale), _NEARNESS, _TILT, _METERS_PER_PIXEL / scale),
    )
    return check_motion(trial, table)


def nominal_frequency(name: str) -> float | None:
    """The frequency in a trial's name [Hz], such as 1.5 in `f1_50`; None for other names."""
    match = _NAME.match(name)
    return (float(f"{match.group(2)}.{match.group(3)}") or None) if match else None  # in f0_00 the motor stands still
