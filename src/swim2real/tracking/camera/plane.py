"""Maps between two planes, the picture's and the water's: homographies. Arrays only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrackingError

Array = NDArray[np.float64]

_FLATTEST = 1e-3  # of the fit's singular values, below which the points are (nearly) on a line


def project(plane: Array, points: Array) -> Array:
    """Points through a homography; NaN where they were NaN or lie on the other side of the horizon.

    Args:
        plane: Homography. Shape (3, 3).
        points: Shape (..., 2).
    """
    mapped = points @ plane[:, :2].T + plane[:, 2]
    weights = np.where(mapped[..., 2:] > 0, mapped[..., 2:], np.nan)
    return mapped[..., :2] / weights


def fit_plane(points: Array, targets: Array) -> tuple[Array, float]:
    """The homography from points to targets (direct linear transform of normalized points).

    Args:
        points: At least 4, no 3 of 4 on a line. Shape (N, 2).
        targets: Where they are to lie. Shape (N, 2).

    Returns:
        Homography (3, 3), with all points on the near side of the horizon, and the root mean square distance of the
        mapped points from the targets, in the targets' unit.

    Raises:
        TrackingError: The points don't determine a homography.
    """
    if len(points) < 4:
        raise TrackingError(f"{len(points)} points for a plane; at least 4 are needed")
    from_points, from_targets = _normalizer(points), _normalizer(targets)
    p, q = project(from_points, points), project(from_targets, targets)
    ones, zeros = np.ones((len(p), 1)), np.zeros((len(p), 3))
    homogeneous = np.hstack([p, ones])
    for_x = np.hstack([homogeneous, zeros, -q[:, :1] * homogeneous])
    for_y = np.hstack([zeros, homogeneous, -q[:, 1:] * homogeneous])
    rows = np.vstack([for_x, for_y])
    _, sizes, directions = np.linalg.svd(rows)
    if sizes[7] < _FLATTEST * sizes[0]:
        raise TrackingError("the points don't determine a plane: they coincide or lie on a line; spread them out")
    plane = np.linalg.inv(from_targets) @ directions[8].reshape(3, 3) @ from_points
    weights = np.hstack([points, ones]) @ plane[2]
    if weights.mean() < 0:
        plane, weights = -plane, -weights
    if np.any(weights <= 0):
        raise TrackingError("the points are no picture of a plane: some lie beyond its horizon; check their order")
    plane = plane / weights.mean()
    return plane, float(np.sqrt(((project(plane, points) - targets) ** 2).sum(axis=1).mean()))


def local_scale(plane: Array, point: Array) -> float:
    """Targets' units per point's unit at a point; negative where the map keeps the sense of turning (no mirror image).

    The picture's y points down and the world's up, so a map to the world must turn it over and is positive here.
    """
    x, y, w = plane @ np.array([point[0], point[1], 1.0])
    jacobian = (plane[:2, :2] * w - np.outer([x, y], plane[2, :2])) / w**2
    area = float(np.linalg.det(jacobian))
    return float(np.copysign(np.sqrt(abs(area)), -area))


def _normalizer(points: Array) -> Array:
    """Moves the points' center to 0 and their mean distance to 1. Shape (3, 3)."""
    center = points.mean(axis=0)
    size = float(np.linalg.norm(points - center, axis=1).mean())
    if not size > 0:
        raise TrackingError("the points don't determine a plane: they coincide or lie on a line; spread them out")
    return np.array([[1, 0, -center[0]], [0, 1, -center[1]], [0, 0, size]]) / size
