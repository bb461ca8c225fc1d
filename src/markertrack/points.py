"""Markers placed by a person: points files and corrections files.

The points file is `{"format": 1, "video": "swim.mp4", "width": 3840, "height": 2160, "frame": 0, "markers": {"M0": [x,
y], …}}`, in pixels of the upright frame; the center of the top-left pixel is (0, 0). A plain list of pairs, in the
order of the markers, is read as well. A corrections file has several frames in place of one, `"frames": [{"frame": 120,
"markers": {"M3": [x, y], "M4": null}}, …]`: of a marker that isn't named in a frame nothing is said, and null says that
it is hidden there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, model_validator

from markertrack.tracking.tracker import Array, Mask
from swimbase.checking import Number, did_you_mean, read
from swimbase.errors import TrackingError
from swimbase.escaping import visible
from swimbase.names import composed, quoted
from swimbase.store import write_json, writing

_Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
_FrameNumber = Annotated[int, Field(ge=0, strict=True)]
_Markers = Mapping[str, list[float] | None]  # places by name, None where hidden

_CLOSEST = 2.0  # px; two markers nearer than this are one marker clicked twice
_PICK_AGAIN = "pick the points again with `swim2real pick`"
_CORRECT_AGAIN = "make it again with `swim2real ui`, or correct it by hand"


@dataclass(frozen=True)
class Anchor:
    """Markers of one frame, as a person placed them.

    Attributes:
        frame: Number of the frame in the video.
        points: Where the markers are, NaN where nothing is said or a marker is hidden [px]. Shape (M, 2).
        hidden: True where a marker is said to be hidden. Shape (M,).
    """

    frame: int
    points: Array
    hidden: Mask


class _Entry(BaseModel, extra="forbid"):
    """Entry of a corrections file for one frame."""

    frame: _FrameNumber
    markers: dict[str, _Pair | None]


class MarkersFile(BaseModel, extra="forbid"):
    """Content of a file: markers of one frame by name, a plain list of points, or markers of several frames."""

    format: Literal[1] = 1
    video: str | None = None
    width: int | None = None
    height: int | None = None
    frame: _FrameNumber | None = None
    markers: dict[str, _Pair | None] | None = None
    points: list[_Pair] | None = None
    frames: list[_Entry] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, content: Any) -> Any:
        return {"points": content} if isinstance(content, list) else content


@dataclass(frozen=True)
class _Checked:
    """A file by its name in messages, what it must fit, and what to do where it doesn't."""

    file: str
    names: Sequence[str]
    width: int
    height: int
    remedy: str

    def check_size(self, content: MarkersFile) -> None:
        width, height = content.width or self.width, content.height or self.height
        if (width, height) != (self.width, self.height):
            raise TrackingError(
                f"{self.file} were picked on a frame of {width} x {height} px; the video's is {self.width} x "
                f"{self.height} px; {self.remedy}"
            )

    def check_names(self, said: _Markers) -> None:
        for name in said:
            if name not in self.names:
                free = [known for known in self.names if known not in said]
                hint = did_you_mean(name.upper(), free) or f"; known are {', '.join(self.names)}"
                raise TrackingError(f"{self.file}: unknown marker {quoted(name)}{hint}")

    def all_named(self, content: MarkersFile) -> _Markers:
        """Reads a points file that must name every marker."""
        expected = f"expected are {len(self.names)}, one for each of {', '.join(self.names)}; {self.remedy}"
        if content.markers is not None:
            self.check_names(content.markers)
            if missing := [name for name in self.names if name not in content.markers]:
                raise TrackingError(f"{self.file} lack {', '.join(missing)}; {expected}")
            return content.markers
        if content.points is None:
            raise TrackingError(f"{self.file} hold neither 'markers' nor a plain list of [x, y]; {self.remedy}")
        if len(content.points) != len(self.names):
            raise TrackingError(f"{self.file} hold {len(content.points)} points; {expected}")
        return dict(zip(self.names, content.points, strict=True))

    def anchor(self, frame: int, said: _Markers) -> Anchor:
        points = np.array([said.get(name) or (np.nan, np.nan) for name in self.names], dtype=float).reshape(-1, 2)
        placed = [m for m, name in enumerate(self.names) if said.get(name)]
        replace(self, names=[self.names[m] for m in placed]).check_places(points[placed])
        return Anchor(frame, points, np.array([name in said and said[name] is None for name in self.names], dtype=bool))

    def check_places(self, points: Array) -> None:
        for name, (x, y) in zip(self.names, points, strict=True):
            if not (-0.5 <= x <= self.width - 0.5 and -0.5 <= y <= self.height - 0.5):
                raise TrackingError(
                    f"{name} of {self.file} is at ({x:g}, {y:g}), outside of the frame of {self.width} x {self.height} "
                    f"px; {self.remedy}"
                )
        apart = np.linalg.norm(points[:, None] - points, axis=2)
        apart[np.tril_indices(len(points))] = np.inf
        if apart.min(initial=np.inf) < _CLOSEST:
            first, second = divmod(int(np.argmin(apart)), len(points))
            raise TrackingError(
                f"{self.names[first]} and {self.names[second]} of {self.file} are {apart.min():.1f} px apart; two "
                f"markers can't be on the same spot, so {self.remedy}"
            )


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
    content = read(MarkersFile, path, "points", TrackingError, f"{_PICK_AGAIN} (`swim2real pick VIDEO`)")
    checked = _Checked(f"points '{path}'", names, width, height, _PICK_AGAIN)
    if content.frames is not None:
        count = len(content.frames)
        raise TrackingError(f"{checked.file} are corrections, of {count} frames; give them with --corrections")
    checked.check_size(content)
    frame = first if content.frame is None else content.frame
    if frame < first:
        raise TrackingError(
            f"{checked.file} were picked in frame {frame} of the video; tracking begins with frame {first}; pick them "
            f"there or later (--from of `swim2real pick`), or begin earlier (--from of `swim2real track`)"
        )
    anchor = checked.anchor(frame, checked.all_named(content))
    if anchor.hidden.any():
        name = names[int(np.argmax(anchor.hidden))]
        raise TrackingError(f"{checked.file}: 'markers.{name}' is null; it must be a list, [x, y]; {_PICK_AGAIN}")
    return anchor


