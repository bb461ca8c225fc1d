"""Any frame of a film by its number, without decoding those long before it."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from av import VideoFrame
from av.error import FFmpegError

from markertrack.video.decoding import open_stream
from markertrack.video.reader import Frame, first_frame
from swimbase.errors import VideoError

_NEAR = 24  # frames ahead that are decoded rather than sought
_KEPT = 8  # decoded frames, for those that are asked for beside one another


class SeekableFilm:
    """A film whose frames can be had in any order, numbered as `VideoReader` numbers those of an intact film.

    Attributes:
        times: Times of the frames since the first [s].
        fps: Mean number of frames per second.
        size: Width and height of the upright picture [px].
    """

    def __init__(self, path: Path, threads: int = 0) -> None:
        """Reads the time stamps of all frames, and decodes none but the first.

        Args:
            path: Path of the video.
            threads: Number of threads that decode; 0 for as many as the machine has cores.

        Raises:
            VideoError: The file can't be read, or has no time stamps.
        """
        self._first = first_frame(path)
        self._path, self._threads = path, threads
        container, stream = open_stream(path, 1)
        with container:
            packets = (packet for packet in container.demux(stream) if packet.size and not packet.is_discard)
            try:
                self._stamps = sorted({packet.pts for packet in packets if packet.pts is not None})
            except FFmpegError as error:
                raise VideoError(f"'{path}' can't be read to its end ({error.strerror}); copy it again") from None
            unit = float(stream.time_base or 0)
        if len(self._stamps) < 2:
            raise VideoError(f"'{path}' has no time stamps by which a frame is found; convert it to MP4")
        self.times = [(stamp - self._stamps[0]) * unit for stamp in self._stamps]
        self.fps = (len(self.times) - 1) / self.times[-1]
        height, width, _ = self._first.image.shape
        self.size = width, height
        self._open()

    def _open(self) -> None:
        self._container, self._stream = open_stream(self._path, self._threads)
        self._stream.thread_type = "AUTO"
        self._next, self._pictures = 0, self._decoded()
        self._recent: dict[int, VideoFrame] = {}

    def _decoded(self) -> Iterator[VideoFrame]:
        try:
            yield from self._container.decode(self._stream)
        except FFmpegError:
            return

    def close(self) -> None:
        self._container.close()

    def frame(self, number: int) -> Frame:
        """A frame by its number.

        Raises:
            VideoError: There is none of this number, or it is broken.
        """
        stamp = self._stamp(number)
        if stamp not in self._recent and not self._next <= number < self._next + _NEAR:
            self._container.seek(stamp, stream=self._stream)
            self._pictures = self._decoded()
        while stamp not in self._recent and (stored := next(self._pictures, None)) is not None:
            if stored.pts is not None:
                self._recent[stored.pts] = stored
            if len(self._recent) > _KEPT:
                del self._recent[next(iter(self._recent))]
            if stored.pts is not None and stored.pts >= stamp:
                self._next = number + 1
                break
        if stamp in self._recent:
            return self._taken(self._recent[stamp], number)
        raise self._broken(number)

    def key_frame(self, number: int) -> Frame:
        """The key frame at or before a frame, from which that one would be decoded: at once, whatever lies between.

        Raises:
            VideoError: There is no frame of this number, or the key frame is broken.
        """
        stamp, decoder = self._stamp(number), self._stream.codec_context
        self._container.seek(stamp, stream=self._stream)
        self._next = len(self._stamps)  # after which the next frame is sought
        try:
            packet = next(packet for packet in self._container.demux(self._stream) if packet.is_keyframe)
            stored = [*packet.decode(), *decoder.decode(None)][0]  # pyright: ignore[reportUnknownMemberType]
        except (StopIteration, IndexError, FFmpegError):
            raise self._broken(number) from None
        decoder.flush_buffers()
        return self._taken(stored, bisect(self._stamps, stored.pts or 0) - 1)

    def _stamp(self, number: int) -> int:
        if not 0 <= number < len(self._stamps):
            raise VideoError(f"'{self._path}' has frames 0 to {len(self._stamps) - 1}, and none of number {number}")
        return self._stamps[number]

    def _taken(self, stored: VideoFrame, number: int) -> Frame:
        return replace(self._first, index=number, time=self.times[number], _stored=stored)

    def _broken(self, number: int) -> VideoError:
        self.close()
        self._open()
        return VideoError(f"frame {number} of '{self._path}' can't be decoded; it may be damaged")
