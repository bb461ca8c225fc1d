"""Where a person says that markers are: the files, and the page on which a first frame's are clicked.

The points file is `{"format": 1, "video": "swim.mp4", "width": 3840, "height": 2160, "frame": 0, "markers": {"M0": [x,
y], …}}`, in pixels of the upright frame; the center of the top-left pixel is (0, 0). A plain list of pairs, in the
order of the markers, is read as well. A corrections file has several frames in place of one, `"frames": [{"frame": 120,
"markers": {"M3": [x, y], "M4": null}}, …]`: of a marker that isn't named in a frame nothing is said, and null says that
it is hidden there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from swim2real.checking import Number, did_you_mean, read
from swim2real.errors import ArgumentError, TrackingError
from swim2real.escaping import visible
from swim2real.names import composed, quoted
from swim2real.store import write_json
from swim2real.tracking.page import jpeg_source, write_page

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
FrameNumber = Annotated[int, Field(ge=0, strict=True)]

FORMAT = 1
CLOSEST_PX = 2.0  # two markers nearer than this are one marker clicked twice
PICK_AGAIN = "pick the points again with `swim2real pick`"
CORRECT_AGAIN = "make it again on the page of this video's doubtful stretches, or correct it by hand"
_JPEG_QUALITY = 95  # keeps a 4K frame at some megabytes
_TEMPLATE = Path(__file__).with_name("picker.html")


@dataclass(frozen=True)
class Anchor:
    """What a person says of one frame.

    Attributes:
        frame: Number of the frame in the video.
        points: Where the markers are, NaN where nothing is said or a marker is hidden [px]. Shape (M, 2).
        hidden: True where a marker is said to be hidden. Shape (M,).
    """

    frame: int
    points: Array
    hidden: Mask


class _Entry(BaseModel):
    """What a corrections file says of one frame: a marker's place, or null where it is hidden."""

    frame: FrameNumber
    markers: dict[str, Pair | None]


class _Content(BaseModel):
    """What a file says: markers of one frame by name, a plain list of points, or markers of several frames."""

    format: Literal[1] = 1
    video: str | None = None
    width: int | None = None
    height: int | None = None
    frame: FrameNumber | None = None
    markers: dict[str, Pair | None] | None = None
    points: list[Pair] | None = None
    frames: list[_Entry] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, content: Any) -> Any:
        return {"points": content} if isinstance(content, list) else content


def load_points(path: str | Path, names: Sequence[str], width: int, height: int, first: int = 0) -> Anchor:
    """Reads a points file and checks it against the robot and the video. Every marker must have a place.

    Args:
        path: Path of the file.
        names: Names of the robot's markers, head first.
        width: Width of the video's upright frame [px].
        height: Height of the video's upright frame [px].
        first: Number of the first frame that is tracked, of which points are that name no frame.

    Returns:
        Points in the order of `names`, and their frame.

    Raises:
        TrackingError: The file is missing, can't be read, or its points aren't of this robot and this video.
    """
    content = read(_Content, path, "points", TrackingError, f"{PICK_AGAIN} (`swim2real pick VIDEO`)")
    file = f"points '{path}'"
    if content.frames is not None:
        raise TrackingError(f"{file} are corrections, of {len(content.frames)} frames; give them with --corrections")
    _check_size(content, file, width, height, f"{PICK_AGAIN} on this video")
    frame = first if content.frame is None else content.frame
    if frame < first:
        raise TrackingError(
            f"{file} were picked in frame {frame} of the video; tracking begins with frame {first}; pick them there "
            f"or later (--from of `swim2real pick`), or begin earlier (--from of `swim2real track`)"
        )
    anchor = _anchor(frame, _all_named(content, names, file), names, width, height, file, PICK_AGAIN)
    if anchor.hidden.any():
        name = names[int(np.argmax(anchor.hidden))]
        raise TrackingError(f"{file}: 'markers.{name}' is null; it must be a list, [x, y]; {PICK_AGAIN}")
    return anchor


