"""What a video file says about itself, and one frame of it, whose upright picture is made when asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import VideoError

if TYPE_CHECKING:
    from av import VideoFrame

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class VideoInfo:
    """What a file says about itself.

    Attributes:
        path: Of the file.
        width: Of the upright picture [px].
        height: Of the upright picture [px].
        fps: Mean frames a second.
        frame_count: As the file says, or from its duration; None where it says neither.
        duration: As the file says [s]; None where it doesn't.
        rotation: By which the stored pictures are turned clockwise to be upright [degrees]: 0, 90, 180 or 270.
        codec: Such as `h264`.
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
        index: Among the frames that are delivered, from 0.
        time: Since the first frame, strictly rising [s].
        intact: False after a broken frame, up to the next key frame: the picture may be smeared, since it was
            predicted from one that isn't there.
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
            width: Of the result [px]. The height keeps the proportions, rounded to an even number.

        Returns:
            A picture that is the caller's own. Shape (height, width, 3).

        Raises:
            VideoError: The width is below 2.
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
