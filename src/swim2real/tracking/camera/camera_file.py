"""The camera file: what a person knows about the camera, `camera.json`.

```
{"format": 1,
 "camera_height": 2.0,                     meters above the plane of the head's markers
 "principal_point": [1919.5, 1079.5],      the pixel straight below the camera; for one that looks straight down the
                                           picture's center, which is taken when nothing is given
 "lengths": [{"name": "tape", "pixels": [[x, y], [x, y]], "meters": 0.5}, …],
 "points": [{"pixel": [x, y], "meters": [x, y]}, …],    four or more, or "homography": 3 x 3, pixels to meters
 "lens": {"camera_matrix": 3 x 3, "distortion": [k1, k2, p1, p2, k3]}}
```

All but `format` may be left out. Lengths and points lie at the height of the head's markers; the meters' y points up.
Pixels are those of the upright video; the center of the top-left one is (0, 0).
"""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrackingError
from swim2real.tracking.camera.lens import DISTORTIONS, Lens, find_board

Array = NDArray[np.float64]

FORMAT = 1
_KEYS = ("format", "camera_height", "principal_point", "lengths", "points", "homography", "lens")


@dataclass(frozen=True)
class Length:
    """A known length in the pool.

    Attributes:
        name: For messages.
        pixels: Its two ends [px]. Shape (2, 2).
        meters: How long it is [m].
    """

    name: str
    pixels: Array
    meters: float


@dataclass(frozen=True)
class CameraFile:
    """What a person knows about a camera; nothing by default.

    Attributes:
        camera_height: Above the plane of the head's markers [m].
        principal_point: The pixel straight below the camera [px]. Shape (2,).
        lengths: Known lengths at the height of the head's markers.
        points: Pixels [px] and meters [m] of the same points. Shapes (N, 2), N at least 4.
        homography: From pixels to meters, instead of points. Shape (3, 3).
        lens: Its distortion, taken out first.
    """

    camera_height: float | None = None
    principal_point: Array | None = None
    lengths: tuple[Length, ...] = ()
    points: tuple[Array, Array] | None = None
    homography: Array | None = None
    lens: Lens | None = None


def camera_from_board(image: NDArray[np.uint8], squares: tuple[int, int], square_size: float) -> CameraFile:
    """A camera whose plane is that of a chessboard, which lies (or floats) at the height of the head's markers.

    Args:
        image: Upright frame of the video, gray or RGB. Shape (height, width) or (height, width, 3).
        squares: Along the board's two sides.
        square_size: Side of a square [m].

    Raises:
        ArgumentError: No board has these squares.
        TrackingError: The board isn't in the picture.
        MissingExtraError: OpenCV isn't installed.
    """
    return CameraFile(points=find_board(image, squares, square_size))


def write_camera(path: str | Path, camera: CameraFile) -> None:
    """Writes a camera file that `read_camera` reads back.

    Raises:
        TrackingError: The file can't be written.
    """
    content: dict[str, Any] = {"format": FORMAT}
    if camera.camera_height is not None:
        content["camera_height"] = camera.camera_height
    if camera.principal_point is not None:
        content["principal_point"] = camera.principal_point.tolist()
    if camera.lengths:
        content["lengths"] = [
            {"name": one.name, "pixels": one.pixels.tolist(), "meters": one.meters} for one in camera.lengths
        ]
    if camera.points is not None:
        content["points"] = [
            {"pixel": pixel.tolist(), "meters": meters.tolist()} for pixel, meters in zip(*camera.points, strict=True)
        ]
    if camera.homography is not None:
        content["homography"] = camera.homography.tolist()
    if camera.lens is not None:
        content["lens"] = {
            "camera_matrix": camera.lens.camera_matrix.tolist(), "distortion": camera.lens.distortion.tolist(),
        }  # fmt: skip
    place = Path(path)
    part = place.with_name(place.name + ".part")
    try:
        part.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(part, place)
    except OSError as error:
        raise TrackingError(f"can't write camera file '{place}': {error.strerror or error}") from error


