"""Measures trackers of markers on films whose truth is known. Prints the table of docs/tracking.md.

Run with the package installed: `python benchmarks/tracking.py`, `--csrt` for the paper's tracker on some of the clips,
`--random 60` for clips that nobody chose, `--help` for the rest. Clips are H.264 files that are read back; random ones
go from the camera to the tracker.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # one thread is measured; before NumPy is imported

import argparse
import hashlib
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from csrt import CsrtTracker
from pool import Filmed
from tracking_clips import CSRT_CLIPS, SUITE, Array, Clip, random_clip

from markertrack.both_ways import both_ways
from markertrack.quality import DOUBTFUL
from markertrack.tracking.markers import MarkerTracker
from markertrack.video import Frame, VideoReader
from swimbase.errors import TrackingError

WARM_UP = 2  # frames of a clip that aren't timed: compiled code is loaded
WRONG = 10.0  # px by which a marker that is reported may be off before it counts as a silent error
MOST_MISSED, MOST_RMSE = 0.10, 0.5  # share, px: a random clip above them is listed
AnyTracker = MarkerTracker | CsrtTracker
Frames = Iterable["Picture | Frame"]


@dataclass(frozen=True)
class Result:
    """A tracked clip, and the truth about it.

    Attributes:
        found: Positions as reported [px]. Shape (T, M, 2).
        confidence: As reported. Shape (T, M).
        places: Where the markers are, also outside of the image [px]. Shape (T, M, 2).
        radius: Of the markers, about [px].
        hidden: Covered by more than half, or outside of the image. Shape (T, M).
        size: Of the image: width, height [px].
        track_time: Of the processor in the tracker, the first frames left out [s].
        decode_time: In the video reader, likewise [s].
    """

    found: Array
    confidence: Array
    places: Array
    radius: float
    hidden: NDArray[np.bool_]
    size: tuple[int, int]
    track_time: float
    decode_time: float

    @property
    def reported(self) -> NDArray[np.bool_]:
        return np.isfinite(self.found[..., 0]) & (self.confidence >= DOUBTFUL)

    @property
    def errors(self) -> Array:
        """Distance from the truth, NaN where nothing is reported [px]. Shape (T, M)."""
        return np.where(self.reported, np.linalg.norm(self.found - self.places, axis=2), np.nan)

    @property
    def silent(self) -> NDArray[np.bool_]:
        """Reported, and wrong or wholly outside of the image. Shape (T, M)."""
        edges = np.array(self.size) - 1 + self.radius
        outside = ((self.places < -self.radius) | (self.places > edges)).any(axis=2)
        return self.reported & ((self.errors > WRONG) | outside)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Not hidden, and not cut by the image's edge either. Shape (T, M)."""
        edges = np.array(self.size) - 1 - self.radius
        return ~self.hidden & ((self.places >= self.radius) & (self.places <= edges)).all(axis=2)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Visible and not reported. Shape (T, M)."""
        return self.visible & ~self.reported

    @property
    def rmse(self) -> float:
        """Of markers that are reported and visible [px]."""
        return float(np.sqrt(np.nanmean(np.where(self.visible, self.errors, np.nan) ** 2)))

    @property
    def worst(self) -> float:
        """Largest error of what is reported [px]."""
        return float(np.nanmax(self.errors))

    @property
    def missed(self) -> float:
        """Share of what is visible that isn't reported."""
        return float(self.lost.sum() / max(self.visible.sum(), 1))

    @property
    def right_though_hidden(self) -> int:
        return int((self.hidden & self.reported & ~self.silent).sum())

    @property
    def milliseconds(self) -> tuple[float, float]:
        """A frame of tracking and of decoding [ms]."""
        count = max(len(self.found) - WARM_UP, 1)
        return 1e3 * self.track_time / count, 1e3 * self.decode_time / count


@dataclass(frozen=True)
class Picture:
    """A frame that no film holds. See `markertrack.video.Frame`."""

    index: int
    time: float
    image: NDArray[np.uint8]
    intact: bool = True


