"""How the picture lies on the water's plane: homographies, and how large a pixel is, by several known lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrackingError

Array = NDArray[np.float64]

DISAGREEMENT = 0.02  # of the scale, by which known lengths may differ before a person is told
MOST_LISTED = 10  # estimates of a scale that are listed
LEVEL = 1e-3  # m, heights that count as the same
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


@dataclass(frozen=True)
class Scale:
    """How large a pixel is, and how well that is known.

    Attributes:
        meters_per_pixel: The one that is used [m].
        spread: Range of all estimates, relative to it.
        estimates: Name of each known length, and what it says by itself [m].
        body_length: Length of the robot, which says what a doubt means in millimeters [m]; 0 when unknown.
    """

    meters_per_pixel: float
    spread: float
    estimates: tuple[tuple[str, float], ...]
    body_length: float = 0.0

    def findings(self) -> list[str]:
        """A sentence when the estimates disagree by more than 2 %."""
        if self.spread <= DISAGREEMENT:
            return []
        listed = [f"{name} {1e3 * value:.4f}" for name, value in self.estimates]
        if len(listed) > MOST_LISTED:
            ordered = [listed[i] for i in np.argsort([value for _, value in self.estimates])]
            half = MOST_LISTED // 2
            listed = [*ordered[:half], f"{len(listed) - 2 * half} between", *ordered[-half:]]
        meaning = f" (1 % is {10 * self.body_length:.0f} mm at the last marker)" if self.body_length > 0 else ""
        return [
            f"the scale is doubtful: known lengths disagree by {100 * self.spread:.1f} %{meaning}; "
            f"mm per pixel by {', '.join(listed)}; used is {1e3 * self.meters_per_pixel:.4f}; "
            f"measure a length in the pool and add it to the camera file"
        ]


def make_scale(
    lengths: Sequence[tuple[str, float]], markers: Sequence[tuple[str, float, bool]], plane: float | None,
    rest_markers: Array,
) -> Scale:  # fmt: skip
    """The scale of a video.

    Args:
        lengths: Name of each length in the pool, and its meters per pixel [m].
        markers: Name of each distance between markers, its meters per pixel [m], and whether both stand level.
        plane: Meters per pixel of the camera file's plane, which then is used [m].
        rest_markers: Marker positions of the straight robot [m]. Shape (M, 2).

    Raises:
        TrackingError: There is nothing to use.
    """
    estimates = [*lengths, *((name, value) for name, value, _ in markers)]
    if plane is not None:
        estimates.insert(0, ("camera file's plane", plane))
        used = plane
    else:
        trusted = [value for _, value in lengths] or [value for _, value, level in markers if level]
        if not trusted:
            raise TrackingError(
                "there is no scale: of the markers that keep their distances no two are seen together; "
                "add a known length to the camera file"
            )
        used = float(np.median(trusted))
    values = [value for _, value in estimates]
    body_length = float(np.linalg.norm(rest_markers[-1] - rest_markers[0]))
    return Scale(used, (max(values) - min(values)) / used, tuple(estimates), body_length)


def marker_estimates(
    points: Array, unit: float, rest_markers: Array, heights: Array, names: Sequence[str], rigid: Sequence[int]
) -> list[tuple[str, float, bool]]:
    """What the distances of the rigid markers say: name, meters per pixel [m], and whether both stand level.

    Args:
        points: NaN where not seen. Shape (T, M, 2).
        unit: Meters per pixel where the points are in meters already, 1 where they are in pixels.
        rest_markers: Shape (M, 2).
        heights: Heights of the markers [m]. Shape (M,).
        names: Names of the M markers.
        rigid: Indices of markers that keep their distances.
    """
    estimates: list[tuple[str, float, bool]] = []
    for a, b in combinations(rigid, 2):
        apart = np.linalg.norm(points[:, a] - points[:, b], axis=1)
        seen = apart[np.isfinite(apart)]
        if seen.size and np.median(seen) > 0:
            rest = float(np.linalg.norm(rest_markers[a] - rest_markers[b]))
            level = bool(abs(heights[a] - heights[b]) <= LEVEL)
            estimates.append((f"{names[a]}–{names[b]}", unit * rest / float(np.median(seen)), level))
    return estimates


def common_scale(scales: Mapping[str, Scale]) -> Scale:
    """One scale for several videos of a camera that didn't move: the median of theirs, each listed by its video.

    Args:
        scales: Scale of each video, by name.
    """
    if not scales:
        raise TrackingError("a common scale needs at least one video")
    values = [scale.meters_per_pixel for scale in scales.values()]
    middle = float(np.median(values))
    body_length = max(scale.body_length for scale in scales.values())
    estimates = tuple((name, scale.meters_per_pixel) for name, scale in scales.items())
    return Scale(middle, (max(values) - min(values)) / middle, estimates, body_length)
