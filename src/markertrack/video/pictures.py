"""Films of single pictures: a folder of them, a pattern of their names, or the pages of one file. Pillow reads them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Generator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
from av import VideoFrame
from numpy.typing import NDArray
from PIL import Image, ImageOps

from markertrack.video.clock import frames
from markertrack.video.decoding import MOST_PIXELS, Picture, Stated, too_large, usual_interval
from swimbase.errors import VideoError

KINDS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP", "PPM")  # as Pillow calls them; each is whole in one file
_PAGED = ("TIFF", "WEBP")  # whose further pictures are frames, no views or thumbnails
_COUNTER = re.compile(r"%0?(\d*)d")
_MOST_NAMED = 4


def film_title(path: Path) -> str:
    """Name of a film: its file, its folder, or what its pattern begins with; its stem names the trial."""
    if is_pattern(path):
        return f"{_COUNTER.split(path.name)[0].rstrip('_-. ') or path.parent.resolve().name}.pictures"
    return f"{path.resolve().name}.pictures" if path.is_dir() else path.name


def film_name(path: Path) -> str:
    """The title without its ending."""
    return Path(film_title(path)).stem


def film_files(path: Path) -> list[Path]:
    """The files that a film consists of, in the order of their pictures."""
    return [file for _, file in _series(path)] if path.is_dir() or is_pattern(path) else [path]


def is_pattern(path: Path) -> bool:
    """True if a path is no file, but names many by a number, as `frame_%04d.png` does."""
    return len(_COUNTER.findall(path.name)) == 1 and not path.exists()


class Pictures:
    """Pictures one after the other, as a `Decoder` gives those of a film. Their stamps are the numbers in their names.

    Attributes:
        stated: What they state of themselves, which is no rate.
        left_out: Numbers of the pictures that can't be read, as keys.
        notes: A sentence for each thing that a person should know.
    """

    def __init__(self, path: Path) -> None:
        """Finds the files and looks at the first.

        Raises:
            VideoError: There is none, they aren't of one series, or the first is no picture.
        """
        several = path.is_dir() or is_pattern(path)
        series = _series(path) if several else [(0, path)]
        self._image = _opened(series[0][1])
        self._open = series[0][1]
        pages = getattr(self._image, "n_frames", 1) if self._image.format in _PAGED else 1
        if several and pages > 1:
            self.close()
            raise VideoError(f"'{self._open}' has {pages} pictures; give such a file by itself, or files of one each")
        self._pictures = [(page, path, page) for page in range(pages)] if pages > 1 else [(*one, 0) for one in series]
        self.numbers = [number for number, *_ in self._pictures]
        self.stated = Stated(Fraction(1), None, len(self._pictures), None, 0, str(self._image.format).lower())
        self.left_out: dict[int, None] = {}
        self.unstamped = 0
        self.notes: list[str] = []
        usual = usual_interval(self.numbers) or 1
        holes = [(before, after) for before, after in pairwise(self.numbers) if after - before > 1.5 * usual]
        if holes:
            missing = sum(round((after - before) / usual) - 1 for before, after in holes)
            self.notes.append(f"{frames(missing)} missing between the numbers {holes[0][0]} and {holes[-1][1]}")
        self._white = 0.0  # level of the brightest pixel that pictures of more than 8 bits can have

    def close(self) -> None:
        self._image.close()

    def pictures(self) -> Generator[Picture]:
        """All that can be read, in order."""
        for number, file, page in self._pictures:
            try:
                if file != self._open:
                    self._image.close()
                    self._image, self._open = _opened(file), file
                self._image.seek(page)
                shown = VideoFrame.from_ndarray(self._levels(), format="rgb24")
            except (OSError, ValueError, SyntaxError, EOFError, VideoError):
                self.left_out[number] = None
                continue
            yield Picture(shown, number, True, 0)

    def _levels(self) -> NDArray[np.uint8]:
        """The upright picture, RGB. Gray levels of more than 8 bits fill those that the first picture's bits allow."""
        if self._image.width * self._image.height > MOST_PIXELS:
            raise VideoError(too_large(self._open))
        upright = ImageOps.exif_transpose(self._image)
        if upright.mode[0] not in "IF":
            return np.asarray(upright.convert("RGB"))
        levels = np.nan_to_num(np.asarray(upright, dtype=np.float64))
        if not self._white:
            top = float(levels.max())
            self._white = 2.0 ** np.ceil(np.log2(top + 1)) - 1 if top > 1 else 1.0
        gray = np.clip(np.round(levels * (255 / self._white)), 0, 255).astype(np.uint8)
        return np.repeat(gray[..., None], 3, axis=2)


def pattern_of(file: Path) -> str:
    """The pattern of the names of a file and of those numbered like it; empty for a name without a number."""
    digits = re.search(r"(\d+)(?=\D*$)", file.stem)
    if digits is None:
        return ""
    counter = f"%0{len(digits[0])}d" if digits[0][0] == "0" else "%d"
    return f"{file.name[: digits.start()]}{counter}{file.name[digits.end() :]}"


def _opened(file: Path) -> Image.Image:
    """A picture whose header is read.

    Raises:
        VideoError: It is none, or is too large.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(file, formats=KINDS)
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise VideoError(too_large(file)) from None
    except (OSError, ValueError, SyntaxError) as error:
        raise VideoError(f"'{file}' is not a picture that can be read ({error})") from None
    return image


def _series(path: Path) -> list[tuple[int, Path]]:
    """The numbered pictures of a folder or a pattern, in the order of their numbers.

    Raises:
        VideoError: There are none, or they have several patterns.
    """
    if path.is_dir():
        folder = path
        endings = {ending for ending, kind in Image.registered_extensions().items() if kind in KINDS}
        named = [file for file in path.iterdir() if file.suffix.lower() in endings and file.name[0] != "."]
    else:
        folder, (before, width, after) = path.parent, _COUNTER.split(path.name)
        name = re.compile(rf"{re.escape(before)}\d{{{width or 1},}}{re.escape(after)}")
        named = [file for file in folder.glob("*") if name.fullmatch(file.name)]
    files = sorted((file for file in named if file.is_file()), key=_numbers)
    if not files:
        what = f"'{path}' is a folder without pictures" if path.is_dir() else f"there is no picture '{path}'"
        raise VideoError(
            f"{what}; give the path of a video file, or of a folder of pictures with numbers in their names"
        )
    kinds = {re.sub(r"\d+", "#", file.name.lower()): pattern_of(file) for file in files}
    if len(kinds) > 1:
        listed = ", ".join(f"'{folder / pattern}'" for pattern in list(kinds.values())[:_MOST_NAMED])
        raise VideoError(f"'{path}' has pictures of several series; give one of them: {listed}")
    columns = [column for column in zip(*map(_numbers, files), strict=True) if len(set(column)) > 1]
    return list(zip(columns[0] if len(columns) == 1 else range(len(files)), files, strict=True))


def _numbers(file: Path) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", file.name)))
