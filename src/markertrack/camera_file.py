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

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from swimbase.arrays import Array
from swimbase.checking import Number, Positive, read
from swimbase.errors import ArgumentError, TrackingError
from swimbase.store import write_json, writing

FORMAT = 1
HIGHEST = 50.0  # m above the plane, from which no camera sees a marker
_SAME = 1e-3  # px, the ends of a length that are one
DISTORTIONS = (4, 5, 8, 12, 14)  # numbers of coefficients that OpenCV knows: k1, k2, p1, p2, k3, …


@dataclass(frozen=True)
class Lens:
    """A camera's intrinsics in OpenCV's convention.

    Attributes:
        camera_matrix: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]. Shape (3, 3).
        distortion: k1, k2, p1, p2, k3, … Shape (4,), (5,), (8,), (12,) or (14,).
    """

    camera_matrix: Array
    distortion: Array

    @property
    def center(self) -> Array:
        """The principal point [px]. Shape (2,)."""
        return self.camera_matrix[:2, 2]

    def undistort(self, points: Array) -> Array:
        """Moves points to where a pinhole camera of the same matrix would show them [px].

        Args:
            points: NaN stays NaN [px]. Shape (..., 2).
        """
        out = np.full(points.shape, np.nan)
        seen = np.isfinite(points).all(axis=-1)
        if seen.any():
            enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
            undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # before OpenCV 5, and since
            matrix, places = self.camera_matrix, points[seen][:, None]
            out[seen] = undistort(places, matrix, self.distortion, R=None, P=matrix, criteria=enough)[:, 0]
        return out

    def distort(self, points: Array) -> Array:
        """Moves points of a pinhole camera's picture to where this camera shows them; undoes `undistort` [px].

        Args:
            points: NaN stays NaN [px]. Shape (..., 2).
        """
        out = np.full(points.shape, np.nan)
        seen = np.isfinite(points).all(axis=-1)
        if seen.any():
            rays = np.column_stack([points[seen], np.ones(int(seen.sum()))]) @ np.linalg.inv(self.camera_matrix).T
            out[seen] = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.camera_matrix, self.distortion)[0][:, 0]
        return out


@dataclass(frozen=True)
class Length:
    """A known length in the pool.

    Attributes:
        name: Name, for messages.
        pixels: Its two ends [px]. Shape (2, 2).
        meters: How long it is [m].
    """

    name: str
    pixels: Array
    meters: float


@dataclass(frozen=True)
class CameraFile:
    """Knowledge of a person about a camera; nothing by default.

    Attributes:
        camera_height: Height above the plane of the head's markers [m].
        principal_point: The pixel straight below the camera [px]. Shape (2,).
        lengths: Known lengths at the height of the head's markers.
        points: Pixels [px] and meters [m] of the same points. Shapes (N, 2), N at least 4.
        homography: Homography from pixels to meters, instead of points. Shape (3, 3).
        lens: Distortion of the lens, which is taken out first.
    """

    camera_height: float | None = None
    principal_point: Array | None = None
    lengths: tuple[Length, ...] = ()
    points: tuple[Array, Array] | None = None
    homography: Array | None = None
    lens: Lens | None = None


def read_camera(path: str | Path) -> CameraFile:
    """Reads a camera file.

    Raises:
        TrackingError: The file isn't there or isn't JSON, or has an unknown key or a value that is not allowed; the
            message names it.
    """
    content = read(_Content, path, "camera file", TrackingError)
    return CameraFile(
        camera_height=content.camera_height,
        principal_point=None if content.principal_point is None else np.array(content.principal_point),
        lengths=tuple(
            Length(length.name or f"length {i}", np.array(length.pixels), length.meters)
            for i, length in enumerate(content.lengths, start=1)
        ),
        points=None if content.points is None else _stacked(content.points),
        homography=None if content.homography is None else np.array(content.homography),
        lens=None if content.lens is None else Lens(
            np.array(content.lens.camera_matrix), np.array(content.lens.distortion)
        ),
    )  # fmt: skip


def write_camera(path: str | Path, camera: CameraFile) -> None:
    """Writes a camera file that `read_camera` reads back.

    Raises:
        TrackingError: The file can't be written.
    """
    content: dict[str, object] = {"format": FORMAT}
    if camera.camera_height is not None:
        content["camera_height"] = camera.camera_height
    if camera.principal_point is not None:
        content["principal_point"] = camera.principal_point.tolist()
    if camera.lengths:
        content["lengths"] = [
            {"name": length.name, "pixels": length.pixels.tolist(), "meters": length.meters}
            for length in camera.lengths
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
    with writing(path, TrackingError, what="camera file"):
        write_json(path, content)


Sane = Annotated[Number, Field(ge=-1e9, le=1e9)]
"""A number that arithmetic doesn't overflow with, of any unit."""
Pair = Annotated[list[Sane], Field(min_length=2, max_length=2)]
Row = Annotated[list[Sane], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Row], Field(min_length=3, max_length=3)]


