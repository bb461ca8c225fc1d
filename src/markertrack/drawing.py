"""Draws on pictures: rings, crosses, lines and text with smooth edges, and sheets of several pictures.

Strokes are drawn into a small mask at four times its size, which is then reduced: smooth to a quarter of a pixel, and
cheap, since only what is near a stroke is touched. A color is laid over a picture through the mask; the mask of a
symbol or a text is drawn only once. Places are (x, y) in pixels; the center of the top left pixel is (0, 0).

Why no drawing library: aggdraw (1.4) was measured on a picture of 1280 x 720 px. It copies the whole picture for every
flush, so a ring took 14 ms in place of 0.03 ms; its lines have neither round joins nor a limit to their miters, so that
a sharp turn of a trail ends in a spike; and it would replace some 60 lines at the cost of 2.7 MB of binaries.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from PIL.Image import Image as Picture

from swimbase.errors import ArgumentError
from swimbase.escaping import visible

Bytes = NDArray[np.uint8]
Color = tuple[int, int, int]
Place = tuple[float, float]

DARK: Color = (16, 21, 27)
PAGE: Color = (245, 246, 248)
INK: Color = (27, 36, 48)
EDGE_OPACITY = 0.6
PLATE_OPACITY = 0.85
FINER = 4  # times the size at which masks are drawn


class Canvas:
    """A picture that is drawn on.

    A dark edge around what is drawn lets it show on any ground; its width is outside of the line's [px].

    Attributes:
        width: Width of the picture [px].
        height: Height of the picture [px].
    """

    def __init__(self, image: Picture) -> None:
        """Draws on the image that is given: RGB; `to_pillow` makes one from an array."""
        self._image = image
        self.width, self.height = image.size

    def pixels(self) -> Bytes:
        """The picture as it is now. Shape (H, W, 3)."""
        return np.asarray(self._image)

    def ring(
        self, center: Place, radius: float, color: Color, width: float, edge: float = 0.0, dashes: int = 0,
        share: float = 0.5,
    ) -> None:  # fmt: skip
        """Draws a ring.

        Args:
            center: Center of the ring [px].
            radius: To the middle of its line [px].
            color: Color of the stroke, RGB.
            width: Width of its line [px].
            edge: Width of the dark edge [px]; 0 for none.
            dashes: Dashes in which it is broken up; 0 for a whole ring.
            share: Share of a broken ring that is line.
        """
        self._symbol(center, color, _Symbol(radius, width, dashes, share), edge)

    def dot(self, center: Place, radius: float, color: Color, edge: float = 0.0) -> None:
        """Draws a filled circle [px]."""
        self._symbol(center, color, _Symbol(radius / 2, radius, 0, 1.0), edge)

    def cross(self, center: Place, radius: float, color: Color, width: float, edge: float = 0.0) -> None:
        """Draws a diagonal cross that just fits into a circle of this radius [px]."""
        self._symbol(center, color, _Symbol(radius, width, -1, 1.0), edge)

    def polyline(
        self, points: Sequence[Place], color: Color, width: float, edge: float = 0.0, opacity: float = 1.0,
        fade: bool = False,
    ) -> None:  # fmt: skip
        """Draws a line from point to point.

        Args:
            points: Corners of the line; it is broken where one is NaN [px].
            color: Color of the stroke, RGB.
            width: Width of the line [px].
            edge: Width of the dark edge [px]; 0 for none.
            opacity: Opacity, from 0 to 1.
            fade: Let it grow out of nothing, from the first point to the last.
        """
        if edge > 0:
            self._line(points, DARK, width + 2 * edge, EDGE_OPACITY * opacity, fade)
        self._line(points, color, width, opacity, fade)

    def text(
        self, place: Place, text: str, color: Color, size: float, anchor: Place = (0.0, 0.0), plate: Color | None = None
    ) -> None:
        """Writes a line of text.

        Args:
            place: Place of its anchor [px].
            text: What it says.
            color: Color of the stroke, RGB.
            size: Size of the font [px].
            anchor: The point of the text that goes to `place`, as shares of its width and height.
            plate: RGB of the ground that is put below it; None for none.
        """
        mask, pad = _text_mask(text, size), (round(0.35 * size), round(0.12 * size))
        left, top = (round(p - a * (s - 1)) for p, a, s in zip(place, anchor, mask.size, strict=True))
        if plate is not None:
            ground = _plate_mask(mask.width + 2 * pad[0], mask.height + 2 * pad[1], round(0.25 * size), PLATE_OPACITY)
            self._image.paste(plate, (left - pad[0], top - pad[1]), ground)
        self._image.paste(color, (left, top), mask)

    def paste(self, image: Picture, corner: tuple[int, int]) -> None:
        """Puts another picture on this one, with its top left pixel at `corner`."""
        self._image.paste(image, corner)

    def fill(self, box: tuple[int, int, int, int], color: Color) -> None:
        """Fills whole pixels: from left and top up to, not including, right and bottom."""
        self._image.paste(color, box)

    def _symbol(self, center: Place, color: Color, symbol: _Symbol, edge: float) -> None:
        x, y = (round(FINER * c) for c in center)
        corner = (x // FINER - symbol.reach(edge), y // FINER - symbol.reach(edge))
        if edge > 0:
            self._image.paste(DARK, corner, _symbol_mask(symbol, edge, x % FINER, y % FINER, EDGE_OPACITY))
            corner = (x // FINER - symbol.reach(0.0), y // FINER - symbol.reach(0.0))
        self._image.paste(color, corner, _symbol_mask(symbol, 0.0, x % FINER, y % FINER, 1.0))

    def _line(self, points: Sequence[Place], color: Color, width: float, opacity: float, fade: bool) -> None:
        whole = [math.isfinite(x) and math.isfinite(y) for x, y in points]
        pieces = [k for k in range(len(points) - 1) if whole[k] and whole[k + 1]]
        if not pieces:
            return
        xs, ys = zip(*(points[k + end] for k in pieces for end in (0, 1)), strict=True)
        margin = width / 2 + 1
        left, right = max(0, math.floor(min(xs) - margin)), min(self.width, math.ceil(max(xs) + margin) + 1)
        top, bottom = max(0, math.floor(min(ys) - margin)), min(self.height, math.ceil(max(ys) + margin) + 1)
        if left >= right or top >= bottom:
            return
        mask = Image.new("L", (FINER * (right - left), FINER * (bottom - top)))
        draw, thick, level = ImageDraw.Draw(mask), round(FINER * width), 255 * opacity
        for k in pieces:
            (x, y), end = (
                (FINER * (x - left + 0.5) - 0.5, FINER * (y - top + 0.5) - 0.5) for x, y in points[k : k + 2]
            )
            strength = round(level * (k + 1) / (len(points) - 1)) if fade else round(level)
            draw.line(((x, y), end), fill=strength, width=thick)
            if k - 1 in pieces and thick > 2 * FINER:  # a round corner
                draw.ellipse(_around(x, y, thick / 2), fill=strength)
        self._image.paste(color, (left, top), mask.reduce(FINER))


def to_pillow(image: Bytes) -> Picture:
    """A picture as Pillow's own, a copy.

    Args:
        image: RGB. Shape (H, W, 3).

    Raises:
        ArgumentError: It is no RGB picture.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or 0 in image.shape:
        raise ArgumentError(f"the picture has shape {image.shape} of {image.dtype}; it must be (H, W, 3) of uint8")
    return Image.fromarray(np.ascontiguousarray(image))


