"""Pictures as PNG and JPEG files in memory."""

from __future__ import annotations

import io

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import Bytes, to_pillow


def to_png(image: Bytes) -> bytes:
    """A picture as a PNG file: nothing is lost.

    Args:
        image: RGB. Shape (H, W, 3).

    Raises:
        ArgumentError: It is no RGB picture.
        MissingExtraError: Pillow isn't installed.
    """
    file = io.BytesIO()
    to_pillow(image).save(file, "PNG", optimize=True)
    return file.getvalue()


def to_jpeg(image: Bytes, quality: int = 85) -> bytes:
    """A picture as a JPEG file, with colors in full resolution so that thin lines keep theirs.

    Args:
        image: RGB. Shape (H, W, 3).
        quality: From 1 to 95.

    Raises:
        ArgumentError: It is no RGB picture, or the quality is out of range.
        MissingExtraError: Pillow isn't installed.
    """
    if not 1 <= quality <= 95:
        raise ArgumentError(f"quality is {quality}; it must lie within 1 and 95 (best)")
    file = io.BytesIO()
    to_pillow(image).save(file, "JPEG", quality=quality, subsampling=0, optimize=True)
    return file.getvalue()
