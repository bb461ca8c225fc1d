"""Compares trackers on real films that have a reference: ours, OpenCV's CSRT, and its pyramidal Lucas-Kanade.

Run with the package installed: `python benchmarks/real_films.py FOLDER...`. Each folder is a film's and holds the
video, `clicks.json` (points of its first frame), a robot file NAME.toml and `truth.npz`: `p`, shape (T, M, 2), the
markers' places [px], NaN where nobody knows; `names`, shape (M,); `radius`, of a marker [px]. Films aren't part of the
project; docs/tracking.md names where they are from.

usable: known places that are reported with a confidence of 0.5 or more. silent: of these, off by more than half a
radius and 3 px. RMSE: of the usable ones. With `--clicks 10` usable and silent of ours after ten clicks of correction:
places of the reference in the middle of the longest doubtful or lost times of markers, as a person might click them.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from csrt import CsrtTracker
from numpy.typing import NDArray

from markertrack.both_ways import both_ways
from markertrack.following import Film, correct
from markertrack.points import Anchor, load_points
from markertrack.quality import DOUBTFUL, runs
from markertrack.span import Span
from markertrack.track import MarkerTrack
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.tracker import Tracker
from markertrack.video import VideoReader
from swim2real.robots import load_robot
from swim2real.robots.robot import Robot
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


class Reference(NamedTuple):
    """A film, what is known of it, and where its markers are [px]: shape (T, M, 2), NaN where nobody knows."""

    video: Path
    robot: Robot
    radius: float
    known: Array

    def score(self, places: Array, confidence: Array) -> tuple[float, int, float]:
        """Usable places [%], silent errors and RMSE [px] of positions (T, M, 2) and confidence (T, M)."""
        count = min(len(self.known), len(places))
        off = np.linalg.norm(places[:count] - self.known[:count], axis=2)
        there = np.isfinite(self.known[:count, :, 0])
        usable = there & (confidence[:count] >= DOUBTFUL) & np.isfinite(off)
        silent = int((off[usable] > max(3.0, self.radius / 2)).sum())
        rmse = float(np.sqrt(np.mean(off[usable] ** 2))) if usable.any() else np.nan
        return 100 * usable.sum() / there.sum(), silent, rmse


def reference(folder: Path) -> Reference:
    """The film of a folder."""
    video = next(path for path in folder.iterdir() if path.suffix in VIDEOS)
    robot = load_robot(str(next(folder.glob("*.toml"))), markers_only=True)
    truth = np.load(folder / "truth.npz")
    order = [[str(one) for one in truth["names"]].index(one) for one in robot.marker_names]
    return Reference(video, robot, float(truth["radius"]), truth["p"][:, order])


def clicked(folder: Path, clicks: int) -> str:
    """Cells of a table: usable and silent places before and after clicks of correction, in three sittings."""
    film, anchors = reference(folder), dict[int, Anchor]()
    names, bodies = film.robot.marker_names, film.robot.marker_bodies
    what = Film(folder.name, film.video, Span(), names, bodies, 1, None)
    with VideoReader(film.video, threads=1) as reader:
        start = load_points(folder / "clicks.json", names, reader.info.width, reader.info.height)
        seen = list(both_ways(MarkerTracker(bodies, fixed=0), reader, start.points))
        places, sure = (np.array([one[k] for one in seen]) for k in (1, 2))
        base = track = MarkerTrack([frame.time - seen[0][0].time for frame, *_ in seen], places, sure)
        for many in np.diff(np.linspace(0, clicks, 4).round().astype(int)).tolist():
            known = film.known[: track.frame_count]
            failing = np.isfinite(known[..., 0]) & (track.confidence[: len(known)] < DOUBTFUL)
            times = [(end - begin, m, (begin + end) // 2) for m, of in enumerate(failing.T) for begin, end in runs(of)]
            for _, marker, frame in sorted(times, reverse=True)[:many]:
                nothing = Anchor(frame, np.full((len(names), 2), np.nan), np.zeros(len(names), dtype=bool))
                anchors.setdefault(frame, nothing).points[marker] = known[frame, marker]
            track = correct(what, reader, base, 0, [anchors[frame] for frame in sorted(anchors)])
    return " | ".join("{:.1f} % | {}".format(*film.score(one.positions, one.confidence)) for one in (base, track))


def judged(folder: Path, name: str) -> str:
    """Cells of a table: usable, silent, RMSE and milliseconds of a tracker and of decoding on a film."""
    film = reference(folder)
    trackers: dict[str, Tracker] = {
        "ours": MarkerTracker(film.robot.marker_bodies, fixed=0),
        "csrt": CsrtTracker(box=max(8, round(BOXES * film.radius))),
        "lk": LucasKanade(film.radius),
    }
    with VideoReader(film.video, threads=1) as reader:
        start = load_points(folder / "clicks.json", film.robot.marker_names, reader.info.width, reader.info.height)
        began = time.thread_time()
        try:
            seen = list(both_ways(trackers[name], reader, start.points))
        except TrackingError as error:
            return f"refused: {error} |  |  | "
        spent = time.thread_time() - began
    _, found, confidence = zip(*seen, strict=True)
    usable, silent, rmse = film.score(np.array(found), np.array(confidence))
    return f"{usable:.1f} % | {silent} | {rmse:.2f} | {1e3 * spent / len(found):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("films", nargs="+", type=Path, metavar="FOLDER", help="of a film")
    parser.add_argument("--trackers", nargs="+", default=["ours", "csrt", "lk"], choices=["ours", "csrt", "lk"])
    parser.add_argument("--clicks", type=int, default=0, metavar="N", help="ours before and after N of correction")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.clicks:
        print(
            f"| film | usable | silent | after {arguments.clicks} clicks: usable | silent |\n|---|---:|---:|---:|---:|"
        )
        for folder in arguments.films:
            print(f"| {folder.name} | {clicked(folder, arguments.clicks)} |", flush=True)
        return
    print("| film | " + " | ".join(f"{one}: usable | silent | RMSE px | ms" for one in arguments.trackers) + " |")
    print("|---" + "|---:" * (4 * len(arguments.trackers)) + "|")
    for folder in arguments.films:
        print(f"| {folder.name} | " + " | ".join(judged(folder, one) for one in arguments.trackers) + " |", flush=True)


if __name__ == "__main__":
    main()