def tracked(clip: Clip, filmed: Filmed, frames: Frames, tracker: AnyTracker) -> Result:
    """Runs a tracker over the frames of a clip: ours both ways, as `swim2real track` does."""
    waited = began = 0.0

    def timed() -> Iterator[Picture | Frame]:
        """All is done in this thread; what else the machine does counts little."""
        nonlocal waited, began
        source = iter(frames)
        while True:
            before = time.thread_time()
            frame = next(source, None)
            if frame is None:
                return
            waited += time.thread_time() - before
            yield frame
            if frame.index == WARM_UP - 1:
                waited, began = 0.0, time.thread_time()

    way = both_ways if isinstance(tracker, MarkerTracker) else forward
    _, found, confidence = zip(*way(tracker, timed(), clip.picks(filmed)), strict=True)
    spent = time.thread_time() - began - waited
    radius = clip.camera.marker_radius / filmed.meters_per_pixel
    places = clip.places(filmed)
    if len(places) != len(found):
        raise SystemExit(f"'{clip.name}': {len(places)} frames were filmed and {len(found)} came back")
    size = (clip.camera.width, clip.camera.height)
    return Result(np.array(found), np.array(confidence), places, radius, filmed.hidden, size, spent, waited)


def forward(tracker: CsrtTracker, frames: Frames, picks: Array) -> Iterator[tuple[Picture | Frame, Array, Array]]:
    """Follows markers forth alone. CSRT reports nothing of the first frame."""
    for frame in frames:
        if frame.index == 0:
            tracker.start(frame.image, picks, frame.time)
            yield frame, picks, np.ones(len(picks))
        else:
            yield frame, *tracker.follow(frame.image, frame.time)


def decoded(path: Path) -> Iterator[Frame]:
    with VideoReader(path, threads=1) as reader:
        for frame in reader:
            _ = frame.image  # its conversion is part of decoding
            yield frame


def on_disk(clip: Clip, folder: Path) -> tuple[Filmed, Path]:
    """Films a clip, unless it has been filmed before with the same settings."""
    settings = hashlib.sha256(repr(clip).encode()).hexdigest()[:10]
    path = folder / f"{''.join(c if c.isalnum() else '-' for c in clip.name)}-{settings}.mp4"
    filmed = clip.scene().filmed if path.exists() else clip.film(str(path))
    return filmed, path


HEADINGS = ("clip", "RMSE px", "worst px", "silent errors", "missed", "hidden", "hidden but right", "track ms",
            "decode ms")  # fmt: skip


def heading(*more: str) -> None:
    print("\n| " + " | ".join((*HEADINGS, *more)) + " |")
    print("|---" + "|---:" * (len(HEADINGS) + len(more) - 1) + "|", flush=True)


def row(name: str, result: Result, *more: str) -> None:
    track, decode = result.milliseconds
    cells = (name, f"{result.rmse:.2f}", f"{result.worst:.1f}", f"{result.silent.sum()} of {result.reported.sum()}",
             f"{100 * result.missed:.1f} %", f"{result.hidden.sum()}", f"{result.right_though_hidden}", f"{track:.1f}",
             f"{decode:.1f}")  # fmt: skip
    print("| " + " | ".join((*cells, *more)) + " |", flush=True)


def suite(clips: list[Clip], folder: Path, csrt: tuple[str, ...], make: Callable[[], AnyTracker]) -> None:
    results: dict[str, Result] = {}
    others: dict[str, Result] = {}
    heading()
    for clip in clips:
        filmed, path = on_disk(clip, folder)
        results[clip.name] = tracked(clip, filmed, decoded(path), make())
        row(clip.name, results[clip.name])
        if clip.name in csrt:
            others[clip.name] = tracked(clip, filmed, decoded(path), CsrtTracker(box=40))
    _totals(list(results.values()))
    _speed([results[c.name] for c in clips if c.camera.width == 3840 and c.camera.fps == 60])
    if others:
        heading("times slower")
        for name, result in others.items():
            slower = result.track_time / results[name].track_time
            row(f"CSRT, box 40: {name}", result, f"{slower:.0f}")


def _totals(every: list[Result]) -> None:
    reported, silent = (sum(int(getattr(r, name).sum()) for r in every) for name in ("reported", "silent"))
    visible, missed = (sum(int(getattr(r, name).sum()) for r in every) for name in ("visible", "lost"))
    print(
        f"\n{len(every)} clips, {sum(len(r.found) for r in every)} frames: {silent} silent errors among {reported} "
        f"reported positions; {missed} of {visible} visible ones missed ({100 * missed / max(visible, 1):.2f} %)"
    )


def _speed(every: list[Result]) -> None:
    """What 4K at 60 frames per second costs."""
    count = sum(len(r.found) - WARM_UP for r in every)
    if count:
        tracking, decoding = (
            60 * sum(getattr(r, name) for r in every) / count for name in ("track_time", "decode_time")
        )
        print(f"4K at 60 fps: {tracking + decoding:.2f} s of processor time for a second of video, on one thread, "
              f"{decoding:.2f} s of it to decode")  # fmt: skip