def load_anchors(
    path: str | Path, names: Sequence[str], width: int, height: int, video_name: str
) -> tuple[Anchor, ...]:  # fmt: skip
    """Reads a corrections file, or a points file as the corrections of one frame, and checks it likewise.

    Args:
        path: Path of the file.
        names: Names of the robot's markers, head first.
        width: Width of the video's upright frame [px].
        height: Height of the video's upright frame [px].
        video_name: Name of the video, which corrections must be of.

    Returns:
        What is said of each frame, first frame first. A frame that nothing is said of is left out.

    Raises:
        TrackingError: The file is missing, can't be read, contradicts itself, or isn't of this robot and this video.
    """
    content = read(_Content, path, "corrections", TrackingError, CORRECT_AGAIN)
    if content.frames is None:
        file = f"points '{path}'"
        _check_size(content, file, width, height, f"{PICK_AGAIN} on this video")
        said = _all_named(content, names, file)
        return (_anchor(content.frame or 0, said, names, width, height, file, PICK_AGAIN),)
    file = f"corrections '{path}'"
    if content.markers is not None:
        raise TrackingError(f"{file} hold both 'frames' and 'markers'; put the markers into one of the frames")
    if content.video is not None and _shown(content.video) != _shown(video_name):
        raise TrackingError(
            f"{file}: these corrections are of {quoted(content.video)}; the video is {quoted(video_name)}; give each "
            f"video its own, or, where it is the same film under another name, change 'video' there"
        )
    _check_size(content, file, width, height, CORRECT_AGAIN)
    frames: dict[int, dict[str, list[float] | None]] = {}
    for entry in content.frames:
        _check_names(entry.markers, names, f"frame {entry.frame} of {file}")
        said = frames.setdefault(entry.frame, {})
        for name, place in entry.markers.items():
            before = said.setdefault(name, place)
            if before != place:
                raise TrackingError(
                    f"{file}: frame {entry.frame} comes twice and says that {name} is {_told(before)} and that it is "
                    f"{_told(place)}; remove one of them"
                )
    return tuple(
        _anchor(frame, frames[frame], names, width, height, f"frame {frame} of {file}", CORRECT_AGAIN)
        for frame in sorted(frames)
        if frames[frame]
    )


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
    _check_places(f"points '{path}'", places, names, width, height, PICK_AGAIN)
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
    image = jpeg_source(frame_image, _JPEG_QUALITY)
    remedy = "give a place that can be written to with --out"
    return write_page(_TEMPLATE, path, video_name, data, remedy, IMAGE=image)


def _check_size(content: _Content, file: str, width: int, height: int, remedy: str) -> None:
    size = content.width or width, content.height or height
    if size != (width, height):
        raise TrackingError(
            f"{file} were picked on a frame of {size[0]} x {size[1]} px; the video's is {width} x {height} px; {remedy}"
        )


def _all_named(content: _Content, names: Sequence[str], file: str) -> Mapping[str, list[float] | None]:
    """What a points file says, of every marker."""
    if content.markers is None and content.points is None:
        raise TrackingError(
            f"{file} hold neither 'markers' nor a plain list of [x, y]; {PICK_AGAIN}, which writes them right"
        )
    remedy = f"one for each of {', '.join(names)}; {PICK_AGAIN}"
    if content.markers is None:
        pairs = content.points or []
        if len(pairs) != len(names):
            raise TrackingError(f"{file} hold {len(pairs)} points; expected are {len(names)}, {remedy}")
        return dict(zip(names, pairs, strict=True))
    _check_names(content.markers, names, file)
    missing = [name for name in names if name not in content.markers]
    if missing:
        raise TrackingError(f"{file} lack {', '.join(missing)}; expected are {len(names)} points, {remedy}")
    return content.markers


def _anchor(
    frame: int, said: Mapping[str, list[float] | None], names: Sequence[str], width: int, height: int, file: str,
    remedy: str,
) -> Anchor:  # fmt: skip
    points = np.array([said.get(name) or (np.nan, np.nan) for name in names], dtype=float).reshape(-1, 2)
    placed = [m for m, name in enumerate(names) if said.get(name)]
    _check_places(file, points[placed], [names[m] for m in placed], width, height, remedy)
    return Anchor(frame, points, np.array([name in said and said[name] is None for name in names], dtype=bool))


def _check_names(said: Mapping[str, Any], names: Sequence[str], file: str) -> None:
    for name in said:
        if name not in names:
            free = [known for known in names if known not in said]
            hint = did_you_mean(name.upper(), free) or f"; known are {', '.join(names)}"
            raise TrackingError(f"{file}: unknown marker {quoted(name)}{hint}")


def _check_places(file: str, points: Array, names: Sequence[str], width: int, height: int, remedy: str) -> None:
    for name, (x, y) in zip(names, points, strict=True):
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise TrackingError(
                f"{name} of {file} is at ({x:g}, {y:g}), outside of the frame of {width} x {height} px; {remedy}"
            )
    if len(points) < 2:
        return
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    distances[np.tril_indices(len(points))] = np.inf
    first, second = divmod(int(np.argmin(distances)), len(points))
    if distances[first, second] < CLOSEST_PX:
        raise TrackingError(
            f"{names[first]} and {names[second]} of {file} are {distances[first, second]:.1f} px apart; "
            f"two markers can't be on the same spot, so {remedy}"
        )


def _shown(video: str) -> str:
    """A film's name as pages write it into their files."""
    return composed(visible(video))


def _told(place: list[float] | None) -> str:
    return "hidden" if place is None else f"at ({place[0]:g}, {place[1]:g})"


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
