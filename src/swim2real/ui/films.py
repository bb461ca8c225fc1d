"""Films on the page: frames as JPEG, points and corrections, the track of a film with its doubtful stretches."""

from __future__ import annotations

import threading
from collections import OrderedDict
from pathlib import Path
from typing import Any

import cv2

from markertrack.video import SeekableFilm
from swimbase.errors import VideoError

_MOST_OPEN = 3  # films
_MOST_BYTES = 64 << 20  # of pictures that are kept
_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 92, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


class FilmCache:
    """Films that were looked at last, and their last pictures. A film that has changed is opened anew."""

    def __init__(self) -> None:
        self._films: OrderedDict[tuple[Path, int, int], SeekableFilm] = OrderedDict()
        self._pictures: OrderedDict[tuple[Path, int, int, int], bytes] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    def opened(self, path: Path) -> dict[str, Any]:
        """Size, rate and number of frames of a film, ready for JSON."""
        with self._lock:
            film, _ = self._film(path)
            return {"width": film.size[0], "height": film.size[1], "fps": film.fps, "frames": len(film.times)}

    def picture(self, path: Path, number: int) -> bytes:
        """A frame as JPEG."""
        with self._lock:
            film, key = self._film(path)
            place = (*key, number)
            if place in self._pictures:
                self._pictures.move_to_end(place)
                return self._pictures[place]
            image = cv2.cvtColor(film.frame(number).image, cv2.COLOR_RGB2BGR)
            content = self._pictures[place] = cv2.imencode(".jpg", image, _QUALITY)[1].tobytes()
            self._bytes += len(content)
            while self._bytes > _MOST_BYTES:
                self._bytes -= len(self._pictures.popitem(last=False)[1])
            return content

    def _film(self, path: Path) -> tuple[SeekableFilm, tuple[Path, int, int]]:
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
        return self._films[key], key
