"""One tracker for bodies and free markers, as an experiment: candidates with costs, linked over the whole film.

    python experiments/one_tracker/judge.py FOLDER...

Each folder is a film's, as `benchmarks/real_films.py` takes it. Prints usable positions (confidence of at least 0.5),
silent errors (usable, off by more than 3 px and half a radius), their root mean square error, and processor time.

It isn't the product's tracker yet: on the whole film of the building single markers of a row go astray where it jumps
by 100 px (438 silent errors; 0 within parts of it), and drawn films (`benchmarks/lattice_films.py --seed 0`) had
1,734 in 12 of 40, where rows of equal dots move by more than their spacing, or a dot passes another that stays. That
a marker stays unseen for long must cost little (UNSEEN), else what looks like it is taken for it; a step that flow
tells should be held against the last step as well, for one marker as for bodies.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
from linked import LinkedTracker

from markertrack.points import load_points
from markertrack.video import VideoReader
from swim2real.robots import load_robot

VIDEOS = (".mp4", ".mov", ".avi", ".mkv")


def judge(folder):
    video = next(path for path in folder.iterdir() if path.suffix in VIDEOS)
    robot = load_robot(str(next(folder.glob("*.toml"))), markers_only=True)
    truth = np.load(folder / "truth.npz")
    order = [[str(name) for name in truth["names"]].index(name) for name in robot.marker_names]
    known, tracker, spent, count = truth["p"][:, order], LinkedTracker(robot.marker_bodies), 0.0, 0
    with VideoReader(video, threads=1) as reader:
        size = reader.info.width, reader.info.height
        for frame in reader:
            image, began = frame.image, time.thread_time()
            if count:
                tracker.follow(image, frame.time)
            else:
                points = load_points(folder / "clicks.json", robot.marker_names, *size).points
                tracker.start(image, points, frame.time)
            spent, count = spent + time.thread_time() - began, count + 1
    positions, confidence = (part[: len(known)] for part in tracker.decided())
    off = np.linalg.norm(positions - known[: len(positions)], axis=2)
    there = np.isfinite(known[: len(positions), :, 0])
    usable = there & (confidence >= 0.5) & np.isfinite(off)
    silent = usable & (off > max(3.0, float(truth["radius"]) / 2))
    rmse = np.sqrt(np.mean(off[usable] ** 2)) if usable.any() else np.nan
    share = 100 * usable.sum() / there.sum()
    print(
        f"{folder.name}: usable {share:.1f} %, silent {silent.sum()}, RMSE {rmse:.2f} px, {1e3 * spent / count:.0f} ms"
    )


if __name__ == "__main__":
    cv2.setNumThreads(1)
    for path in sys.argv[1:]:
        judge(Path(path))