def _apart(pixels: list[list[float]]) -> list[list[float]]:
    if not math.dist(*pixels) > _SAME:
        raise ValueError("both ends are the same pixel; give the two ends of the length")
    return pixels


def _invertible(homography: list[list[float]]) -> list[list[float]]:
    plane = np.array(homography)
    if not abs(np.linalg.det(plane / max(np.abs(plane).max(), 1e-300))) >= 1e-15:
        raise ValueError("it can't be inverted; it must map the picture to a plane")
    return homography


def _intrinsic(matrix: list[list[float]]) -> list[list[float]]:
    if not (matrix[0][0] > 0 and matrix[1][1] > 0 and matrix[2] == [0, 0, 1]):
        raise ValueError("it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx and fy above 0")
    return matrix


def _known_distortion(coefficients: list[float]) -> list[float]:
    if len(coefficients) not in DISTORTIONS:
        allowed = ", ".join(map(str, DISTORTIONS))
        raise ValueError(f"it has {len(coefficients)} numbers; allowed are {allowed} (k1, k2, p1, p2, k3, …)")
    return coefficients


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


def _in_meters(height: float) -> float:
    if height > HIGHEST:
        raise ValueError(f"it is {height:g} m; it must be at most {HIGHEST:g} m, so this looks like millimeters")
    return height


class _Length(_Strict):
    name: str = ""
    pixels: Annotated[list[Pair], Field(min_length=2, max_length=2), AfterValidator(_apart)]
    meters: Annotated[Positive, Field(ge=1e-6, le=1e6)]


class _Point(_Strict):
    pixel: Pair
    meters: Pair


class _Lens(_Strict):
    camera_matrix: Annotated[Matrix, AfterValidator(_intrinsic)]
    distortion: Annotated[list[Sane], AfterValidator(_known_distortion)]


class _Content(_Strict):
    """Content of a camera file; see the top of this module."""

    format: Literal[1]
    camera_height: Annotated[Positive, AfterValidator(_in_meters)] | None = None
    principal_point: Pair | None = None
    lengths: list[_Length] = Field(default_factory=list[_Length])
    points: Annotated[list[_Point], Field(min_length=4)] | None = None
    homography: Annotated[Matrix, AfterValidator(_invertible)] | None = None
    lens: _Lens | None = None

    @model_validator(mode="after")
    def _one_plane(self) -> _Content:
        if self.points is not None and self.homography is not None:
            raise ValueError("it has both points and a homography; keep one of them")
        return self


def _stacked(points: list[_Point]) -> tuple[Array, Array]:
    return np.array([point.pixel for point in points]), np.array([point.meters for point in points])


def find_board(image: NDArray[np.uint8], squares: tuple[int, int], square_size: float) -> tuple[Array, Array]:
    """Finds the inner corners of a chessboard that lies in the water's plane.

    Args:
        image: Upright picture, gray or RGB. Shape (height, width) or (height, width, 3).
        squares: Along the board's two sides, as printed; one more than the inner corners.
        square_size: Side of a square [m].

    Returns:
        Corners [px] and their places on the board, y up [m]. Shapes (N, 2).

    Raises:
        ArgumentError: No board has these squares.
        TrackingError: The board isn't in the picture.
    """
    if min(squares) < 3:
        raise ArgumentError(f"squares are {squares[0]} x {squares[1]}; a board needs at least 3 along each side")
    if not (np.isfinite(square_size) and square_size > 0):
        raise ArgumentError(f"square_size is {square_size} m; it must be finite and above 0")
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    columns, rows = squares[0] - 1, squares[1] - 1
    for flags in (cv2.CALIB_CB_NORMALIZE_IMAGE, 0):  # a picture of full contrast may be lost by more of it
        seen, corners = cv2.findChessboardCornersSB(gray, (columns, rows), flags=flags | cv2.CALIB_CB_ACCURACY)
        if seen:
            break
    else:
        raise TrackingError(
            f"no chessboard of {squares[0]} x {squares[1]} squares is in the picture; count its squares (not its "
            f"corners), and let all of it be seen with a white border"
        )
    pixels = np.asarray(corners, dtype=float).reshape(rows, columns, 2)
    along, across = pixels[0, -1] - pixels[0, 0], pixels[-1, 0] - pixels[0, 0]
    downward = along[0] * across[1] - along[1] * across[0] > 0  # in a picture of the board's face from above
    row, column = np.mgrid[:rows, :columns]
    places = np.stack([column, -row if downward else row], axis=2) * square_size
    return pixels.reshape(-1, 2), places.reshape(-1, 2).astype(float)
