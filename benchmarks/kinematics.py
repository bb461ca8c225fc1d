"""Swimming kinematics of fishmechr's lamprey, by our definitions and by fishmechr's, worked out apart from it.

    python benchmarks/kinematics.py lamprey.csv

The table comes from R: `write.csv(fishmechr::lampreydata, "lamprey.csv", row.names = FALSE)`.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, hilbert, sosfiltfilt

from markertrack.kinematics import swimming_kinematics
from markertrack.layout import Layout
from markertrack.track import MarkerTrack
from swim2real.trials.midline_tables import read_midlines

FPS, COUNT = 50.0, 20  # frames a second, points of a midline
SLOW, FAST = 0.5, 10.0  # Hz, between which excursions have a phase
HEAD = 30e-3  # m, within which fishmechr's pages take no wavelength


def by_fishmechr(times: NDArray[np.float64], points: NDArray[np.float64], along: NDArray[np.float64]) -> None:
    """Prints frequency, wavelength and the tail's amplitude of midlines (T, M, 2), at arc lengths (M,)."""
    length, centered = along[-1], points - points.mean(axis=1, keepdims=True)
    axes = np.array([np.linalg.svd(one)[2][0] for one in centered])
    axes *= np.sign((axes * (points[:, 0] - points[:, -1])).sum(axis=1))[:, None]
    axes = sosfiltfilt(butter(4, SLOW, fs=FPS, output="sos"), axes, axis=0)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    excursions = (centered * (axes[:, ::-1] * [-1, 1])[:, None]).sum(axis=2)
    smooth = sosfiltfilt(butter(4, [SLOW, FAST], btype="band", fs=FPS, output="sos"), excursions, axis=0)
    phases, inner = np.unwrap(np.angle(hilbert(smooth, axis=0)), axis=0), slice(5, -5)
    frequency = np.polyfit(times[inner], phases[inner, -1], 1)[0] / (2 * np.pi)
    cycles = np.floor(phases[:, -1] / (2 * np.pi))
    ranges = [np.ptp(excursions[cycles == one, -1]) / 2 for one in np.unique(cycles)[1:-1]]
    behind = along >= HEAD
    waves = [-2 * np.pi / np.polyfit(along[behind], np.unwrap(one)[behind], 1)[0] for one in phases[inner]]
    print(
        f"by fishmechr's definitions: {frequency:.3g} Hz, wavelength {np.median(waves) / length:.3g} lengths, ", end=""
    )
    print(f"tail {np.mean(ranges) / length:.3g} lengths")


def main(table: Path) -> None:
    places = np.linspace(0, 1, COUNT)
    track, _ = read_midlines(table, FPS, places)
    cells = np.genfromtxt(table, delimiter=",", names=True)
    points = 1e-3 * np.stack([cells["mxmm"], cells["mymm"]], axis=1).reshape(-1, COUNT, 2)
    seen = np.isfinite(points).all(axis=(1, 2))
    length = float(np.hypot(*np.moveaxis(np.diff(points[seen], axis=1), 2, 0)).sum(axis=1).mean())
    layout = Layout.of([f"S{m}" for m in range(COUNT)], length * np.stack([places, 0 * places], axis=1))
    known = track.frames(slice(int(seen.argmax()), None))
    ours = swimming_kinematics(MarkerTrack(known.times, 1e-3 * known.positions, known.confidence), layout)
    for quantity, unit, one in ours.table(layout.names):
        print(f"{quantity:16s} {one} {unit}")
    by_fishmechr(cells["t"].reshape(-1, COUNT)[seen, 0], points[seen], length * places)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
