"""Measures trackers of equal markers on rigid bodies: films of a laboratory that nobody chose, whose truth is known.

Run with the package installed: `python benchmarks/lattice_films.py`. `--help` lists the options. Films are drawn by
`lattice_camera.py`, which shares nothing with the pool camera that the tracker was developed with; their truth is in
`lattice_truth.py`, and the numbers are drawn in `lattice_scenes.py`.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one thread is measured; before NumPy is imported

import argparse
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

import numpy as np
from csrt import CsrtTracker
from lattice_camera import drawn, write
from lattice_looks import filmed
from lattice_real import KINDS, real_film
from lattice_scenes import SCENES, random_film
from lattice_truth import Array, Film
from numpy.typing import NDArray

from markertrack.both_ways import both_ways
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.tracker import Tracker
from markertrack.video import Frame, VideoReader
from swimbase.errors import TrackingError

DOUBTFUL = 0.5  # confidence below which a position is doubtful, as for `quality`
FAR = 10.0  # px: what `benchmarks/tracking.py` calls a silent error
SLOW = 5.0  # px a frame, below which a marker that isn't covered is plainly visible
SURE = (0.5, 0.7, 0.9, 0.99, 1.01)  # confidences of which the share that is right is counted
BANDS = (0.0, 5.0, 10.0, 20.0, 40.0, 60.0, np.inf)  # px a frame
TRACKERS: dict[str, Callable[[Film], Tracker]] = {
    "detection": lambda film: MarkerTracker(film.bodies, film.fixed),
    "csrt": lambda film: CsrtTracker(box=max(8, round(4 * film.radius))),
}


@dataclass(frozen=True)
class Result:
    """A tracked film.

    Attributes:
        film: With the truth.
        found: Positions as reported [px]. Shape (T, M, 2).
        confidence: As reported. Shape (T, M).
        track_time: Of the processor in the tracker, the way back included [s].
        decode_time: In the video reader, likewise [s].
    """

    film: Film
    found: Array
    confidence: Array
    track_time: float
    decode_time: float

    @property
    def reported(self) -> NDArray[np.bool_]:
        return np.isfinite(self.found[..., 0]) & (self.confidence > 0)

    @property
    def sure(self) -> NDArray[np.bool_]:
        return self.reported & (self.confidence >= DOUBTFUL)

    @property
    def errors(self) -> Array:
        """Distance from the truth, NaN where nothing is reported [px]. Shape (T, M)."""
        return np.where(self.reported, np.linalg.norm(self.found - self.film.places, axis=2), np.nan)

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """Reported and off by more than half a radius, or 3 px. Shape (T, M)."""
        return self.errors > max(3.0, 0.5 * self.film.radius)

    @property
    def silent(self) -> NDArray[np.bool_]:
        """Wrong without a doubt. Shape (T, M)."""
        return self.wrong & self.sure

    @property
    def swapped(self) -> NDArray[np.bool_]:
        """Silent errors that are nearer to another marker than to their own. Shape (T, M)."""
        away = np.linalg.norm(self.found[:, :, None] - self.film.places[:, None], axis=3)
        own = np.eye(away.shape[1], dtype=bool)
        return self.silent & (np.where(own, np.inf, away).min(axis=2) < self.errors)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Visible and not reported, or with a doubt only. Shape (T, M)."""
        return self.film.visible & ~self.sure

    @property
    def longest(self) -> float:
        """Longest time for which a marker in plain sight isn't reported, or with a doubt only [s]."""
        unseen = (self.film.covered == 0) & (self.film.speed < SLOW) & ~self.sure
        run = longest = np.zeros(unseen.shape[1])
        for row in unseen:
            run = np.where(row, run + 1, 0)
            longest = np.maximum(longest, run)
        return float(longest.max() / self.film.fps)

    @property
    def rmse(self) -> float:
        """Of what is visible and reported without a doubt [px]."""
        errors = self.errors[self.sure & self.film.visible]
        return float(np.sqrt(np.mean(errors**2))) if len(errors) else np.nan

    @property
    def worst(self) -> float:
        """Of what is reported without a doubt [px]."""
        return float(self.errors[self.sure].max(initial=0.0))

    @property
    def milliseconds(self) -> tuple[float, float]:
        """A frame of tracking and of decoding [ms]."""
        return 1e3 * self.track_time / len(self.found), 1e3 * self.decode_time / len(self.found)


def tracked(film: Film, tracker: Tracker) -> Result:
    """Runs a tracker over a film.

    Raises:
        TrackingError: The tracker refuses the film.
    """
    waited = 0.0

    def decoded(reader: VideoReader) -> Iterator[Frame]:
        nonlocal waited
        frames = iter(reader)
        while True:
            began = time.thread_time()  # all is done in this thread; what else the machine does counts little
            frame = next(frames, None)
            if frame is None:
                return
            _ = frame.image
            waited += time.thread_time() - began
            yield frame

    with VideoReader(film.path, threads=1) as reader:
        began = time.thread_time()
        seen = list(both_ways(tracker, decoded(reader), film.picks))
        spent = time.thread_time() - began - waited
    if len(seen) != len(film.times):
        raise SystemExit(f"'{film.name}': {len(film.times)} frames were filmed and {len(seen)} came back")
    _, found, confidence = zip(*seen, strict=True)
    return Result(film, np.array(found), np.array(confidence), spent, waited)


HEADINGS = ("film", "size", "markers", "radius", "top speed", "shutter", "RMSE px", "worst px", "silent errors",
            "swapped", "doubtful and wrong", "lost", "longest lost s", "track ms", "decode ms")  # fmt: skip


