"""Draws on pictures: rings, crosses, lines and text with smooth edges, and sheets of several pictures.

Strokes are drawn into a small mask at four times its size, which is then reduced: smooth to a quarter of a pixel, and
cheap, since only what is near a stroke is touched. Places are (x, y) in pixels; the center of the top left pixel is
(0, 0).
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError, MissingExtraError
from swim2real.rendering.drawing_masks import FINER, Symbol, around, plate_mask, symbol_mask, text_mask

if TYPE_CHECKING:
    from PIL.Image import Image

Bytes = NDArray[np.uint8]
Color = tuple[int, int, int]
Place = tuple[float, float]

DARK: Color = (16, 21, 27)
PAGE: Color = (245, 246, 248)
INK: Color = (27, 36, 48)
EDGE_OPACITY = 0.6
PLATE_OPACITY = 0.85


def require_pillow() -> None:
    """Raises a sentence where Pillow isn't installed.

    Raises:
        MissingExtraError: Pillow isn't installed.
    """
    try:
        importlib.import_module("PIL.Image")
    except ImportError:
        raise MissingExtraError("drawing needs Pillow; install it with: pip install 'swim2real[track]'") from None


class Canvas:
    """A picture that is drawn on.

    A dark edge around what is drawn lets it show on any ground; its width is outside of the line's [px].

    Attributes:
        width: Of the picture [px].
        height: Of the picture [px].
    """

    def __init__(self, image: Image) -> None:
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
            center: Of the ring [px].
            radius: To the middle of its line [px].
            color: RGB.
            width: Of its line [px].
            edge: Of the dark edge [px]; 0 for none.
            dashes: In which it is broken up; 0 for a whole ring.
            share: Of a broken ring that is line.
        """
        self._symbol(center, color, Symbol(radius, width, dashes, share), edge)

    def dot(self, center: Place, radius: float, color: Color, edge: float = 0.0) -> None:
        """Draws a filled circle [px]."""
        self._symbol(center, color, Symbol(radius / 2, radius, 0, 1.0), edge)

    def cross(self, center: Place, radius: float, color: Color, width: float, edge: float = 0.0) -> None:
        """Draws a diagonal cross that just fits into a circle of this radius [px]."""
        self._symbol(center, color, Symbol(radius, width, -1, 1.0), edge)

    def polyline(
        self, points: Sequence[Place], color: Color, width: float, edge: float = 0.0, opacity: float = 1.0,
        fade: bool = False,
    ) -> None:  # fmt: skip
        """Draws a line from point to point.

        Args:
            points: Its corners; it is broken where one is NaN [px].
            color: RGB.
            width: Of the line [px].
            edge: Of the dark edge [px]; 0 for none.
            opacity: From 0 to 1.
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
            place: Of its anchor [px].
            text: What it says.
            color: RGB.
            size: Of the font [px].
            anchor: The point of the text that goes to `place`, as shares of its width and height.
            plate: RGB of the ground that is put below it; None for none.
        """
        mask, pad = text_mask(text, size), (round(0.35 * size), round(0.12 * size))
        left, top = (round(p - a * (s - 1)) for p, a, s in zip(place, anchor, mask.size, strict=True))
        if plate is not None:
            ground = plate_mask(mask.width + 2 * pad[0], mask.height + 2 * pad[1], round(0.25 * size), PLATE_OPACITY)
            self._image.paste(plate, (left - pad[0], top - pad[1]), ground)
        self._image.paste(color, (left, top), mask)

    def paste(self, image: Image, corner: tuple[int, int]) -> None:
        """Puts another picture on this one, with its top left pixel at `corner`."""
        self._image.paste(image, corner)

    def fill(self, box: tuple[int, int, int, int], color: Color) -> None:
        """Fills whole pixels: from left and top up to, not including, right and bottom."""
        self._image.paste(color, box)

    def _symbol(self, center: Place, color: Color, symbol: Symbol, edge: float) -> None:
        x, y = (round(FINER * c) for c in center)
        corner = (x // FINER - symbol.reach(edge), y // FINER - symbol.reach(edge))
        if edge > 0:
            self._image.paste(DARK, corner, symbol_mask(symbol, edge, x % FINER, y % FINER, EDGE_OPACITY))
            corner = (x // FINER - symbol.reach(0.0), y // FINER - symbol.reach(0.0))
        self._image.paste(color, corner, symbol_mask(symbol, 0.0, x % FINER, y % FINER, 1.0))

    def _line(self, points: Sequence[Place], color: Color, width: float, opacity: float, fade: bool) -> None:
        from PIL import Image, ImageDraw

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
                draw.ellipse(around(x, y, thick / 2), fill=strength)
        self._image.paste(color, (left, top), mask.reduce(FINER))


def to_pillow(image: Bytes) -> Image:
    """A picture as Pillow's own, a copy.

    Args:
        image: RGB. Shape (H, W, 3).

    Raises:
        ArgumentError: It is no RGB picture.
        MissingExtraError: Pillow isn't installed.
    """
    require_pillow()
    from PIL import Image

    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or 0 in image.shape:
        raise ArgumentError(f"the picture has shape {image.shape} of {image.dtype}; it must be (H, W, 3) of uint8")
    return Image.fromarray(np.ascontiguousarray(image))


def plain(width: int, height: int, color: Color) -> Image:
    """A picture of one color.

    Raises:
        MissingExtraError: Pillow isn't installed.
    """
    require_pillow()
    from PIL import Image

    return Image.new("RGB", (width, height), color)


def text_size(text: str, size: float) -> tuple[int, int]:
    """Width and height that a line of text takes [px].

    Args:
        text: What it says.
        size: Of the font [px].
    """
    return text_mask(text, size).size


def contact_sheet(images: Sequence[Bytes], captions: Sequence[str], columns: int, width: int) -> Bytes:
    """Several pictures in one, each with a caption below it.

    Args:
        images: RGB, of any sizes. Shapes (H, W, 3).
        captions: One for each picture.
        columns: Pictures in a row.
        width: That every picture is scaled to [px].

    Returns:
        The sheet, RGB.

    Raises:
        ArgumentError: No pictures, not one caption each, or no columns or width.
        MissingExtraError: Pillow isn't installed.
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
