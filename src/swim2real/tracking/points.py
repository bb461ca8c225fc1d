"""The markers of a first frame: their file, and the page to click them on.

The points file is `{"format": 1, "video": "swim.mp4", "width": 3840, "height": 2160, "frame": 0, "markers": {"M0": [x,
y], …}}`, in pixels of the upright frame; the center of the top-left pixel is (0, 0). A plain list of pairs, in the
order of the markers, is read as well. The page is one HTML file without network or libraries.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from pydantic import BaseModel, Field, model_validator

from swim2real.checking import Number, did_you_mean, read
from swim2real.errors import ArgumentError, TrackingError
from swim2real.escaping import script_source, visible
from swim2real.names import quoted
from swim2real.store import write_json, write_text

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]

FORMAT = 1
CLOSEST_PX = 2.0  # two markers nearer than this are one marker clicked twice
PICK_AGAIN = "pick the points again with `swim2real pick`"
_JPEG_QUALITY = 95  # keeps a 4K frame at some megabytes
_TEMPLATE = Path(__file__).with_name("picker.html")


class _Content(BaseModel):
    """What a points file says: markers by name, or a plain list of points."""

    format: Literal[1] = 1
    width: int | None = None
    height: int | None = None
    frame: Annotated[int, Field(ge=0, strict=True)] | None = None
    markers: dict[str, Pair] | None = None
    points: list[Pair] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, content: Any) -> Any:
        return {"points": content} if isinstance(content, list) else content


def load_points(path: str | Path, names: Sequence[str], width: int, height: int, frame: int = 0) -> Array:
    """Reads a points file and checks it against the robot and the video.

    Args:
        path: Path of the file.
        names: Names of the robot's markers, head first.
        width: Width of the video's upright frame [px].
        height: Height of the video's upright frame [px].
        frame: Number of the frame that tracking begins with.

    Returns:
        Points in the order of `names` [px]. Shape (M, 2).

    Raises:
        TrackingError: The file is missing, can't be read, or its points aren't of this robot and this video.
    """
    content = read(_Content, path, "points", TrackingError, f"{PICK_AGAIN} (`swim2real pick VIDEO`)")
    size = content.width or width, content.height or height
    if size != (width, height):
        raise TrackingError(
            f"points '{path}' were picked on a frame of {size[0]} x {size[1]} px; "
            f"the video's is {width} x {height} px; {PICK_AGAIN} on this video"
        )
    if content.frame not in (None, frame):
        raise TrackingError(
            f"points '{path}' were picked in frame {content.frame} of the video; tracking begins with frame {frame}; "
            f"begin with the same one (--from of `swim2real pick` and of `swim2real track`)"
        )
    if content.markers is not None:
        pairs = _in_order(path, content.markers, names)
    elif content.points is not None:
        pairs = content.points
    else:
        raise TrackingError(
            f"points '{path}' hold neither 'markers' nor a plain list of [x, y]; {PICK_AGAIN}, which writes them right"
        )
    if len(pairs) != len(names):
        raise TrackingError(
            f"points '{path}' hold {len(pairs)} points; expected are {len(names)}, "
            f"one for each of {', '.join(names)}; {PICK_AGAIN}"
        )
    points = np.array(pairs, dtype=float)
    _check_places(path, points, names, width, height)
    return points


def save_points(path: str | Path, points: Array, names: Sequence[str], video: str, width: int, height: int) -> None:
    """Writes a points file.

    Args:
        path: Path of the file.
        points: Points in the order of `names` [px]. Shape (M, 2).
        names: Names of the robot's markers, head first.
        video: Name of the video that the points were picked on.
        width: Width of its upright frame [px].
        height: Height of its upright frame [px].

    Raises:
        TrackingError: The points couldn't be read back, or the file can't be written.
    """
    if np.shape(points) != (len(names), 2):
        raise TrackingError(f"points have shape {np.shape(points)}; expected is ({len(names)}, 2), x and y of a marker")
    places = np.array(points, dtype=float)
    _check_places(path, places, names, width, height)
    markers = {name: [round(x, 3), round(y, 3)] for name, (x, y) in zip(names, places.tolist(), strict=True)}
    content = {"format": FORMAT, "video": video, "width": width, "height": height, "frame": 0, "markers": markers}
    try:
        write_json(path, content)
    except OSError as error:
        raise TrackingError(
            f"can't write points '{path}': {error.strerror or error}; make room or allow writing there"
        ) from error


def write_pick_page(
    frame_image: Image, names: Sequence[str], video_name: str, path: str | Path, rest_markers: Array | None = None,
    frame: int = 0,
) -> Path:  # fmt: skip
    """Writes the page to click markers on. What it lets a person download is what `load_points` reads.

    Args:
        frame_image: The frame, upright, RGB. Shape (H, W, 3).
        names: Names of the robot's markers, head first.
        video_name: Name of the video, shown on the page and written into the points file.
        path: Path of the page.
        rest_markers: Marker positions of the robot in its rest pose, for a sketch of it [m]. Shape (M, 2).
        frame: Number of the frame.

    Returns:
        The path.

    Raises:
        ArgumentError: The image isn't one.
        TrackingError: The page can't be written.
    """
    height, width = _size(frame_image)
    data = {
        "names": list(names), "video": visible(video_name), "width": width, "height": height, "number": frame,
        "places": _places(len(names), rest_markers),
    }  # fmt: skip
    template = _TEMPLATE.read_text(encoding="utf-8")
    script = template[template.rindex("<script>") + len("<script>") : template.rindex("</script>")]
    parts = {
        "SCRIPTS": script_source(script),
        "VIDEO": html.escape(visible(video_name)),
        "DATA": json.dumps(data).replace("<", "\\u003c"),
        "IMAGE": "data:image/jpeg;base64," + base64.b64encode(_jpeg(frame_image)).decode("ascii"),
    }
    page = re.sub("@@([A-Z]+)@@", lambda match: parts[match.group(1)], template)
    path = Path(path)
    try:
        write_text(path, page)
    except OSError as error:
        raise TrackingError(
            f"can't write '{path}': {error.strerror or error}; give a place that can be written to with --out"
        ) from error
    return path


def _in_order(path: str | Path, markers: dict[str, list[float]], names: Sequence[str]) -> list[list[float]]:
    missing = [name for name in names if name not in markers]
    for name in markers:
        if name not in names:
            hint = did_you_mean(name.upper(), missing) or f"; known are {', '.join(names)}"
            raise TrackingError(f"points '{path}' hold an unknown marker {quoted(name)}{hint}")
    if missing:
        raise TrackingError(
            f"points '{path}' lack {', '.join(missing)}; expected are {len(names)} points, "
            f"one for each of {', '.join(names)}; {PICK_AGAIN}"
        )
    return [markers[name] for name in names]


def _check_places(path: str | Path, points: Array, names: Sequence[str], width: int, height: int) -> None:
    for name, (x, y) in zip(names, points, strict=True):
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise TrackingError(
                f"{name} of points '{path}' is at ({x:g}, {y:g}), outside of the frame of {width} x {height} px; "
                f"{PICK_AGAIN}"
            )
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    distances[np.tril_indices(len(points))] = np.inf
    first, second = divmod(int(np.argmin(distances)), len(points))
    if distances[first, second] < CLOSEST_PX:
        raise TrackingError(
            f"{names[first]} and {names[second]} of points '{path}' are {distances[first, second]:.1f} px apart; "
            f"two markers can't be on the same spot, so {PICK_AGAIN}"
        )


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
    buffer = BytesIO()
    # without subsampling a marker's color isn't blurred over its neighbors
    Picture.fromarray(np.ascontiguousarray(image)).save(buffer, "JPEG", quality=_JPEG_QUALITY, subsampling=0)
    return buffer.getvalue()
