"""A page to click the markers of a video's first frame on: one HTML file without network or libraries."""

from __future__ import annotations

import base64
import html
import json
import os
import re
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError, MissingExtraError, TrackingError

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_TEMPLATE = Path(__file__).with_name("picker.html")
FINEST = 2  # quantizer of the JPEG: 2 is its best, and keeps a 4K frame at some megabytes


def write_pick_page(
    frame_image: Image, names: Sequence[str], video_name: str, path: str | Path, rest_markers: Array | None = None
) -> Path:
    """Writes the page. What it lets a person download is what `load_points` reads.

    Args:
        frame_image: First frame, upright, RGB. Shape (H, W, 3).
        names: Of the robot's markers, head first.
        video_name: Shown on the page and written into the points file.
        path: Of the page.
        rest_markers: Marker positions of the robot in its rest pose, for a sketch of it [m]. Shape (M, 2).

    Returns:
        The path.

    Raises:
        ArgumentError: The image isn't one.
        MissingExtraError: PyAV isn't installed.
        TrackingError: The page can't be written.
    """
    height, width = _size(frame_image)
    data = {
        "names": list(names), "video": video_name, "width": width, "height": height,
        "places": _places(len(names), rest_markers),
    }  # fmt: skip
    parts = {
        "VIDEO": html.escape(video_name),
        "DATA": json.dumps(data).replace("<", "\\u003c"),
        "IMAGE": "data:image/jpeg;base64," + base64.b64encode(_jpeg(frame_image)).decode("ascii"),
    }
    template = _TEMPLATE.read_text(encoding="utf-8")
    page = re.sub("@@([A-Z]+)@@", lambda found: parts[found.group(1)], template)
    path = Path(path)
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(page, encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise TrackingError(
            f"can't write '{path}': {error.strerror or error}; give a place that can be written to with --out"
        ) from error
    return path


def _size(image: Image) -> tuple[int, int]:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or 0 in image.shape:
        raise ArgumentError(
            f"the frame is an array of {image.dtype} with shape {image.shape}; it must be uint8 with shape (H, W, 3)"
        )
    return image.shape[0], image.shape[1]


def _places(count: int, rest_markers: Array | None) -> list[float]:
    """Where the markers are on the sketch, 0 at the head and 1 at the tail."""
    if rest_markers is None:
        along = np.arange(count, dtype=float)
    else:
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rest_markers, axis=0), axis=1))])
    return [float(v) for v in np.round(along / max(float(along[-1]), 1e-9), 4)]


def _jpeg(image: Image) -> bytes:
    try:
        import av
    except ImportError as error:
        raise MissingExtraError(
            "the page to pick markers on needs PyAV; install it with: pip install 'swim2real[track]'"
        ) from error
    encoder = av.CodecContext.create("mjpeg", "w")
    encoder.height, encoder.width = image.shape[:2]
    encoder.pix_fmt = "yuvj444p"  # a marker's color is not blurred over its neighbors
    encoder.time_base = Fraction(1, 25)
    encoder.qmin = encoder.qmax = FINEST
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24").reformat(format="yuvj444p")
    return b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)])
