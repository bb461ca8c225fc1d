"""Shapes and text as masks, through which a color is laid over a picture; the same one is drawn only once.

They are drawn at four times their size and reduced, so their edges are smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING

from swim2real.errors import MissingExtraError

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont

FINER = 4  # times the size at which masks are drawn


@dataclass(frozen=True)
class Symbol:
    """A ring, whole (0 dashes) or broken up, or a cross (-1)."""

    radius: float
    width: float
    dashes: int
    share: float

    def reach(self, edge: float) -> int:
        """From the middle pixel of its mask to the mask's edges [px]."""
        return math.ceil(self.radius + self.width / 2 + edge) + 1


@lru_cache(maxsize=4096)
def symbol_mask(symbol: Symbol, edge: float, x: int, y: int, opacity: float) -> Image:
    """A symbol with a wider line, by an edge on both sides.

    Args:
        symbol: What is drawn.
        edge: By which its line is wider on either side [px].
        x: Of its center, from that of the pixel `reach` pixels from the mask's top left one [quarters of a pixel].
        y: As x.
        opacity: From 0 to 1.
    """
    from PIL import Image, ImageDraw

    size, level = 2 * symbol.reach(edge) + 2, round(255 * opacity)
    mask = Image.new("L", (FINER * size, FINER * size))
    draw, line = ImageDraw.Draw(mask), round(FINER * (symbol.width + 2 * edge))
    middle = FINER * (symbol.reach(edge) + 0.5) - 0.5
    half = symbol.radius / math.sqrt(2) if symbol.dashes < 0 else symbol.radius + symbol.width / 2
    box = left, top, right, bottom = around(middle + x, middle + y, FINER * (half + edge))
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


def around(x: float, y: float, half: float) -> tuple[int, int, int, int]:
    """The box around a circle as Pillow takes it: the first and the last pixels that are in it."""
    return round(x - half + 0.5), round(y - half + 0.5), round(x + half - 0.5), round(y + half - 0.5)


@cache
def _font(size: float) -> FreeTypeFont:
    from PIL import ImageFont

    font = ImageFont.load_default(size)
    if not isinstance(font, ImageFont.FreeTypeFont):
        raise MissingExtraError("Pillow was built without FreeType; install it with: pip install 'swim2real[track]'")
    return font


@lru_cache(maxsize=1024)
def text_mask(text: str, size: float) -> Image:
    """The text in white on black, as high as the font's capitals and descenders whatever it says."""
    from PIL import Image, ImageDraw

    font = _font(size)
    ascent, descent = font.getmetrics()
    mask = Image.new("L", (max(1, round(font.getlength(text))), ascent + descent))
    ImageDraw.Draw(mask).text((0, 0), text, fill=255, font=font)
    return mask


@lru_cache(maxsize=256)
def plate_mask(width: int, height: int, radius: int, opacity: float) -> Image:
    """A rectangle with round corners."""
    from PIL import Image, ImageDraw

    mask = Image.new("L", (FINER * width, FINER * height))
    box = (0, 0, FINER * width - 1, FINER * height - 1)
    ImageDraw.Draw(mask).rounded_rectangle(box, FINER * radius, fill=round(255 * opacity))
    return mask.reduce(FINER)
