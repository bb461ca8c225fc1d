"""Reads videos frame by frame: upright pictures, times from time stamps, and notes on what is wrong with the file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Self

from swim2real.errors import VideoError
from swim2real.video.frame import Frame, VideoInfo
from swim2real.video.playback import Playback

__all__ = ["Frame", "VideoInfo", "VideoReader", "first_frame"]


class VideoReader:
    """Frames of a video, one after the other, in constant memory. A context manager.

    Iterating again starts at the first frame. Broken frames are left out; `notes` says which.

    Attributes:
        info: What the file says about itself.
    """

    info: VideoInfo

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        """Opens the video and decodes its first frame.

        Args:
            path: Of the video.
            threads: That decode; 0 for as many as the machine has cores.

        Raises:
            VideoError: It can't be read, or not one frame can be decoded.
            MissingExtraError: PyAV isn't installed.
        """
        if threads < 0:
            raise VideoError(f"threads is {threads}; it must be 0 (as many as there are cores) or more")
        self._playback = Playback(Path(path), threads)
        self._threads = threads
        self._used = self._closed = False
        self.info = self._playback.info

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._closed = True
        self._playback.close()

    def __iter__(self) -> Iterator[Frame]:
        if self._closed:
            raise VideoError(f"'{self.info.path}' is closed; read it within its `with` block")
        if self._used:
            self._playback.close()
            self._playback = Playback(self.info.path, self._threads)
        self._used = True
        return self._playback.frames()

    @property
    def notes(self) -> list[str]:
        """A sentence for each thing that a person should know; complete after the last frame."""
        return self._playback.notes()


def first_frame(path: str | Path) -> Frame:
    """The first frame of a video.

    Raises:
        VideoError: It can't be read, or not one frame can be decoded.
        MissingExtraError: PyAV isn't installed.
    """
    with VideoReader(path, threads=1) as reader:
        return next(iter(reader))
