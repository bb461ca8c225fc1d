"""Writes videos that browsers and phones play."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Self, cast

import av
import numpy as np
from av import VideoFrame
from av.error import FFmpegError
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray

from swimbase.errors import VideoError
from swimbase.store import PART, reason

FORMATS = {".mp4": "mp4", ".mov": "mov", ".m4v": "mp4", ".mkv": "matroska", ".avi": "avi", ".ts": "mpegts"}
QUICKTIME = (".mp4", ".m4v", ".mov")
ENCODERS = {"h264": "libx264", "hevc": "libx265", "mjpeg": "mjpeg"}
PRESET = "veryfast"  # of x264 and x265: a third of the time of their default, for files that are little larger
TICKS = 90_000  # a second, at least: finer than what cameras write
MJPEG_QUALITY = 3 * 118  # 3 of 31 (1 is best), times FFmpeg's FF_QP2LAMBDA
BT709, BT601 = 1, 5  # color standards, by their numbers in ISO/IEC 23091-2 (and FFmpeg)


class VideoWriter:
    """Writes RGB pictures to a video file. A context manager.

    The file grows beside its place as `<name>.part` and moves there at a clean end; after an error it is removed.
    H.264 and HEVC store colors at half the resolution and need even sizes: of a picture with an odd width or height
    the last column or row is stored twice. MP4 and QuickTime files have their index first, so that they play while
    they load.
    """

    def __init__(
        self, path: str | Path, width: int, height: int, fps: float, codec: str = "h264", crf: int = 20,
        rotation: int = 0,
    ) -> None:  # fmt: skip
        """Opens the file.

        Args:
            path: Path of the video; its ending chooses the format.
            width: Width of the pictures [px].
            height: Height of the pictures [px].
            fps: Frames a second, for pictures without a time.
            codec: `h264`, `hevc` or `mjpeg`.
            crf: Quality from 0 (best) to 51, for H.264 and HEVC.
            rotation: Angle by which players turn the pictures clockwise [degrees]: 0, 90, 180 or 270. The pictures are
                stored as they are given.

        Raises:
            VideoError: A value is not allowed, or the file can't be written.
        """
        self._path = Path(path)
        _check(self._path, width, height, fps, codec, crf, rotation)
        self._part = self._path.with_name(self._path.name + PART)
        self._size = (width, height)
        self._mjpeg = codec == "mjpeg"
        self._pixels = "yuvj420p" if self._mjpeg else "yuv420p"
        self._rate = Fraction(fps).limit_denominator(1001)
        self._steady = self._path.suffix.lower() == ".avi"  # AVI knows no time stamps
        finer = 1 if self._steady else -(-TICKS * self._rate.denominator // self._rate.numerator)
        self._base = 1 / (self._rate * finer)
        self._closed = False
        self._last: int | None = None  # time stamp of the newest frame
        self._reformatter = VideoReformatter()
        try:
            self._part.open("wb").close()  # PyAV would find out with the first picture only
        except OSError as error:
            raise VideoError(f"'{self._path}' can't be written: {reason(error, self._path)}") from None
        self._container = av.open(
            str(self._part.absolute()), "w", format=FORMATS[self._path.suffix.lower()],
            options={"movflags": "+faststart"} if self._path.suffix.lower() in QUICKTIME else {},
        )  # fmt: skip
        options = {} if self._mjpeg else {"crf": str(crf), "preset": PRESET}
        if codec == "hevc":
            options["x265-params"] = "log-level=none"
        stream = self._container.add_stream(ENCODERS[codec], rate=self._rate, options=options)
        self._stream = cast("VideoStream", stream)
        self._stream.width, self._stream.height = width + width % 2, height + height % 2
        self._stream.pix_fmt = self._pixels
        context = self._stream.codec_context
        context.time_base = self._base
        context.color_primaries = context.color_trc = BT709
        context.colorspace = BT601 if self._mjpeg else BT709
        context.color_range = 2 if self._mjpeg else 1  # JPEG's full range; the limited one
        if self._mjpeg:
            context.qscale, context.global_quality = True, MJPEG_QUALITY
        if codec == "hevc" and self._path.suffix.lower() in QUICKTIME:
            context.codec_tag = "hvc1"  # Apple's players want it
        if rotation:
            self._stream.set_display_rotation(-rotation)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is None:
            self.close()
        else:
            self._abandon()

    def write(self, image: NDArray[np.uint8], time: float | None = None) -> None:
        """Adds a picture.

        Args:
            image: RGB, 8 bits. Shape (H, W, 3).
            time: Time since the start of the video [s], later than the last one's; None for one interval after it.

        Raises:
            VideoError: The picture or its time is not allowed, or the disk is full.
        """
        width, height = self._size
        if image.shape != (height, width, 3) or image.dtype != np.uint8:
            raise VideoError(
                f"the picture has shape {image.shape} of {image.dtype}; '{self._path}' takes ({height}, {width}, 3) "
                "of uint8"
            )
        stamp = self._stamp(time)
        if width % 2 or height % 2:
            image = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        given = VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        frame = self._reformatter.reformat(
            given, format=self._pixels, dst_colorspace=BT601 if self._mjpeg else BT709,
            dst_color_range=2 if self._mjpeg else 1, threads=1,
        )  # fmt: skip
        frame.pts, frame.time_base = stamp, self._base
        frame.duration = round(1 / (self._rate * self._base))
        self._encode(frame)
        self._last = stamp

    def close(self) -> None:
        """Finishes the file and moves it to its place.

        Raises:
            VideoError: No picture was written, or the disk is full.
        """
        if self._closed:
            return
        if self._last is None:
            self._abandon()
            raise VideoError(f"no picture was written to '{self._path}'; a video needs at least one")
        self._encode(None)
        self._guard(self._container.close)
        self._closed = True
        self._guard(lambda: self._part.replace(self._path))

    def _stamp(self, time: float | None) -> int:
        if self._closed:
            raise VideoError(f"'{self._path}' is closed; write within its `with` block")
        if time is None:
            return 0 if self._last is None else self._last + round(1 / (self._rate * self._base))
        if self._steady:
            raise VideoError(f"'{self._path}' can't hold times: AVI has a constant frame rate; write .mp4 or .mkv")
        stamp = round(Fraction(time) / self._base) if np.isfinite(time) else -1
        if stamp < 0 or (self._last is not None and stamp <= self._last):
            last = "none yet" if self._last is None else f"{float(self._last * self._base):.6f} s"
            raise VideoError(f"the time of a picture is {time} s; it must be 0 or later, and after the last ({last})")
        return stamp

    def _encode(self, frame: VideoFrame | None) -> None:
        self._guard(lambda: self._container.mux(self._stream.encode(frame)))

    def _guard(self, action: Callable[[], object]) -> None:
        try:
            action()
        except (FFmpegError, OSError) as error:
            why = reason(cast("OSError", error), self._path)  # FFmpeg's errors have what those of the system have
            self._abandon()
            raise VideoError(f"'{self._path}' can't be written: {why}") from None

    def _abandon(self) -> None:
        """Closes and removes the unfinished file."""
        if not self._closed:
            self._closed = True
            with contextlib.suppress(FFmpegError, OSError):
                self._container.close()
        self._part.unlink(missing_ok=True)


def _check(path: Path, width: int, height: int, fps: float, codec: str, crf: int, rotation: int) -> None:
    written = f"'{path}' can't be written: "
    for wrong, sentence in (
        (path.suffix.lower() not in FORMATS, f"{written}its ending must be one of {', '.join(FORMATS)}"),
        (path.is_dir(), f"{written}it is a folder"),
        (not path.parent.is_dir(), f"{written}there is no folder '{path.parent}'"),
        (width < 2 or height < 2, f"a video can't be {width} x {height} px; both must be at least 2"),
        (not 0.1 <= fps <= 10_000, f"fps is {fps}; it must lie within 0.1 and 10000 frames per second"),
        (codec not in ENCODERS, f"codec is '{codec}'; it must be one of {', '.join(ENCODERS)}"),
        (not 0 <= crf <= 51, f"crf is {crf}; it must lie within 0 (best) and 51"),
        (rotation not in (0, 90, 180, 270), f"rotation is {rotation}; it must be 0, 90, 180 or 270 degrees clockwise"),
    ):
        if wrong:
            raise VideoError(sentence)
