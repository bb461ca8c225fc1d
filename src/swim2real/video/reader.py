"""Reads videos frame by frame: upright pictures, times from time stamps, and notes on what is wrong with the file."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Self, TypeVar

import numpy as np
from av import VideoFrame
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from swim2real.errors import VideoError
from swim2real.video.clock import Clock, Tally, frames
from swim2real.video.damage import REPORTED, marked
from swim2real.video.decoding import FIRST_PICTURE, MOST_PIXELS, Decoder, Picture, no_picture

Image = NDArray[np.uint8]
Result = TypeVar("Result")

USUAL_RATE = Fraction(30)  # frames per second, where a file doesn't say
ROUNDING = 5e-4  # s, of a time that a person gives
SLACK = 5.0  # s beyond FIRST_PICTURE that a film has which is read, but gives no picture
MOST_BYTES = 256 << 20  # of decoded frames that are kept at a time
_BYTES = 1.5  # of a pixel, as it is decoded
SOUND_SLACK = 0.5  # s by which sound may outlast the pictures


@dataclass(frozen=True)
class VideoInfo:
    """What a file states about itself.

    Attributes:
        path: Path of the file.
        width: Width of the upright picture [px].
        height: Height of the upright picture [px].
        fps: Mean number of frames per second.
        frame_count: Number of frames as the file states it, or from its duration; None if it states neither.
        duration: Duration as the file states it [s]; None if it doesn't.
        rotation: Angle by which stored pictures are turned clockwise to be upright [degrees]: 0, 90, 180 or 270.
        codec: Name of the codec, such as `h264`.
    """

    path: Path
    width: int
    height: int
    fps: float
    frame_count: int | None
    duration: float | None
    rotation: int
    codec: str


@dataclass(frozen=True)
class Frame:
    """One frame. Its picture is converted when it is asked for; a frame that is kept keeps its picture in memory.

    Attributes:
        index: Number of the frame among those that are delivered, from 0.
        time: Time since the first frame, strictly rising [s].
        intact: False after a broken frame, up to the next key frame: the picture may be smeared, since it was
            predicted from one that isn't there. False also where a picture looks damaged.
    """

    index: int
    time: float
    intact: bool
    _stored: VideoFrame = field(repr=False, compare=False)
    _size: tuple[int, int] = field(repr=False, compare=False)  # of the stored picture: width, height
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
        return np.rot90(np.asarray(stored, dtype=np.uint8), -(self._rotation // 90))


class VideoReader:
    """Frames of a video, one after the other, in constant memory. A context manager.

    Iterating again starts at the first frame. Broken frames are left out; `notes` says which.

    Attributes:
        info: What the file states about itself.
    """

    info: VideoInfo

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        """Opens the video and decodes its first frame.

        Args:
            path: Path of the video.
            threads: Number of threads that decode; 0 for as many as the machine has cores.

        Raises:
            VideoError: The file can't be read, or not one frame can be decoded.
        """
        if threads < 0:
            raise VideoError(f"threads is {threads}; it must be 0 (as many as there are cores) or more")
        self._pass = _Pass(Path(path), threads)
        self._threads = threads
        self._used = self._closed = False
        self.info = self._pass.info

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
            self._pass = _Pass(self.info.path, self._threads)
        self._used = True
        return self._pass.frames()

    @property
    def notes(self) -> list[str]:
        """A sentence for each thing that a person should know; complete after the last frame."""
        return self._pass.notes()


def first_frame(path: str | Path, since: float = 0.0) -> Frame:
    """The first frame of a video, or the first from a time on.

    Args:
        path: Path of the video.
        since: Time since its first frame, to a millisecond [s].

    Raises:
        VideoError: The file can't be read, not one frame can be decoded, or it ends before that time.
    """
    with VideoReader(path, threads=1) as reader:
        last = 0.0
        for frame in reader:
            if frame.time >= since - ROUNDING:
                return frame
            last = frame.time
    raise VideoError(f"'{path}' ends at {last:.3f} s; there is no frame from {since:g} s on")


def frames_backwards(path: str | Path, first: int, last: int, threads: int = 0) -> Iterator[Frame]:
    """Frames of a video in reverse order.

    A video is decoded forward only, so it is read several times, up to the end of one part after the other: of 1000
    frames of 1080p each is decoded six times on average.

    Args:
        path: Path of the video.
        first: Number of the frame that comes last.
        last: Number of the frame that comes first.
        threads: Number of threads that decode; 0 for as many as the machine has cores.

    Raises:
        VideoError: The file can't be read.
    """
    with VideoReader(path, threads) as reader:
        part = max(1, int(MOST_BYTES / (_BYTES * reader.info.width * reader.info.height)))
        while last >= first:
            begin = max(first, last - part + 1)
            kept = [frame for frame in islice(reader, last + 1) if begin <= frame.index <= last]
            yield from reversed(kept)
            last = begin - 1


class _Pass:
    """One pass through a video, from its first frame to its last.

    Attributes:
        info: What the file states about itself.
    """

    info: VideoInfo

    def __init__(self, path: Path, threads: int) -> None:
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
        stream, container = self._decoder.stream, self._decoder.container
        rate = stream.average_rate or stream.guessed_rate or USUAL_RATE
        self._clock = Clock(1 / rate)
        stored = self._first.stored
        self._size = (stored.width, stored.height)
        self._tilt = -stored.rotation % 360  # clockwise; PyAV's angle isn't
        self._base = stream.time_base or Fraction(1)
        self._pixel_shape = stream.sample_aspect_ratio
        self._slack = SOUND_SLACK if len(container.streams) > 1 else float(2 / rate)
        self._stated_count = _stated_count(container, stream)
        self._closed = False
        self._delivered = 0
        self._end: float | None = None  # time of the last frame, once all are through
        self._smeared, self._odd = Tally(), Tally()
        self._resized = Tally()
        self.info = self._describe(path, rate, stream)

    def close(self) -> None:
        self._closed = True
        self._pictures.close()
        self._decoder.container.close()

    def frames(self) -> Iterator[Frame]:
        """All frames, once."""
        picture, self._first = self._first, None
        time = 0.0
        while picture is not None:
            for _ in range(picture.lost):
                self._clock.skip()
            time = self._clock.tick(None if picture.stamp is None else picture.stamp * self._base)
            stored, intact = picture.stored, picture.intact and not picture.odd
            if (stored.width, stored.height) != self._size:
                self._resized.add(time)
            if picture.odd:
                self._odd.add(time)
            elif not intact:
                self._smeared.add(time)
            self._delivered += 1
            yield Frame(self._delivered - 1, time, intact, stored, self._size, self.info.rotation)
            if self._closed:
                raise VideoError(
                    f"'{self.info.path}' was closed before its last frame; read it within its `with` block"
                )
            picture = next(self._pictures, None)
        self._end = time

    def notes(self) -> list[str]:
        """A sentence for each thing that a person should know; complete after the last frame."""
        notes: list[str] = []
        if self._pixel_shape and self._pixel_shape != 1:
            shape = f"{self._pixel_shape.numerator}:{self._pixel_shape.denominator}"
            notes.append(f"the pixels aren't square ({shape}); lengths are distorted")
        if self._tilt % 90:
            notes.append(f"the file asks for a turn of {self._tilt} degrees; turned by {self.info.rotation}")
        times = [self._clock.place(stamp * self._base) for stamp in sorted(self._decoder.left_out)]
        early, lost = sum(time < 0 for time in times), Tally()
        for time in times[early:]:
            lost.add(time)
        if early:
            notes.append(f"{frames(early)} before the first whole one left out")
        notes += lost.note("broken and left out")
        if self._decoder.unstamped:
            notes.append(f"{frames(self._decoder.unstamped)} broken and left out")
        notes += self._smeared.note("after a broken one may be smeared")
        notes += self._odd.note("that may be damaged, by what they show")
        if self._decoder.failure:
            notes.append(self._decoder.failure)
        notes += [*self._end_notes(), *self._clock.notes()]
        return notes + self._resized.note("of another size", "; scaled to that of the first")

    def _end_notes(self) -> list[str]:
        if self._end is None:
            return []
        decoder = self._decoder
        count = self._delivered + len(decoder.left_out) + decoder.unstamped + decoder.hidden
        if self._stated_count:
            if count < self._stated_count:
                return [f"the video ends early: the file says {frames(self._stated_count)}, {count} came"]
            return []
        duration = self.info.duration
        if duration is not None and self._end + 1 / self.info.fps < duration - self._slack:
            return [f"the video ends early: the file says {duration:.3f} s, the last frame is at {self._end:.3f} s"]
        return []

    def _describe(self, path: Path, rate: Fraction, stream: VideoStream) -> VideoInfo:
        duration: float | None = None
        if stream.duration is not None:
            duration = float(stream.duration * self._base)
        elif self._decoder.container.duration is not None:
            duration = self._decoder.container.duration / 1e6  # FFmpeg counts microseconds there
        rotation = round(self._tilt / 90) * 90 % 360
        width, height = self._size if rotation in (0, 180) else self._size[::-1]
        count = self._stated_count or (None if duration is None else round(duration * rate))
        codec = stream.codec_context.codec.canonical_name
        return VideoInfo(path, width, height, float(rate), count, duration, rotation, codec)


def _begun(path: Path, threads: int) -> tuple[Decoder, Generator[Picture], Picture]:
    """A film whose first picture is there, which comes last."""
    decoder = Decoder(path, threads)
    pictures = decoder.pictures()
    if decoder.stream.codec_context.codec.canonical_name not in REPORTED:
        pictures = marked(pictures)
    try:
        first = next(pictures, None)
        if first is None:
            raise VideoError(
                f"not one frame of '{path}' can be decoded; it is cut off or damaged, or its pictures have more than "
                f"{MOST_PIXELS // 10**6} million pixels"
            )
    except VideoError:
        decoder.container.close()
        raise
    return decoder, pictures, first


def _in_time(work: Callable[[], Result], seconds: float) -> Result:
    """What a function returns, or raises.

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


def _stated_count(container: InputContainer, stream: VideoStream) -> int:
    """Number of frames that the file states; 0 if it doesn't."""
    if "mp4" in container.format.name:  # what an edit list cuts away isn't in the index
        return min(stream.frames, len(stream.index_entries))
    return stream.frames
