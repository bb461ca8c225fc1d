"""Reads videos frame by frame: upright pictures, times from time stamps, and notes on what is wrong with the file."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Literal, Self, TypeVar

import numpy as np
from av import VideoFrame
from numpy.typing import NDArray

from markertrack.video.clock import Clock, Notes, frames
from markertrack.video.damage import REPORTED, marked
from markertrack.video.decoding import FIRST_PICTURE, Decoder, Picture, no_picture, too_large, usual_interval
from markertrack.video.pictures import Pictures, is_pattern, pattern_of
from swimbase.errors import VideoError

Image = NDArray[np.uint8]
Result = TypeVar("Result")

ROUNDING = 5e-4  # s, of a time that a person gives
SLACK = 5.0  # s beyond FIRST_PICTURE that a film has which is read, but gives no picture
MOST_BYTES = 256 << 20  # of decoded frames that are kept at a time
_BYTES = 1.5  # of a pixel, as it is decoded
SAME_RATE = 0.1  # relative difference of two rates that a camera may mean as one
_SMEARED = "{frames} after a broken one may be smeared, {when}"
_ODD = "{frames} that may be damaged, by what they show, {when}"
_RESIZED = "{frames} of another size, {when}; scaled to that of the first"


@dataclass(frozen=True)
class VideoInfo:
    """Statements of a file about itself.

    Attributes:
        path: Path of the file.
        width: Width of the upright picture [px].
        height: Height of the upright picture [px].
        fps: Mean number of frames per second; NaN where nothing states it.
        rate_from: How that is known: by its `container`, or `given` by the user; None where it isn't.
        frame_count: Number of frames as the file states it, or from its duration; None if it states neither.
        duration: Duration as the file states it [s]; None if it doesn't.
        mirrored: Whether stored pictures are mirrored, left for right, before they are turned.
        rotation: Angle by which stored pictures are turned clockwise to be upright [degrees]: 0, 90, 180 or 270.
        codec: Name of the codec, such as `h264`.
    """

    path: Path
    width: int
    height: int
    fps: float
    rate_from: Literal["container", "given"] | None
    frame_count: int | None
    duration: float | None
    mirrored: bool
    rotation: int
    codec: str


@dataclass(frozen=True)
class Frame:
    """One frame. Its picture is converted when it is asked for; a frame that is kept keeps its picture in memory.

    Attributes:
        index: Number of the frame among those that are delivered, from 0.
        time: Time since the first frame, strictly rising [s]; NaN where the film's rate isn't known.
        intact: False after a broken frame, up to the next key frame: the picture may be smeared, since it was
            predicted from one that isn't there. False also where a picture looks damaged.
    """

    index: int
    time: float
    intact: bool
    _stored: VideoFrame = field(repr=False, compare=False)
    _size: tuple[int, int] = field(repr=False, compare=False)  # of the stored picture: width, height
    _mirrored: bool = field(repr=False, compare=False)
    _rotation: int = field(repr=False, compare=False)  # clockwise [degrees]

    @cached_property
    def image(self) -> Image:
        """The upright picture, RGB, read-only. A turned picture is a view. Shape (H, W, 3)."""
        image = self._convert(*self._size, "BILINEAR")
        image.flags.writeable = False
        return image

    def scaled(self, width: int) -> Image:
        """The upright picture in another size, RGB: cheaper than scaling `image`.

        Args:
            width: Width of the result [px]. The height keeps the proportions, rounded to an even number.

        Returns:
            A writable picture. Shape (height, width, 3).

        Raises:
            VideoError: The width is below 2 px.
        """
        if width < 2:
            raise VideoError(f"a picture can't be scaled to a width of {width} px; it must be at least 2")
        sideways = self._rotation in (90, 270)
        stored_width, stored_height = self._size
        share = stored_width / stored_height if sideways else stored_height / stored_width
        height = max(2, 2 * round(width * share / 2))
        return np.ascontiguousarray(self._convert(*((height, width) if sideways else (width, height)), "AREA"))

    def _convert(self, width: int, height: int, interpolation: str) -> Image:
        stored = self._stored.to_ndarray(
            format="rgb24", width=width, height=height, interpolation=interpolation, threads=1
        )
        pixels = np.asarray(stored, dtype=np.uint8)
        return np.rot90(pixels[:, ::-1] if self._mirrored else pixels, -(self._rotation // 90))


class VideoReader:
    """Frames of a video, one after the other, in constant memory. A context manager.

    Iterating again starts at the first frame. Broken frames are left out; `notes` says which.

    Attributes:
        info: What the file states about itself.
    """

    info: VideoInfo

    def __init__(self, path: str | Path, threads: int = 0, fps: float | None = None) -> None:
        """Opens the video and decodes its first frame.

        Args:
            path: Path of the video, of a folder of pictures, or a pattern of their names such as `frame_%04d.png`.
            threads: Number of threads that decode; 0 for as many as the machine has cores.
            fps: Frames per second that the camera took; by default as the file states it. Where the file has time
                stamps they keep their pattern, so that a frame that is missing leaves a gap.

        Raises:
            VideoError: The file can't be read, not one frame can be decoded, or its rate isn't known.
        """
        if threads < 0:
            raise VideoError(f"threads is {threads}; it must be 0 (as many as there are cores) or more")
        if fps is not None and not 0 < fps < math.inf:
            raise VideoError(f"fps is {fps:g}; it must be finite and above 0 frames per second")
        self._pass = _Pass(Path(path), threads, fps)
        self._threads, self._fps = threads, fps
        self._used = self._closed = False
        self.info = self._pass.info
        if self.info.rate_from is None or self._pass.lone:
            self.close()
            raise VideoError(_no_film(Path(path)) if self._pass.lone else _unknown_rate(Path(path)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._closed = True
        self._pass.close()

    def __iter__(self) -> Iterator[Frame]:
        if self._closed:
            raise VideoError(f"'{self.info.path}' is closed; read it within its `with` block")
        if self._used:
            self._pass.close()
            self._pass = _Pass(self.info.path, self._threads, self._fps)
        self._used = True
        return self._pass.frames()

    @property
    def notes(self) -> list[str]:
        """A sentence for each thing that a person should know; complete after the last frame."""
        return self._pass.notes()


def first_frame(path: str | Path, since: float = 0.0, fps: float | None = None) -> Frame:
    """The first frame of a video, for which no rate is needed, or the first from a time on.

    Args:
        path: Path of the video, as `VideoReader` takes it.
        since: Time since its first frame, to a millisecond [s].
        fps: Frames per second that the camera took; by default as the file states it.

    Raises:
        VideoError: The file can't be read, not one frame can be decoded, it ends before that time, or its rate isn't
            known.
    """
    if not since:
        with closing(_Pass(Path(path), 1, None)) as film:
            return next(film.frames())
    with VideoReader(path, threads=1, fps=fps) as reader:
        last = 0.0
        for frame in reader:
            if frame.time >= since - ROUNDING:
                return frame
            last = frame.time
    raise VideoError(f"'{path}' ends at {last:.3f} s; there is no frame from {since:g} s on")


def most_frames(width: int, height: int) -> int:
    """Number of frames that there is room for at a time, of pictures of a size [px]."""
    return max(1, int(MOST_BYTES / (_BYTES * width * height)))


def frames_backwards(
    path: str | Path, first: int, last: int, threads: int = 0, fps: float | None = None
) -> Iterator[Frame]:
    """Frames of a video in reverse order.

    A video is decoded forward only, so it is read several times, up to the end of one part after the other: of 1000
    frames of 1080p each is decoded six times on average.

    Args:
        path: Path of the video.
        first: Number of the frame that comes last.
        last: Number of the frame that comes first.
        threads: Number of threads that decode; 0 for as many as the machine has cores.
        fps: Frames per second that the camera took; by default as the file states it.

    Raises:
        VideoError: The file can't be read.
    """
    with VideoReader(path, threads, fps) as reader:
        part = most_frames(reader.info.width, reader.info.height)
        while last >= first:
            begin = max(first, last - part + 1)
            kept = [frame for frame in islice(reader, last + 1) if begin <= frame.index <= last]
            yield from reversed(kept)
            last = begin - 1


class _Pass:
    """One pass through a video, from its first frame to its last.

    Attributes:
        info: What the file states about itself.
        lone: Whether it is a single picture.
    """

    info: VideoInfo

    def __init__(self, path: Path, threads: int, fps: float | None) -> None:
        """Opens the file and decodes the first frame.

        Raises:
            VideoError: The file can't be read, or not one frame can be decoded.
        """
        # a disk that doesn't answer can't be interrupted, only left alone
        try:
            self._decoder, self._pictures, first = _in_time(lambda: _begun(path, threads), FIRST_PICTURE + SLACK)
        except TimeoutError:
            raise VideoError(no_picture(path)) from None
        self._first: Picture | None = first
        self.lone = isinstance(self._decoder, Pictures) and len(self._decoder.numbers) == 1
        stated = self._decoder.stated
        rate = stated.rate if fps is None else Fraction(fps)
        self._base = stated.base  # s: of a time stamp's unit
        if fps is not None and (usual := usual_interval(self._decoder.numbers)):
            self._base = 1 / (Fraction(fps) * usual)
        self._clock = Clock(1 / (rate or Fraction(1)))
        self._size = (first.stored.width, first.stored.height)
        mirrored, self._tilt = _display(first.stored)
        self._slack = stated.slack or 2 / float(rate or 1)
        self._closed = False
        self._delivered = 0
        self._end: float | None = None  # time of the last frame, once all are through
        self._notes = Notes()
        rotation = round(self._tilt / 90) * 90 % 360
        width, height = self._size if rotation in (0, 180) else self._size[::-1]
        duration = None if stated.duration is None else stated.duration * float(self._base / stated.base)
        known = "container" if stated.rate else None
        self.info = VideoInfo(
            path, width, height, float(rate or math.nan), "given" if fps is not None else known,
            stated.count or (None if duration is None or rate is None else round(duration * rate)), duration, mirrored,
            rotation, stated.codec,
        )  # fmt: skip

    def close(self) -> None:
        self._closed = True
        self._pictures.close()
        self._decoder.close()

    def frames(self) -> Iterator[Frame]:
        """All frames, once."""
        picture, self._first = self._first, None
        time = 0.0
        while picture is not None:
            self._clock.skip(picture.lost)
            time = self._clock.tick(None if picture.stamp is None else picture.stamp * self._base)
            time = math.nan if self.info.rate_from is None else time
            stored, intact = picture.stored, picture.intact and not picture.odd
            if not intact:
                self._notes.add(_ODD if picture.odd else _SMEARED, time)
            if (stored.width, stored.height) != self._size:
                self._notes.add(_RESIZED, time)
            self._delivered += 1
            yield Frame(self._delivered - 1, time, intact, stored, self._size, self.info.mirrored, self.info.rotation)
            if self._closed:
                raise VideoError(
                    f"'{self.info.path}' was closed before its last frame; read it within its `with` block"
                )
            picture = next(self._pictures, None)
        self._end = time

    def notes(self) -> list[str]:
        """A sentence for each thing that a person should know; complete after the last frame."""
        notes, stated = list(self._decoder.notes), self._decoder.stated
        shape, camera = stated.pixel_shape, stated.camera_rate
        if shape and shape != 1:
            shape = f"{shape.numerator}:{shape.denominator}"
            notes.append(f"the pixels aren't square ({shape}); lengths are distorted")
        if camera and self.info.rate_from == "container" and abs(camera / self.info.fps - 1) > SAME_RATE:
            notes.append(
                f"the camera says that it took {camera:g} frames per second, and the film plays {self.info.fps:.4g}: "
                f"give --fps {camera:g} if its motion is slower or quicker than it was"
            )
        if self.info.mirrored:
            notes.append("the file asks for mirrored pictures; shown so, as players show them")
        if self._tilt % 90:
            notes.append(f"the file asks for a turn of {self._tilt} degrees; turned by {self.info.rotation}")
        times = [self._clock.place(stamp * self._base) for stamp in sorted(self._decoder.left_out)]
        early, lost = sum(time < 0 for time in times), Notes()
        for time in times[early:]:
            lost.add("{frames} broken and left out, {when}", time)
        if early:
            notes.append(f"{frames(early)} before the first whole one left out")
        if self._decoder.unstamped:
            notes.append(f"{frames(self._decoder.unstamped)} broken and left out")
        notes += lost.lines()
        said, end = self.info.duration, self._end
        if end is not None and said is not None and end + 1 / self.info.fps < said - self._slack:
            notes.append(f"the video ends early: the file says {said:.3f} s, the last frame is at {end:.3f} s")
        return [*notes, *self._clock.notes(), *self._notes.lines()]


def _begun(path: Path, threads: int) -> tuple[Decoder | Pictures, Generator[Picture], Picture]:
    """A film whose first picture is there, which comes last."""
    if path.is_dir() or is_pattern(path):
        decoder = Pictures(path)
    else:
        decoder = Decoder(path, threads)
        if decoder.is_picture:
            decoder.close()
            decoder = Pictures(path)
    pictures = decoder.pictures()
    if isinstance(decoder, Decoder) and decoder.stated.codec not in REPORTED:
        pictures = marked(pictures)
    try:
        first = next(pictures, None)
        if first is None:
            raise VideoError(too_large(path))
    except VideoError:
        decoder.close()
        raise
    return decoder, pictures, first


def _unknown_rate(path: Path) -> str:
    return (
        f"nothing in '{path}' states how many frames per second the camera took; give them with --fps RATE, such as "
        f"--fps 60"
    )


def _no_film(path: Path) -> str:
    pattern = pattern_of(path)
    such = f", which is '{path.with_name(pattern)}'" if pattern else ""
    return (
        f"'{path}' has one frame only; for a film of single pictures give their folder or the pattern of their names"
        f"{such}"
    )


def _display(stored: VideoFrame) -> tuple[bool, int]:
    """Mirroring left for right of a picture, and its clockwise turn after that [degrees]."""
    data = stored.side_data.get("DISPLAYMATRIX")
    if data is None:
        return False, 0
    # ISO/IEC 14496-12: x' = a x + c y, y' = b x + d y, with y down
    (a, b), (c, d) = np.frombuffer(data, dtype=np.int32).reshape(3, 3)[:2, :2].astype(float)
    mirrored = bool(a * d < b * c)
    return mirrored, round(math.degrees(math.atan2(-b, -a) if mirrored else math.atan2(b, a))) % 360


def _in_time(work: Callable[[], Result], seconds: float) -> Result:
    """Calls a function and returns its result, or raises its error.

    Raises:
        TimeoutError: It takes longer [s]; it is left to itself then, in a thread of its own.
    """
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name="first picture", daemon=True).start()
    return future.result(seconds)