def random_clips(indices: Iterable[int], seed: int, make: Callable[[], AnyTracker]) -> None:
    """Tracks clips that nobody chose, and lists those on which the tracker falls short."""
    heading()
    results: list[Result] = []
    short: list[str] = []
    for index in indices:
        clip = random_clip(seed, index)
        swim = clip.scene()
        try:
            pictures = (Picture(n, *one) for n, one in enumerate(swim))
            result = tracked(clip, swim.filmed, pictures, make())
        except TrackingError as error:
            short.append(f"- clip {index}: {clip.settings()}\n  refused: {error}")
            print(f"| {clip.name} | refused |", flush=True)
            continue
        results.append(result)
        row(clip.name, result)
        if result.silent.any() or result.missed > MOST_MISSED or result.rmse > MOST_RMSE:
            short.append(f"- clip {index}: {clip.settings()}\n  {_reasons(result)}")
    _totals(results)
    print(f"\n{len(short)} clips with a silent error, more than {100 * MOST_MISSED:g} % missed, "
          f"an RMSE above {MOST_RMSE:g} px, or refused")  # fmt: skip
    print("\n".join(short))


def _reasons(result: Result) -> str:
    """What is wrong, and where it begins: frame and marker."""
    parts: list[str] = []
    if result.silent.any():
        frame, marker = np.argwhere(result.silent)[0]
        at = np.round(result.places[frame, marker], 1)
        parts.append(f"{result.silent.sum()} silent errors, first in frame {frame}, marker {marker}: truth {at}, found "
                     f"{np.round(result.found[frame, marker], 1)}, confidence {result.confidence[frame, marker]:.2f}, "
                     f"hidden {result.hidden[frame, marker]}")  # fmt: skip
    lost = result.lost
    if result.missed > MOST_MISSED:
        markers = ", ".join(f"{m}: {n}" for m, n in enumerate(lost.sum(axis=0)) if n)
        parts.append(f"{100 * result.missed:.0f} % missed of {len(lost)} frames, first in frame "
                     f"{np.argwhere(lost)[0][0]}; by marker {markers}")  # fmt: skip
    if result.rmse > MOST_RMSE:
        errors = np.where(result.visible, result.errors, np.nan)
        frame, marker = np.unravel_index(np.nanargmax(errors), errors.shape)
        each = ", ".join(f"{e:.2f}" for e in np.sqrt(np.nanmean(errors**2, axis=0)))
        parts.append(f"RMSE {result.rmse:.2f} px, by marker {each}; worst {errors[frame, marker]:.1f} px in frame "
                     f"{frame}, marker {marker}")  # fmt: skip
    return "; ".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, help="folder in which films are kept, and looked for")
    parser.add_argument("--only", default="", help="clips whose name holds this")
    parser.add_argument("--csrt", action="store_true", help=f"CSRT, too, on {len(CSRT_CLIPS)} of the clips")
    parser.add_argument("--csrt-all", action="store_true", help="CSRT, too, on all clips")
    parser.add_argument("--random", type=int, default=0, metavar="N", help="N random clips instead of the suite")
    parser.add_argument("--seed", type=int, default=1, help="of the random clips (%(default)s)")
    parser.add_argument("--index", type=int, nargs="*", help="only these of the random clips")
    parser.add_argument("--free", action="store_true", help="as nine markers that nothing connects")
    arguments = parser.parse_args()
    make = partial(MarkerTracker, range(9), chain=not arguments.free)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numba", "numpy", "scipy", "av"))
    print(f"{os.cpu_count()} cores {platform.machine()}, {platform.system()}; Python {platform.python_version()}, "
          f"{packages}{_opencv() if arguments.csrt or arguments.csrt_all else ''}")  # fmt: skip
    if arguments.random or arguments.index:
        random_clips(arguments.index or range(arguments.random), arguments.seed, make)
        return
    clips = [clip for clip in SUITE if arguments.only in clip.name]
    csrt = tuple(clip.name for clip in clips) if arguments.csrt_all else CSRT_CLIPS if arguments.csrt else ()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.clips or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        suite(clips, folder, csrt, make)


def _opencv() -> str:
    import cv2

    cv2.setNumThreads(1)
    return f", OpenCV {cv2.__version__}"


if __name__ == "__main__":
    main()
