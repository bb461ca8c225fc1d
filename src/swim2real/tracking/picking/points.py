"""The points file: where each marker is in the first frame of a video.

`{"format": 1, "video": "swim.mp4", "width": 3840, "height": 2160, "frame": 0, "markers": {"M0": [x, y], …}}`, in pixels
of the upright frame; the center of the top-left pixel is (0, 0). A plain list of pairs, in the order of the markers, is
read as well.
"""

from __future__ import annotations

import difflib
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrackingError

Array = NDArray[np.float64]

FORMAT = 1
CLOSEST_PX = 2.0  # two markers nearer than this are one marker clicked twice
PICK_AGAIN = "pick the points again with `swim2real pick`"


def load_points(path: str | Path, names: Sequence[str], width: int, height: int) -> Array:
    """Reads a points file and checks it against the robot and the video.

    Args:
        path: Of the file.
        names: Of the robot's markers, head first.
        width: Of the video's upright frame [px].
        height: Of the video's upright frame [px].

    Returns:
        Points in the order of `names` [px]. Shape (M, 2).

    Raises:
        TrackingError: The file is missing, can't be read, or its points aren't of this robot and this video.
    """
    path = Path(path)
    content = _read(path)
    if isinstance(content, Mapping) and "markers" in content:
        given = cast("Mapping[str, Any]", content)
        _check_source(path, given, width, height)
        pairs = _by_name(path, given["markers"], names)
    elif isinstance(content, list):
        pairs = cast("list[Any]", content)
    else:
        raise TrackingError(
            f"points '{path}' hold neither 'markers' nor a plain list of [x, y]; {PICK_AGAIN}, which writes them right"
        )
    if len(pairs) != len(names):
        raise TrackingError(
            f"points '{path}' hold {len(pairs)} points; expected are {len(names)}, "
            f"one for each of {', '.join(names)}; {PICK_AGAIN}"
        )
    points = np.array([_pair(path, name, pair) for name, pair in zip(names, pairs, strict=True)], dtype=float)
    _check_places(path, points, names, width, height)
    return points


def save_points(path: str | Path, points: Array, names: Sequence[str], video: str, width: int, height: int) -> None:
    """Writes a points file.

    Args:
        path: Of the file.
        points: In the order of `names` [px]. Shape (M, 2).
        names: Of the robot's markers, head first.
        video: Name of the video that the points were picked on.
        width: Of its upright frame [px].
        height: Of its upright frame [px].

    Raises:
        TrackingError: The points couldn't be read back, or the file can't be written.
    """
    path = Path(path)
    if np.shape(points) != (len(names), 2):
        raise TrackingError(f"points have shape {np.shape(points)}; expected is ({len(names)}, 2), x and y of a marker")
    pairs = [_pair(path, name, [float(x), float(y)]) for name, (x, y) in zip(names, points, strict=True)]
    _check_places(path, np.array(pairs), names, width, height)
    markers = {name: [round(x, 3), round(y, 3)] for name, (x, y) in zip(names, pairs, strict=True)}
    content = {"format": FORMAT, "video": video, "width": width, "height": height, "frame": 0, "markers": markers}
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise TrackingError(
            f"can't write points '{path}': {error.strerror or error}; make room or allow writing there"
        ) from error


def _read(path: Path) -> object:
    if not path.is_file():
        kind = "not a file" if path.exists() else "not there"
        raise TrackingError(f"points '{path}' are {kind}; `swim2real pick VIDEO` makes a page to pick them on")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise TrackingError(f"points '{path}' can't be read as JSON ({error}); {PICK_AGAIN}") from error


def _check_source(path: Path, content: Mapping[str, Any], width: int, height: int) -> None:
    if content.get("format", FORMAT) != FORMAT:
        raise TrackingError(
            f"points '{path}' have format {content['format']!r}; this version reads format {FORMAT}; {PICK_AGAIN}"
        )
    if content.get("frame", 0) != 0:
        raise TrackingError(
            f"points '{path}' were picked on frame {content['frame']!r}; tracking starts on frame 0; {PICK_AGAIN}"
        )
    size = content.get("width", width), content.get("height", height)
    if size != (width, height):
        raise TrackingError(
            f"points '{path}' were picked on a frame of {size[0]} x {size[1]} px; "
            f"the video's is {width} x {height} px; {PICK_AGAIN} on this video"
        )


def _by_name(path: Path, markers: object, names: Sequence[str]) -> list[Any]:
    if not isinstance(markers, Mapping):
        raise TrackingError(f"'markers' of points '{path}' is not an object of names and [x, y]; {PICK_AGAIN}")
    pairs = cast("Mapping[str, Any]", markers)
    missing = [name for name in names if name not in pairs]
    for name in pairs:
        if name not in names:
            near = difflib.get_close_matches(name.upper(), missing, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; known are {', '.join(names)}"
            raise TrackingError(f"points '{path}' hold an unknown marker '{name}'{hint}")
    if missing:
        raise TrackingError(
            f"points '{path}' lack {', '.join(missing)}; expected are {len(names)} points, "
            f"one for each of {', '.join(names)}; {PICK_AGAIN}"
        )
    return [pairs[name] for name in names]


def _pair(path: Path, name: str, pair: object) -> list[float]:
    values = cast("list[Any]", pair) if isinstance(pair, list) else []
    if len(values) != 2 or not all(
        isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in values
    ):
        raise TrackingError(
            f"{name} of points '{path}' is {json.dumps(pair)}; it must be [x, y], two finite numbers in pixels"
        )
    return [float(value) for value in values]


def _check_places(path: Path, points: Array, names: Sequence[str], width: int, height: int) -> None:
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