def plain(width: int, height: int, color: Color) -> Picture:
    """A picture of one color."""
    return Image.new("RGB", (width, height), color)


def text_size(text: str, size: float) -> tuple[int, int]:
    """Width and height that a line of text takes [px].

    Args:
        text: What it says.
        size: Size of the font [px].
    """
    return _text_mask(text, size).size


def contact_sheet(images: Sequence[Bytes], captions: Sequence[str], columns: int, width: int) -> Bytes:
    """Several pictures in one, each with a caption below it.

    Args:
        images: RGB, of any sizes. Shapes (H, W, 3).
        captions: One for each picture.
        columns: Pictures in a row.
        width: Width that every picture is scaled to [px].

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No pictures, not one caption each, or no columns or width.
    """
    if not images or len(images) != len(captions):
        raise ArgumentError(f"{len(images)} pictures and {len(captions)} captions; give one or more, with one each")
    if columns < 1 or width < 16:
        raise ArgumentError(f"{columns} columns of {width} px; it must be 1 column or more, of 16 px or more")
    tiles = [to_pillow(image) for image in images]
    tiles = [tile.resize((width, max(1, round(tile.height * width / tile.width))), reducing_gap=2.0) for tile in tiles]
    size = float(np.clip(width / 24, 11, 22))
    gap, foot = round(0.7 * size), round(1.9 * size)
    rows = [range(k, min(k + columns, len(tiles))) for k in range(0, len(tiles), columns)]
    heights = [max(tiles[k].height for k in row) + foot for row in rows]
    across = min(columns, len(tiles))
    canvas, top = Canvas(plain(gap + across * (width + gap), gap + sum(heights), PAGE)), gap
    for row, height in zip(rows, heights, strict=True):
        for column, k in enumerate(row):
            left = gap + column * (width + gap)
            canvas.paste(tiles[k], (left, top))
            canvas.text((left, top + tiles[k].height + 0.3 * size), captions[k], INK, size)
        top += height
    return canvas.pixels()


