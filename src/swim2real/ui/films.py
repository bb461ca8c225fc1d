"""Films on the page: their frames as JPEG. Those seen last the page keeps itself."""

from __future__ import annotations

import base64
import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from markertrack.tracking.tracker import Image
from markertrack.video import SeekableFilm
from swimbase.arrays import Array
from swimbase.errors import VideoError

_MOST_OPEN = 3  # films
_LARGE = 3_000_000  # px of a picture, from which seeking is slow enough to be seen
_SMALL, _OFF = 1280, 3.0  # width of a picture that is shown until then [px], and how far off it may be [s]
_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 92, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


@dataclass(frozen=True)
class OpenFilm:
    """A film as the page has it.

    Attributes:
        width: Width of the upright picture [px].
        height: Height of the upright picture [px].
        fps: Mean number of frames per second.
        frames: Number of frames.
        times: Times of the frames since the first, `packed` [s].
        large: Whether a smaller picture is shown until the exact frame is there.
    """

    width: int
    height: int
    fps: float
    frames: int
    times: str
    large: bool


def packed(numbers: Array) -> str:
    """Numbers for the page: base64 of 32-bit floats."""
    return base64.b64encode(numbers.astype("<f4").tobytes()).decode()


def _jpeg(image: Image) -> bytes:
    return cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _QUALITY)[1].tobytes()


class FilmCache:
    """Films that were looked at last. A film that has changed is opened anew."""

    def __init__(self) -> None:
        self._films: OrderedDict[tuple[Path, int, int], SeekableFilm] = OrderedDict()
        self._lock = threading.Lock()

    def opened(self, path: Path) -> OpenFilm:
        """Size, rate and times of a film."""
        with self._lock:
            film = self._film(path)
            times = packed(np.array(film.times))
            return OpenFilm(*film.size, film.fps, len(film.times), times, film.size[0] * film.size[1] > _LARGE)

    def early(self, path: Path, number: int) -> tuple[bytes, int]:
        """A small picture near a frame, and its number: without decoding what lies between, unless it is far off."""
        with self._lock:
            film = self._film(path)
            frame = film.key_frame(number)
            if film.times[number] - frame.time > _OFF:
                frame = film.frame(number)
            return _jpeg(frame.scaled(min(_SMALL, film.size[0]))), frame.index

    def image(self, path: Path, number: int) -> Image:
        """A frame, upright, RGB. Shape (H, W, 3)."""
        with self._lock:
            return self._film(path).frame(number).image

    def picture(self, path: Path, number: int) -> bytes:
        """A frame as JPEG."""
        return _jpeg(self.image(path, number))

    def _film(self, path: Path) -> SeekableFilm:
        try:
            known = path.stat()
        except OSError:
            raise VideoError(f"no video '{path}'; check the path") from None
        key = (path, known.st_mtime_ns, known.st_size)
        if key not in self._films:
            self._films[key] = SeekableFilm(path)
            while len(self._films) > _MOST_OPEN:
                self._films.popitem(last=False)[1].close()
        self._films.move_to_end(key)
        return self._films[key]