def row(result: Result) -> None:
    film = result.film
    track, decode = result.milliseconds
    cells = (film.name, f"{film.camera.width} x {film.camera.height}", str(len(film.bodies)), f"{film.radius:.0f}",
             f"{film.speed.max():.0f}", f"{film.camera.shutter:.1f}", f"{result.rmse:.2f}", f"{result.worst:.1f}",
             f"{result.silent.sum()} of {result.sure.sum()}", str(result.swapped.sum()),
             str((result.wrong & ~result.sure).sum()), f"{100 * _share(result.lost.sum(), film.visible.sum()):.1f} %",
             f"{result.longest:.2f}", f"{track:.1f}", f"{decode:.1f}")  # fmt: skip
    print("| " + " | ".join(cells) + " |", flush=True)


def _share(part: float, of: float) -> float:
    return part / of if of else 0.0


def summary(name: str, results: list[Result], refused: int) -> None:
    def total(of: Callable[[Result], NDArray[np.bool_]]) -> int:
        return sum(int(of(r).sum()) for r in results)

    if not results:
        if refused:
            print(f"\n{name}: {refused} films refused")
        return
    sure, visible = total(lambda r: r.sure), total(lambda r: r.film.visible)
    errors = np.concatenate([r.errors[r.sure & r.film.visible] for r in results])
    print(f"\n{name}: {len(results)} films, {sum(len(r.found) for r in results)} frames, {refused} films refused")
    print(
        f"- {total(lambda r: r.silent)} silent errors among {sure} positions, in "
        f"{sum(r.silent.any() for r in results)} films; {total(lambda r: r.silent & (r.errors > FAR))} of them off by "
        f"more than {FAR:g} px, {total(lambda r: r.swapped)} nearer to another marker"
    )
    print(f"- {total(lambda r: r.wrong & ~r.sure)} wrong positions that were reported as doubtful")
    print(f"- RMSE {np.sqrt(np.mean(errors**2)):.2f} px, worst {max(r.worst for r in results):.1f} px")
    print(f"- lost: {total(lambda r: r.lost)} of {visible} visible ones "
          f"({100 * _share(total(lambda r: r.lost), visible):.2f} %)")  # fmt: skip
    for low, high in pairwise(BANDS):
        seen = sum(int((_band(r, low, high) & r.film.visible).sum()) for r in results)
        lost = sum(int((_band(r, low, high) & r.lost).sum()) for r in results)
        if seen:
            print(f"  - at {low:g} to {high:g} px a frame {lost} of {seen} ({100 * _share(lost, seen):.1f} %)")
    confidence, right = (
        np.concatenate([one[r.reported & r.film.visible] for r, one in pairs])
        for pairs in ([(r, r.confidence) for r in results], [(r, ~r.wrong) for r in results])
    )
    for low, high in pairwise(SURE):
        among = (confidence >= low) & (confidence < high)
        if among.any():
            print(
                f"  - reported with {low:g} to {min(high, 1):g}: {among.sum()}, {100 * right[among].mean():.2f} % right"
            )
    slowest = max(results, key=lambda r: r.longest)
    print(f"- in plain sight and lost for {slowest.longest:.2f} s at most, in '{slowest.film.name}'; for more "
          f"than 0.5 s in {sum(r.longest > 0.5 for r in results)} films")  # fmt: skip
    track, decode = (np.mean([r.milliseconds[k] for r in results]) for k in (0, 1))
    print(f"- {track:.1f} ms per frame to track, {decode:.1f} ms to decode", flush=True)


def _band(result: Result, low: float, high: float) -> NDArray[np.bool_]:
    return (result.film.speed >= low) & (result.film.speed < high)


def run(films: list[Film], names: list[str]) -> None:
    results: dict[str, list[Result]] = {name: [] for name in names}
    refused = dict.fromkeys(names, 0)
    for name in names:
        print(f"\n{name}:\n\n| " + " | ".join(HEADINGS) + " |")
        print("|---" + "|---:" * (len(HEADINGS) - 1) + "|", flush=True)
        for film in films:
            if not film.path.exists():
                write(film, filmed(film) if film.scene.look else drawn(film))
            try:
                results[name].append(tracked(film, TRACKERS[name](film)))
            except TrackingError as error:
                refused[name] += 1
                print(f"| {film.name} | refused: {error} |", flush=True)
                continue
            row(results[name][-1])
    for name in names:
        every = results[name]
        for kind in dict.fromkeys((*SCENES, *KINDS)):
            summary(f"{name}, {kind}", [r for r in every if r.film.name.startswith(kind)], refused=0)
        summary(f"{name}, all", every, refused[name])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=("plain", "real"), default="plain", help="of films (%(default)s)")
    parser.add_argument("--films", type=int, default=40, help="how many (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of all that is random (%(default)s)")
    parser.add_argument("--only", default="", metavar="NAME", help="films whose name holds this, of these")
    parser.add_argument("--csrt", action="store_true", help="OpenCV's CSRT, too")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep films there, and use those that are there")
    arguments = parser.parse_args()
    packages = ", ".join(f"{name} {version(name)}" for name in ("numba", "numpy", "scipy", "av"))
    python = f"Python {platform.python_version()}"
    print(f"{os.cpu_count()} cores {platform.machine()}, {platform.system()}; {python}, {packages}")
    if arguments.csrt:
        import cv2

        cv2.setNumThreads(1)
        print(f"OpenCV {cv2.__version__}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        chosen = real_film if arguments.kind == "real" else random_film
        films = [chosen(arguments.seed, index, folder) for index in range(arguments.films)]
        run([f for f in films if arguments.only in f.name], list(TRACKERS) if arguments.csrt else ["detection"])


if __name__ == "__main__":
    main()
