"""Opens a video file and decodes its stream; broken pictures are left out, and those that depend on them are marked.

A rate that nothing in the film states is made up by FFmpeg: the choice is given to it, so that it is recognized.

A file may come from anywhere. FFmpeg reads it and no other: formats that name other files or addresses aren't opened,
and sizes and counts that no camera has are refused before a picture is decoded.
"""

from __future__ import annotations

import re
import stat
import time
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av import VideoFrame
from av.container import InputContainer
from av.error import ArgumentError, ExitError, FFmpegError
from av.packet import Packet
from av.stream import Disposition
from av.video.stream import VideoStream

from swimbase.errors import VideoError

TOP_BOXES = {b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"}  # with which MP4 and QuickTime files begin
FORMATS = (  # films and pictures, each whole in one file
    "mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts", "mpeg", "mpegvideo", "m4v", "h264",
    "hevc", "obu", "av1", "ivf", "vc1", "h263", "mjpeg", "flv", "asf", "ogg", "nut", "mxf", "dv", "wtv", "gif", "apng",
    "yuv4mpegpipe", "cine", "dhav", "image2", "png_pipe", "jpeg_pipe", "tiff_pipe", "bmp_pipe", "webp_pipe",
    "wav",  # so that sound is reported as such
)  # fmt: skip
MOST_PIXELS = 40_000_000  # of a picture: 8K has 33 million
MOST_STREAMS = 32
FIRST_PICTURE = 20.0  # s until the first picture is there, at most
MADE_UP = Fraction(100, 101)  # frames per second, which no film has
_OPTIONS = {
    "framerate": str(MADE_UP),
    "default_delay": str(100 / MADE_UP),  # of GIF, in 1/100 s
    "min_delay": "1",
    "format_whitelist": ",".join(FORMATS),
    "protocol_whitelist": "file",
    "enable_drefs": "0",  # QuickTime's references to other files
    "pattern_type": "none",  # a % or * in a picture's name is no pattern of other names
    "max_streams": str(MOST_STREAMS + 1),
    "max_pixels": str(MOST_PIXELS),
}
# since PyAV 19 this is so; before, text in another encoding was an error
_TEXTS: Any = {} if int(av.__version__.split(".")[0]) > 18 else {"metadata_errors": "surrogateescape"}
SOUND_SLACK = 0.5  # s by which sound may outlast the pictures
MOST_HELD = 16  # pictures that may wait for one that is shown later, as many as H.264 and HEVC can refer to


def open_stream(path: Path, threads: int) -> tuple[InputContainer, VideoStream]:
    """Opens a file and its best video stream, ready to decode.

    Args:
        path: Path of the video.
        threads: Number of threads that decode; 0 for as many as the machine has cores.

    Raises:
        VideoError: The file isn't there, is no file or no video, is cut off, goes beyond a limit, or there is no
            decoder for it.
    """
    if not path.exists():
        raise VideoError(f"no video '{path}'; check the path")
    if not stat.S_ISREG(path.stat().st_mode):
        raise VideoError(f"'{path}' is a device, a pipe or a socket; give the path of a video file")
    if path.stat().st_size == 0:
        raise VideoError(f"'{path}' is empty (0 bytes); copy it again")
    try:
        container = av.open(str(path.absolute()), options=_OPTIONS, timeout=FIRST_PICTURE, **_TEXTS)
    except FFmpegError as error:
        raise VideoError(_unopened(path, error)) from None
    try:
        return container, _video_stream(container, path, threads)
    except VideoError:
        container.close()
        raise


def _unopened(path: Path, error: FFmpegError) -> str:
    """Why FFmpeg doesn't open a file, in a sentence."""
    if isinstance(error, PermissionError):
        return f"'{path}' can't be read: permission denied"
    if isinstance(error, ExitError):
        return no_picture(path)
    if isinstance(error, ArgumentError):
        return (
            f"'{path}' is not a video in a format that is read; playlists, texts and whatever else names other files "
            f"aren't: give the film itself, or convert it to MP4 with H.264"
        )
    with path.open("rb") as file:
        if file.read(8)[4:] in TOP_BOXES:
            return (
                f"'{path}' ends before its index (the 'moov' box): the recording or the copy was cut off or goes on; "
                f"copy it again, or repair it with a tool that has an intact video of the same camera"
            )
    return f"'{path}' is not a video that FFmpeg can read ({error.strerror})"


def _video_stream(container: InputContainer, path: Path, threads: int) -> VideoStream:
    if len(container.streams) > MOST_STREAMS:
        raise VideoError(
            f"'{path}' has more than {MOST_STREAMS} streams of pictures, sound and data; give a film with its pictures "
            f"alone"
        )
    stream, cover = container.streams.best("video"), Disposition.attached_pic  # of a sound file
    if not isinstance(stream, VideoStream) or stream.disposition & cover:
        held = ", ".join(sorted({other.type for other in container.streams}))
        what = f", only {held}" if held else ""
        raise VideoError(f"'{path}' has no video in it{what}; if it had one, it was cut off: copy it again")
    # without a decoder PyAV has no codec context, whatever its stubs say
    if getattr(stream, "codec_context", None) is None:
        raise VideoError(f"no decoder for the video in '{path}'; convert it to H.264, for example")
    stream.codec_context.options = {"max_pixels": _OPTIONS["max_pixels"]}  # of those that change their size, too
    # within a picture only: one that is decoded beside the next can be handed out before its holes are reported
    stream.thread_type = "SLICE"
    stream.thread_count = threads
    return stream


def too_large(path: Path) -> str:
    """A sentence that there is no picture, or none that may be decoded."""
    return (
        f"not one frame of '{path}' can be decoded; it is cut off or damaged, or its pictures have more than "
        f"{MOST_PIXELS // 10**6} million pixels"
    )


def no_picture(path: Path) -> str:
    """A sentence that the first picture takes too long."""
    return (
        f"no picture of '{path}' came within {FIRST_PICTURE:g} s; the file is damaged, or the disk or the network "
        f"that it is on doesn't answer: copy it to a disk of this machine"
    )


@dataclass(frozen=True)
class Stated:
    """Statements of a film about itself.

    Attributes:
        base: Unit of its time stamps [s].
        rate: Mean number of frames per second; None where nothing states it.
        count: Number of frames; 0 where it isn't stated.
        duration: Duration [s]; None where it isn't stated.
        slack: What the duration may have beyond the last frame [s].
        codec: Name of the codec.
        pixel_shape: Width of a pixel over its height; None or 0 where it isn't stated.
        counted: Whether there are no time stamps, so that pictures are only counted; FFmpeg's are made up then.
        camera_rate: Frames per second that the camera says it took; None where it says nothing.
    """

    base: Fraction
    rate: Fraction | None
    count: int
    duration: float | None
    slack: float
    codec: str
    pixel_shape: Fraction | None = None
    counted: bool = False
    camera_rate: float | None = None


def _stated(container: InputContainer, stream: VideoStream) -> Stated:
    mean, base = (Fraction(value) if value else None for value in (stream.average_rate, stream.time_base))
    rate = stream.codec_context.framerate if mean == MADE_UP else mean or stream.guessed_rate
    # what FFmpeg makes up of stamps for frames of AVI that are stored out of order is wrong
    counted = mean == MADE_UP or (container.format.name == "avi" and stream.codec_context.has_b_frames)
    duration = float(stream.duration * base) if base and stream.duration is not None and mean != MADE_UP else None
    if duration is None and container.duration is not None and mean != MADE_UP:
        duration = container.duration / 1e6  # FFmpeg counts microseconds there
    if stream.frames and rate and "mp4" not in container.format.name:  # whose edit lists leave some out
        duration = max(duration or 0.0, stream.frames / float(rate))
    return Stated(
        base or Fraction(1), Fraction(rate) if rate else None, stream.frames, duration,
        SOUND_SLACK if len(container.streams) > 1 else 0.0, stream.codec_context.codec.canonical_name,
        stream.sample_aspect_ratio, bool(counted), _camera_rate({**container.metadata, **stream.metadata}),
    )  # fmt: skip


def _camera_rate(texts: dict[str, str]) -> float | None:
    """The rate that a camera wrote beside its film, such as Android's `com.android.capture.fps`."""
    for key, text in texts.items():
        if re.search(r"capture.*(fps|rate)", key, re.IGNORECASE):
            with suppress(ValueError):
                return float(text) or None
    return None


def usual_interval(stamps: Sequence[int]) -> Fraction | None:
    """Mean interval between rising stamps, without those at gaps; None where there is none."""
    steps = np.diff(np.unique(np.array(stamps, dtype=np.int64)))
    usual = steps[abs(steps - np.median(steps)) < 0.5 * np.median(steps)] if len(steps) else steps
    return Fraction(int(usual.sum()), len(usual)) if len(usual) else None


@dataclass(frozen=True)
class Picture:
    """A decoded picture.

    Attributes:
        stored: Picture as it is stored: not turned, in the camera's colors.
        stamp: Time stamp in units of the stream's time base; None if the file has none.
        intact: Whether all pictures since the last key frame that are stored before this one are whole.
        lost: Number of pictures without a stamp that were left out just before.
        odd: Whether it looks damaged although the decoder reports nothing.
    """

    stored: VideoFrame
    stamp: int | None
    intact: bool
    lost: int
    odd: bool = False


class Decoder:
    """Decodes one stream from its beginning to its end.

    What is broken shows in two ways: the decoder conceals a hole in a picture and says so, or a packet never becomes a
    picture. Pictures come out in another order than packets go in, so the stamps tell which packets those are. A
    picture can lean on one that is stored before it and shown after it; it waits until that one has come.

    Attributes:
        stated: What the file states of itself.
        left_out: Stamps of the pictures that are left out, as keys.
        unstamped: Number of pictures without a stamp that are left out.
        notes: A sentence for each thing that a person should know.
    """

    def __init__(self, path: Path, threads: int) -> None:
        """Opens a file, as `open_stream` does."""
        self._container, self._stream = open_stream(path, threads)
        self._path = path
        self.stated = _stated(self._container, self._stream)
        self._stamped = not self.stated.counted
        self._packet = 0  # number of the newest packet, in the order of storage
        self._waiting: dict[int, int] = {}  # stamps of packets that haven't become pictures: numbers
        self._held: deque[tuple[int, VideoFrame, int | None]] = deque()  # pictures in the order of showing
        self._broken: dict[int, int | None] = {}  # numbers and stamps of the broken packets that can still matter
        self._lost = 0
        self._until: float | None = time.monotonic() + FIRST_PICTURE  # None once there is a picture
        self.left_out: dict[int, None] = {}
        self.unstamped = 0
        self.notes: list[str] = []

    def close(self) -> None:
        self._container.close()

    @property
    def is_picture(self) -> bool:
        """True if the file is a single picture, which Pillow reads better."""
        return self._container.format.name == "image2" or self._container.format.name.endswith("_pipe")

    @property
    def numbers(self) -> list[int]:
        """The stamps of all frames, for which the file is read once more; none where they are only counted."""
        if not self._stamped:
            return []
        container, stream = open_stream(self._path, 1)
        found: list[int] = []
        with container, suppress(FFmpegError):
            found.extend(packet.pts for packet in container.demux(stream) if packet.pts is not None)
        return found

    def pictures(self) -> Generator[Picture]:
        """All that is fit to be seen, in the order of showing.

        Raises:
            VideoError: The first picture takes too long.
        """
        for packet in self._packets():
            if self._until is not None and time.monotonic() > self._until:
                raise VideoError(no_picture(self._path))
            for stored in self._decode(packet):
                self._until = None
                stamp = stored.pts if self._stamped else None
                number = self._settle(stamp)
                if stored.is_corrupt:
                    self._leave_out(stamp, number)
                else:
                    self._held.append((number, stored, stamp))
                del stored
                yield from self._release()
        for stamp, number in self._waiting.items():
            self._leave_out(stamp, number)
        self._waiting.clear()
        yield from self._release()

    def _packets(self) -> Iterator[Packet[VideoStream]]:
        try:
            yield from self._container.demux(self._stream)
        except FFmpegError as error:
            self.notes.append(f"reading stopped before the end ({error.strerror})")

    def _decode(self, packet: Packet[VideoStream]) -> list[VideoFrame]:
        self._packet += 1
        stamp = packet.pts if self._stamped else None
        if stamp is not None and packet.size and not packet.is_discard:
            self._waiting[stamp] = self._packet
        try:
            # the decoder's complaint about a packet that is cut off could cost whole pictures
            pictures = [] if packet.is_corrupt else packet.decode()
        except FFmpegError:
            pictures = None
        if stamp is None and (pictures is None or packet.is_corrupt):
            self._leave_out(None, self._packet)
        return pictures or []

    def _settle(self, stamp: int | None) -> int:
        """A picture has come out: those that should have come before it are lost. The number of its packet."""
        if stamp is None:
            self._waiting.clear()
            return self._packet
        number = self._waiting.pop(stamp, self._packet)
        self.left_out.pop(stamp, None)
        for late in [other for other in self._waiting if other < stamp]:
            self._leave_out(late, self._waiting.pop(late))
        return number

    def _release(self) -> Iterator[Picture]:
        """Pictures for which all that is stored before them is known."""
        while self._held:
            number = self._held[0][0]
            if len(self._held) <= MOST_HELD and any(other < number for other in self._waiting.values()):
                return
            _, stored, stamp = self._held.popleft()
            if stored.key_frame:  # nothing that is shown after it leans on what is shown before it
                for other, late in list(self._broken.items()):
                    if (other < number) if stamp is None or late is None else (late < stamp):
                        del self._broken[other]
            intact = not any(other < number for other in self._broken)
            lost, self._lost = self._lost, 0
            picture = Picture(stored, stamp, intact, lost)
            del stored
            yield picture

    def _leave_out(self, stamp: int | None, number: int) -> None:
        self._broken[number] = stamp
        if stamp is None:
            self._lost += 1
            self.unstamped += 1
        else:
            self.left_out[stamp] = None