def read_camera(path: str | Path) -> CameraFile:
    """Reads a camera file.

    Raises:
        TrackingError: Not there, not JSON, an unknown key or a value that is not allowed; the message names it.
    """
    where = f"camera file '{path}'"
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise TrackingError(f"{where} is not there") from None
    except (OSError, ValueError, RecursionError) as error:
        raise TrackingError(f"{where} can't be read as JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else type(content).__name__
        raise TrackingError(f"{where}: format is {found!r}; this version reads format {FORMAT}")
    given = _keys(content, where, _KEYS)
    if "points" in given and "homography" in given:
        raise TrackingError(f"{where} has both points and a homography; keep one of them")
    height, homography = given.get("camera_height"), given.get("homography")
    plane = None if homography is None else _array(homography, (3, 3), f"{where}: homography")
    if plane is not None and abs(np.linalg.det(plane / np.abs(plane).max())) < 1e-15:
        raise TrackingError(f"{where}: homography can't be inverted; it must map the picture to a plane")
    principal = given.get("principal_point")
    return CameraFile(
        None if height is None else _positive(height, f"{where}: camera_height", "m"),
        None if principal is None else _array(principal, (2,), f"{where}: principal_point"),
        _lengths(given.get("lengths", []), where),
        _points(given["points"], where) if "points" in given else None,
        plane,
        _lens(given["lens"], where) if "lens" in given else None,
    )


def _lengths(given: object, where: str) -> tuple[Length, ...]:
    found: list[Length] = []
    for i, entry in enumerate(_list(given, f"{where}: lengths")):
        what = f"{where}: lengths[{i}]"
        one = _keys(entry, what, ("name", "pixels", "meters"), needed=("pixels", "meters"))
        pixels = _array(one["pixels"], (2, 2), f"{what}: pixels")
        if not np.linalg.norm(pixels[1] - pixels[0]) > 0:
            raise TrackingError(f"{what}: both ends are the same pixel; give the two ends of the length")
        name = str(one.get("name", f"length {i + 1}"))
        found.append(Length(name, pixels, _positive(one["meters"], f"{what}: meters", "m")))
    return tuple(found)


def _points(given: object, where: str) -> tuple[Array, Array]:
    entries = _list(given, f"{where}: points")
    if len(entries) < 4:
        raise TrackingError(f"{where}: points are {len(entries)}; a plane needs at least 4")
    pixels, meters = np.empty((len(entries), 2)), np.empty((len(entries), 2))
    for i, entry in enumerate(entries):
        what = f"{where}: points[{i}]"
        one = _keys(entry, what, ("pixel", "meters"), needed=("pixel", "meters"))
        pixels[i] = _array(one["pixel"], (2,), f"{what}: pixel")
        meters[i] = _array(one["meters"], (2,), f"{what}: meters")
    return pixels, meters


def _lens(given: object, where: str) -> Lens:
    what = f"{where}: lens"
    keys = ("camera_matrix", "distortion")
    one = _keys(given, what, keys, needed=keys)
    matrix = _array(one["camera_matrix"], (3, 3), f"{what}: camera_matrix")
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and np.array_equal(matrix[2], [0, 0, 1])):
        raise TrackingError(f"{what}: camera_matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx and fy above 0")

    coefficients = _list(one["distortion"], f"{what}: distortion")
    if len(coefficients) not in DISTORTIONS:
        raise TrackingError(
            f"{what}: distortion has {len(coefficients)} numbers; allowed are {', '.join(map(str, DISTORTIONS))} "
            f"(k1, k2, p1, p2, k3, …)"
        )
    return Lens(matrix, _array(coefficients, (len(coefficients),), f"{what}: distortion"))


def _keys(given: object, what: str, allowed: tuple[str, ...], needed: tuple[str, ...] = ()) -> Mapping[str, Any]:
    if not isinstance(given, dict):
        raise TrackingError(f"{what} is {given!r}; it must be an object with {', '.join(allowed)}")
    content = cast("dict[str, Any]", given)
    for key in content:
        if key not in allowed:
            near = difflib.get_close_matches(key, allowed, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise TrackingError(f"{what} has an unknown key '{key}'; allowed are {', '.join(allowed)}{hint}")
    for key in needed:
        if key not in content:
            raise TrackingError(f"{what} has no '{key}'; it needs {', '.join(needed)}")
    return content


def _list(given: object, what: str) -> list[Any]:
    if not isinstance(given, list):
        raise TrackingError(f"{what} is {given!r}; it must be a list")
    return cast("list[Any]", given)


def _array(given: object, shape: tuple[int, ...], what: str) -> Array:
    try:
        array = np.array(given, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.all(np.isfinite(array)):
        size = " x ".join(map(str, shape))
        raise TrackingError(f"{what} is {given!r}; it must be {size} finite numbers")
    return array


def _positive(given: object, what: str, unit: str) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not (np.isfinite(given) and given > 0):
        raise TrackingError(f"{what} is {given!r}; it must be a number of {unit} above 0")
    return float(given)