def load_anchors(
    path: str | Path, names: Sequence[str], width: int, height: int, video_name: str
) -> tuple[Anchor, ...]:  # fmt: skip
    """Reads a corrections file, or a points file as the corrections of one frame, and checks it as `load_points` does.

    Args:
        path: Path of the file.
        names: Names of the robot's markers, head first.
        width: Width of the video's upright frame [px].
        height: Height of the video's upright frame [px].
        video_name: Name of the video, which corrections must be of.

    Returns:
        What is said of each frame, first frame first. A frame that nothing is said of is left out.
    """
    content = read(MarkersFile, path, "corrections", TrackingError, _CORRECT_AGAIN)
    if content.frames is None:
        checked = _Checked(f"points '{path}'", names, width, height, _PICK_AGAIN)
        checked.check_size(content)
        return (checked.anchor(content.frame or 0, checked.all_named(content)),)
    checked = _Checked(f"corrections '{path}'", names, width, height, _CORRECT_AGAIN)
    if content.markers is not None:
        raise TrackingError(f"{checked.file} hold both 'frames' and 'markers'; put the markers into one of the frames")
    if content.video is not None and _shown(content.video) != _shown(video_name):
        raise TrackingError(
            f"{checked.file}: these corrections are of {quoted(content.video)}; the video is {quoted(video_name)}; "
            f"give each video its own, or, where it is the same film under another name, change 'video' there"
        )
    checked.check_size(content)
    frames: dict[int, dict[str, list[float] | None]] = {}
    for entry in content.frames:
        said = frames.setdefault(entry.frame, {})
        for name, place in entry.markers.items():
            if said.setdefault(name, place) != place:
                raise TrackingError(
                    f"{checked.file}: frame {entry.frame} comes twice and says that {name} is {_told(said[name])} and "
                    f"that it is {_told(place)}; remove one of them"
                )
    anchors: list[Anchor] = []
    for frame in sorted(frame for frame, said in frames.items() if said):
        of_frame = replace(checked, file=f"frame {frame} of {checked.file}")
        of_frame.check_names(frames[frame])
        anchors.append(of_frame.anchor(frame, frames[frame]))
    return tuple(anchors)


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
    _Checked(f"points '{path}'", names, width, height, _PICK_AGAIN).check_places(np.asarray(points, dtype=float))
    markers = {name: [round(x, 3), round(y, 3)] for name, (x, y) in zip(names, points.tolist(), strict=True)}
    content = {"format": 1, "video": video, "width": width, "height": height, "frame": 0, "markers": markers}
    with writing(path, TrackingError, "make room or allow writing there", what="points"):
        write_json(path, content)


def _shown(video: str) -> str:
    """A film's name as pages write it into their files."""
    return composed(visible(video))


def _told(place: list[float] | None) -> str:
    return "hidden" if place is None else f"at ({place[0]:g}, {place[1]:g})"
