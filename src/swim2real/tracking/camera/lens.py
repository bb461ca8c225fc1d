"""What needs OpenCV of a camera: a lens that bends straight lines, and a chessboard that shows the plane."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError, MissingExtraError, TrackingError

Array = NDArray[np.float64]

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
        """Where points would lie in the picture of a pinhole camera of the same matrix [px].

        Args:
            points: NaN stays NaN [px]. Shape (..., 2).

        Raises:
            MissingExtraError: OpenCV isn't installed.
        """
        cv2 = _opencv("the lens in a camera file")
        out = np.full(points.shape, np.nan)
        seen = np.isfinite(points).all(axis=-1)
        if seen.any():
            enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
            out[seen] = cv2.undistortPoints(
                points[seen][:, None], self.camera_matrix, self.distortion, P=self.camera_matrix, criteria=enough
            )[:, 0]
        return out


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
        MissingExtraError: OpenCV isn't installed.
    """
    if min(squares) < 3:
        raise ArgumentError(f"squares are {squares[0]} x {squares[1]}; a board needs at least 3 along each side")
    if not (np.isfinite(square_size) and square_size > 0):
        raise ArgumentError(f"square_size is {square_size} m; it must be finite and above 0")
    cv2 = _opencv("a chessboard")
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    columns, rows = squares[0] - 1, squares[1] - 1
    found, corners = cv2.findChessboardCornersSB(
        gray, (columns, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    )
    if not found:
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


def _opencv(wanted_by: str) -> Any:
    try:
        return import_module("cv2")
    except ImportError:
        raise MissingExtraError(f"{wanted_by} needs OpenCV; install it with: pip install 'swim2real[opencv]'") from None