def to_png(image: Bytes) -> bytes:
    """A picture as a PNG file: nothing is lost.

    Args:
        image: RGB. Shape (H, W, 3).

    Raises:
        ArgumentError: It is no RGB picture.
    """
    file = io.BytesIO()
    to_pillow(image).save(file, "PNG", optimize=True)
    return file.getvalue()


@dataclass(frozen=True)
class _Symbol:
    """A ring, whole (0 dashes) or broken up, or a cross (-1)."""

    radius: float
    width: float
    dashes: int
    share: float

    def reach(self, edge: float) -> int:
        """Distance from the middle pixel of its mask to the mask's edges [px]."""
        return math.ceil(self.radius + self.width / 2 + edge) + 1


@lru_cache(maxsize=4096)
def _symbol_mask(symbol: _Symbol, edge: float, x: int, y: int, opacity: float) -> Picture:
    """A symbol with a wider line, by an edge on both sides.

    Args:
        symbol: What is drawn.
        edge: Width of the line drawn around it on either side [px].
        x: Place of its center, from the pixel `reach` pixels from the mask's top left one [quarters of a pixel].
        y: The same, downward.
        opacity: Opacity from 0 to 1.
    """
    size, level = 2 * symbol.reach(edge) + 2, round(255 * opacity)
    mask = Image.new("L", (FINER * size, FINER * size))
    draw, line = ImageDraw.Draw(mask), round(FINER * (symbol.width + 2 * edge))
    middle = FINER * (symbol.reach(edge) + 0.5) - 0.5
    half = symbol.radius / math.sqrt(2) if symbol.dashes < 0 else symbol.radius + symbol.width / 2
    box = left, top, right, bottom = _around(middle + x, middle + y, FINER * (half + edge))
    if symbol.dashes < 0:
        draw.line((left, top, right, bottom), fill=level, width=line)
        draw.line((left, bottom, right, top), fill=level, width=line)
    elif symbol.dashes == 0:
        draw.ellipse(box, outline=level, width=line)
    turn = 360 / max(symbol.dashes, 1)
    extra = math.degrees(edge / symbol.radius)  # the edge, at the ends of a dash
    for k in range(symbol.dashes):
        draw.arc(box, k * turn - extra, (k + symbol.share) * turn + extra, fill=level, width=line)
    return mask.reduce(FINER)


def _around(x: float, y: float, half: float) -> tuple[int, int, int, int]:
    """The box around a circle as Pillow takes it: the first and the last pixels that are in it."""
    return round(x - half + 0.5), round(y - half + 0.5), round(x + half - 0.5), round(y + half - 0.5)


@cache
def _font(size: float) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont), "Pillow's wheels come with FreeType"
    return font


@lru_cache(maxsize=1024)
def _text_mask(text: str, size: float) -> Picture:
    """The text in white on black, in one line, as high as the font's capitals and descenders whatever it says."""
    font, line = _font(size), visible(text).replace("\n", " ")
    ascent, descent = font.getmetrics()
    mask = Image.new("L", (max(1, round(font.getlength(line))), ascent + descent))
    ImageDraw.Draw(mask).text((0, 0), line, fill=255, font=font)
    return mask


@lru_cache(maxsize=256)
def _plate_mask(width: int, height: int, radius: int, opacity: float) -> Picture:
    """A rectangle with round corners."""
    mask = Image.new("L", (FINER * width, FINER * height))
    box = (0, 0, FINER * width - 1, FINER * height - 1)
    ImageDraw.Draw(mask).rounded_rectangle(box, FINER * radius, fill=round(255 * opacity))
    return mask.reduce(FINER)
