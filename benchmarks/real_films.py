"""Compares trackers on real films that have a reference: ours, OpenCV's CSRT, and its pyramidal Lucas-Kanade.

Run with the package installed: `python benchmarks/real_films.py FOLDER...`. Each folder is a film's and holds the
video, `clicks.json` (points of its first frame), a robot file NAME.toml and `truth.npz`: `p`, shape (T, M, 2), the
markers' places [px], NaN where nobody knows; `names`, shape (M,); `radius`, of a marker [px]. Films aren't part of the
project; docs/tracking.md names where they are from.

usable: known places that are reported with a confidence of 0.5 or more. silent: of these, off by more than half a
radius and 3 px. RMSE: of the usable ones.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from csrt import CsrtTracker
from numpy.typing import NDArray

from markertrack.both_ways import both_ways
from markertrack.points import load_points
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.tracker import Tracker
from markertrack.video import VideoReader
from swim2real.robots import load_robot
from swimbase.errors import TrackingError

Array = NDArray[np.float64]
VIDEOS = (".mp4", ".mov", ".avi", ".mkv")
BOXES = 4.0  # radii of CSRT's box
WINDOWS, LEVELS = 3.2, 4  # radii of Lucas-Kanade's window, and levels of its pyramid
BACK = 1.0  # px by which the way there and back may differ


class LucasKanade:
    """Follows each marker from one picture to the next; doubted where the way back leads elsewhere."""

    def __init__(self, radius: float) -> None:
        side = max(7, round(WINDOWS * radius))
        self._options: dict[str, Any] = {"winSize": (side, side), "maxLevel": LEVELS}

    def start(self, image: NDArray[np.uint8], points: Array, time: float) -> tuple[Array, Array]:
        self._last, self._places = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), points.astype(np.float32)[:, None]
        return points, np.ones(len(points))

    def follow(self, image: NDArray[np.uint8], time: float) -> tuple[Array, Array]:
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        there, seen, _ = cv2.calcOpticalFlowPyrLK(self._last, gray, self._places, None, **self._options)
        back, again, _ = cv2.calcOpticalFlowPyrLK(gray, self._last, there, None, **self._options)
        off = np.linalg.norm(back - self._places, axis=2)[:, 0]
        self._last, self._places = gray, there
        return there[:, 0].astype(float), ((off < BACK) & (seen[:, 0] > 0) & (again[:, 0] > 0)).astype(float)


def judged(folder: Path, name: str) -> str:
    """Cells of a table: usable, silent, RMSE and milliseconds of a tracker and of decoding on a film."""
    video = next(path for path in folder.iterdir() if path.suffix in VIDEOS)
    robot = load_robot(str(next(folder.glob("*.toml"))), markers_only=True)
    truth = np.load(folder / "truth.npz")
    order = [[str(one) for one in truth["names"]].index(one) for one in robot.marker_names]
    radius, known = float(truth["radius"]), truth["p"][:, order]
    trackers: dict[str, Tracker] = {
        "ours": MarkerTracker(robot.marker_bodies, fixed=0),
        "csrt": CsrtTracker(box=max(8, round(BOXES * radius))),
        "lk": LucasKanade(radius),
    }
    with VideoReader(video, threads=1) as reader:
        start = load_points(folder / "clicks.json", robot.marker_names, reader.info.width, reader.info.height)
        began = time.thread_time()
        try:
            seen = list(both_ways(trackers[name], reader, start.points))
        except TrackingError as error:
            return f"refused: {error} |  |  | "
        spent = time.thread_time() - began
    _, found, confidence = zip(*seen, strict=True)
    sure = np.array(confidence) >= 0.5
    known = known[: len(found)]
    off = np.linalg.norm(np.array(found[: len(known)]) - known, axis=2)
    there = np.isfinite(known[..., 0])
    usable = there & sure[: len(known)] & np.isfinite(off)
    silent = int((off[usable] > max(3.0, radius / 2)).sum())
    rmse = np.sqrt(np.mean(off[usable] ** 2)) if usable.any() else np.nan
    return f"{100 * usable.sum() / there.sum():.1f} % | {silent} | {rmse:.2f} | {1e3 * spent / len(found):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("films", nargs="+", type=Path, metavar="FOLDER", help="of a film")
    parser.add_argument("--trackers", nargs="+", default=["ours", "csrt", "lk"], choices=["ours", "csrt", "lk"])
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print("| film | " + " | ".join(f"{one}: usable | silent | RMSE px | ms" for one in arguments.trackers) + " |")
    print("|---" + "|---:" * (4 * len(arguments.trackers)) + "|")
    for folder in arguments.films:
        print(f"| {folder.name} | " + " | ".join(judged(folder, one) for one in arguments.trackers) + " |", flush=True)


if __name__ == "__main__":
    main()
