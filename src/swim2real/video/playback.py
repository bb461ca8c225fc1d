"""One run through a video: frames with their times, and what a person should know of the file."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from swim2real.errors import VideoError
from swim2real.video.clock import Clock, Tally, frames
from swim2real.video.decoder import Decoder
from swim2real.video.frame import Frame, VideoInfo
from swim2real.video.opening import open_stream

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.stream import VideoStream

USUAL_RATE = Fraction(30)  # frames a second, where a file doesn't say
SOUND_SLACK = 0.5  # s by which sound may outlast the pictures


class Playback:
    """Runs through a video once.

    Attributes:
        info: What the file says about itself.
    """

    info: VideoInfo

    def __init__(self, path: Path, threads: int) -> None:
        """Opens the file and decodes the first frame.

        Raises:
            VideoError: It can't be read, or not one frame can be decoded.
        """
        self._container, stream = open_stream(path, threads)
        rate = stream.average_rate or stream.guessed_rate or USUAL_RATE
        self._clock = Clock(1 / rate)
        self._decoder = Decoder(self._container, stream)
        self._pictures = self._decoder.pictures()
        self._first = next(self._pictures, None)
        if self._first is None:
            self._container.close()
            raise VideoError(f"not one frame of '{path}' can be decoded; it is cut off or damaged")
        stored = self._first.stored
        self._size = (stored.width, stored.height)
        self._tilt = -stored.rotation % 360  # clockwise; PyAV's angle isn't
        self._base = stream.time_base or Fraction(1)
        self._pixel_shape = stream.sample_aspect_ratio
        self._slack = SOUND_SLACK if len(self._container.streams) > 1 else float(2 / rate)
        self._promised = _promised(self._container, stream)
        self._closed = False
        self._delivered = 0
        self._end: float | None = None  # time of the last frame, once all are through
        self._smeared = Tally()
        self._resized = Tally()
        self.info = self._describe(path, rate, stream)

    def close(self) -> None:
        self._closed = True
        self._pictures.close()
        self._container.close()

    def frames(self) -> Iterator[Frame]:
        """All frames, once."""
        picture, self._first = self._first, None
        time = 0.0
        while picture is not None:
            for _ in range(picture.lost):
                self._clock.skip()
            time = self._clock.tick(self._seconds(picture.stamp))
            stored, intact = picture.stored, picture.intact
            if (stored.width, stored.height) != self._size:
                self._resized.add(time)
            if not intact:
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
        notes = [*self._shape_notes(), *self._loss_notes(), *self._clock.notes()]
        if self._resized.count:
            notes.append(
                f"{frames(self._resized.count)} of another size, {self._resized.when}; scaled to that of the first"
            )
        return notes

    def _shape_notes(self) -> list[str]:
        notes: list[str] = []
        shape = self._pixel_shape
        if shape and shape != 1:
            notes.append(f"the pixels aren't square ({shape.numerator}:{shape.denominator}); lengths are distorted")
        if self._tilt % 90:
            notes.append(f"the file asks for a turn of {self._tilt} degrees; turned by {self.info.rotation}")
        return notes

    def _loss_notes(self) -> list[str]:
        notes: list[str] = []
        early, lost = 0, Tally()
        for stamp in sorted(self._decoder.left_out):
            time = self._clock.place(stamp * self._base)
            if time < 0:
                early += 1
            else:
                lost.add(time)
        if early:
            notes.append(f"{frames(early)} before the first whole one left out")
        if lost.count:
            notes.append(f"{frames(lost.count)} broken and left out, {lost.when}")
        if self._decoder.unstamped:
            notes.append(f"{frames(self._decoder.unstamped)} broken and left out")
        if self._smeared.count:
            notes.append(f"{frames(self._smeared.count)} after a broken one may be smeared, {self._smeared.when}")
        if self._decoder.failure:
            notes.append(self._decoder.failure)
        return notes + self._end_notes()

    def _end_notes(self) -> list[str]:
        if self._end is None:
            return []
        decoder = self._decoder
        found = self._delivered + len(decoder.left_out) + decoder.unstamped + decoder.hidden
        if self._promised:
            if found < self._promised:
                return [f"the video ends early: the file says {frames(self._promised)}, {found} came"]
            return []
        duration = self.info.duration
        if duration is not None and self._end + 1 / self.info.fps < duration - self._slack:
            return [f"the video ends early: the file says {duration:.3f} s, the last frame is at {self._end:.3f} s"]
        return []

    def _seconds(self, stamp: int | None) -> Fraction | None:
        return None if stamp is None else stamp * self._base

    def _describe(self, path: Path, rate: Fraction, stream: VideoStream) -> VideoInfo:
        duration: float | None = None
        if stream.duration is not None:
            duration = float(stream.duration * self._base)
        elif self._container.duration is not None:
            duration = self._container.duration / 1e6  # FFmpeg counts microseconds there
        rotation = round(self._tilt / 90) * 90 % 360
        width, height = self._size if rotation in (0, 180) else self._size[::-1]
        count = self._promised or (None if duration is None else round(duration * rate))
        codec = stream.codec_context.codec.canonical_name
        return VideoInfo(path, width, height, float(rate), count, duration, rotation, codec)


def _promised(container: InputContainer, stream: VideoStream) -> int:
    """Frames that the file says it has; 0 where it doesn't."""
    if "mp4" in container.format.name:  # what an edit list cuts away isn't in the index
        return min(stream.frames, len(stream.index_entries))
    return stream.frames
