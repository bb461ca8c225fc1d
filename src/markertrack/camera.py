"""From pixels to meters: scale with its doubts, perspective, lens, and markers that stand higher than others.

In the order in which light met them, backward: the lens (if a camera file has one), the water's plane (a homography, or
one scale for a camera that looks straight down), the markers' heights (if the camera's height is known).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from markertrack.camera_file import CameraFile, Lens
from markertrack.layout import Layout
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import Array
from swimbase.errors import TrackingError

DISAGREEMENT = 0.02  # of the scale, by which known lengths may differ before it is reported
MOST_LISTED = 10  # estimates of a scale that are listed
LEVEL = 1e-3  # m, heights that count as the same
_FLATTEST = 1e-3  # of the fit's singular values, below which the points are (nearly) on a line
LOOSEST_FIT = 0.01  # m, root mean square error of a plane's points before it is reported


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
    """Size of a pixel, and its uncertainty.

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


@dataclass(frozen=True)
class Camera:
    """Turns pixels into meters for one video.

    Attributes:
        plane: Homography from (undistorted) pixels to meters at the height of the head's markers, y up. Shape (3, 3).
        scale: Scale at the middle of where the head was.
        heights: Heights of the markers above the first one [m]. Shape (M,).
        height: Height of the camera above the first marker [m]; None leaves the markers' heights uncorrected.
        center: The (undistorted) pixel straight below the camera [px]. Shape (2,).
        lens: Distortion of the lens, which is taken out first; None without one.
        residual: Root mean square error of the points that the plane was fitted to [m].
        notes: What a person should know, beside the scale.
    """

    plane: Array
    scale: Scale
    heights: Array
    height: float | None = None
    center: Array | None = None
    lens: Lens | None = None
    residual: float | None = None
    notes: tuple[str, ...] = ()

    def to_meters(self, track: MarkerTrack) -> MarkerTrack:
        """The track in the world, in meters with y up; confidences stay.

        Args:
            track: Track in pixels of the upright video, with this camera's markers.
        """
        if track.marker_count != len(self.heights):
            raise TrackingError(f"the track has {track.marker_count} markers; the camera is for {len(self.heights)}")
        points = project(self.plane, _straight(self.lens, track.positions))
        if self.height is not None and self.center is not None:
            points = _lowered(points, project(self.plane, self.center), self.heights, self.height)
        return MarkerTrack(track.times, points, track.confidence)

    def to_pixels(self, positions: Array) -> Array:
        """Projects markers into the upright video; undoes `to_meters` [px].

        Args:
            positions: In the world, NaN where unknown [m]. Shape (T, M, 2).

        Returns:
            NaN where unknown. Shape (T, M, 2).
        """
        points = positions
        if self.height is not None and self.center is not None:
            below = project(self.plane, self.center)
            points = below + (points - below) / (1 - self.heights / self.height)[:, None]
        back: Array = np.linalg.inv(self.plane).astype(np.float64)
        pixels = project(back, points)
        return pixels if self.lens is None else self.lens.distort(pixels)

    def findings(self) -> list[str]:
        """A sentence for each thing that a person should know."""
        return [*self.scale.findings(), *self.notes]


def camera_for(
    track: MarkerTrack, layout: Layout, known: CameraFile | None = None, size: tuple[int, int] | None = None
) -> Camera:
    """The camera that took a video, from what it saw and what a person knows about it.

    The scale is the median of the lengths in the camera file; without any, of the distances of markers that are rigid
    against each other and stand level: the head's. The other rigid ones are estimated too, so that a person sees
    whether they agree. They don't count, even if the camera's height is known: on the published tracks their scales
    differ more between videos (by 8.6 %, at 2 m) than the head's (6.5 %), since markers are placed by hand.

    Args:
        track: Track in pixels of the upright video.
        layout: The M markers.
        known: What the camera file says; None without one.
        size: Width and height of the upright video [px], whose center is taken to lie straight below the camera.

    Raises:
        TrackingError: There is no scale, or the camera file contradicts itself or the video.
    """
    camera = known if known is not None else CameraFile()
    names, heights = layout.names, layout.heights
    if track.marker_count != len(names):
        raise TrackingError(f"the track has {track.marker_count} markers; the robot has {len(names)}")
    above = heights - heights[0]
    pixels = np.where(track.confidence[:, :, None] > 0, _straight(camera.lens, track.positions), np.nan)
    center = _center(camera, size)
    raised = np.flatnonzero(np.abs(above) > LEVEL)
    if camera.camera_height is not None and raised.size:
        if center is None:
            raise TrackingError(
                f"the camera file gives camera_height {camera.camera_height:g} m, but nothing tells the pixel straight "
                f"below the camera (straight ahead of one that looks from the side); add principal_point"
            )
        if camera.camera_height <= above.max():
            raise TrackingError(
                f"the camera file's camera_height {camera.camera_height:g} m doesn't reach beyond marker "
                f"{names[int(above.argmax())]}, which stands {above.max():g} m nearer to the camera than {names[0]}; "
                f"measure from {names[0]} to the camera"
            )

    plane, residual = _plane(camera, pixels)
    points = pixels if plane is None else project(plane, pixels)
    if camera.camera_height is not None and center is not None:
        below = center if plane is None else project(plane, center)
        points = _lowered(points, below, above, camera.camera_height)
    unit = None if plane is None else local_scale(plane, _middle(pixels[:, :2]))
    # with a plane, lengths are measured in meters: what they should be over what they are, times the plane's own scale
    ratio = 1.0 if unit is None else unit
    lengths = [
        (length.name, ratio * length.meters / _distance(camera, plane, length.pixels)) for length in camera.lengths
    ]
    scale = _scale(unit, lengths, points, layout)

    notes: list[str] = []
    if residual is not None and residual > LOOSEST_FIT:
        notes.append(
            f"the camera file's points fit no plane better than {1e3 * residual:.0f} mm; check their pixels and meters"
        )
    if camera.camera_height is None and raised.size:
        notes.append(_height_note(pixels, scale.meters_per_pixel, center, size, above, names))
    return Camera(
        _scaling(scale.meters_per_pixel) if plane is None else plane,
        scale, above, camera.camera_height, center, camera.lens, residual, tuple(notes),
    )  # fmt: skip


def fixed_camera(
    known: CameraFile | None, meters_per_pixel: float | None, heights: Array, size: tuple[int, int]
) -> Camera:
    """The camera that took a video whose scale is known, as `camera_for` had it when the video was tracked.

    Args:
        known: What the camera file says; None without one.
        meters_per_pixel: Scale at the head [m]; a camera file with a plane needs none.
        heights: Heights of the markers [m]. Shape (M,).
        size: Width and height of the upright video [px].

    Raises:
        TrackingError: There is no scale.
    """
    camera = known if known is not None else CameraFile()
    middle = (np.array(size, dtype=float) - 1) / 2
    plane, residual = _plane(camera, np.tile(middle, (1, 2, 1)))
    if plane is None:
        if meters_per_pixel is None:
            raise TrackingError(
                "there is no scale: the trial doesn't say its meters per pixel, and the camera file has no plane; "
                "track the film with `swim2real track`, or add points to the camera file"
            )
        plane = _scaling(meters_per_pixel)
    scale = Scale(local_scale(plane, middle), 0.0, ())
    return Camera(
        plane, scale, heights - heights[0], camera.camera_height, _center(camera, size), camera.lens, residual
    )


def _plane(camera: CameraFile, pixels: Array) -> tuple[Array | None, float | None]:
    """The homography that the camera file gives, turned to the side where the robot is, and its residual [m]."""
    if camera.points is not None:
        try:
            plane, residual = fit_plane(_straight(camera.lens, camera.points[0]), camera.points[1])
        except TrackingError as error:
            raise TrackingError(f"camera file: {error}") from error
    elif camera.homography is not None:
        plane, residual = camera.homography, None
    else:
        return None, None
    usual = _middle(pixels[:, :2])
    if plane[2] @ [*usual, 1.0] < 0:
        plane = -plane
    if not local_scale(plane, usual) > 0:
        raise TrackingError(
            "the camera file's plane is a mirror image: the picture's y points down, the meters' y must point up when "
            "x points to the right; change the sign of all y in meters"
        )
    return plane, residual


def _center(camera: CameraFile, size: tuple[int, int] | None) -> Array | None:
    if camera.principal_point is not None:
        return _straight(camera.lens, camera.principal_point)
    if camera.lens is not None:
        return camera.lens.center
    return None if size is None else (np.array(size, dtype=float) - 1) / 2


def _distance(camera: CameraFile, plane: Array | None, ends: Array) -> float:
    """Between two pixels: in undistorted pixels, or in meters with a plane.

    Raises:
        TrackingError: It is nothing, or too large for a number.
    """
    straight = _straight(camera.lens, ends)
    start, end = straight if plane is None else project(plane, straight)
    distance = float(np.linalg.norm(start - end))
    if not 0 < distance < np.inf:
        raise TrackingError(
            f"camera file: the length from pixel {ends[0]} to {ends[1]} is {distance:g} in the lens and plane that it "
            f"gives; check its lens, points and homography"
        )
    return distance


def _straight(lens: Lens | None, points: Array) -> Array:
    return points if lens is None else lens.undistort(points)


def _scaling(meters_per_pixel: float) -> Array:
    return np.diag([meters_per_pixel, -meters_per_pixel, 1.0])


def _middle(heads: Array) -> Array:
    """Median pixel of the head's markers (T, 2, 2). Shape (2,)."""
    seen = heads.reshape(-1, 2)
    seen = seen[np.isfinite(seen).all(axis=1)]
    if not len(seen):
        raise TrackingError("the first two markers are never seen, so the track can't be turned into meters")
    return np.median(seen, axis=0)


def _lowered(points: Array, below: Array, heights: Array, camera_height: float) -> Array:
    """Places where the markers stand, from those seen on the plane: exact, however the camera is tilted.

    Args:
        points: Where the lines of sight meet the plane, in pixels or meters. Shape (T, M, 2).
        below: The plane's point straight below the camera, in the same unit. Shape (2,).
        heights: Heights of the markers above the plane [m]. Shape (M,).
        camera_height: Height of the camera above the plane [m].
    """
    return below + (points - below) * (1 - heights / camera_height)[:, None]


def _height_note(
    pixels: Array, scale: float, center: Array | None, size: tuple[int, int] | None, above: Array, names: Sequence[str]
) -> str:
    """A sentence on what the markers' heights do when nothing corrects them.

    Args:
        pixels: NaN where not seen [px]. Shape (T, M, 2).
        scale: Meters per pixel [m].
        center: The pixel straight below the camera [px]. Shape (2,).
        size: Width and height of the video [px]; the camera is taken to be as far away as the picture is wide.
        above: Heights of the markers above the first [m]. Shape (M,).
        names: Names of the M markers.
    """
    raised = np.flatnonzero(np.abs(above) > LEVEL)
    few = len(raised) <= MOST_LISTED
    which = " and ".join(names[m] for m in raised.tolist()) if few else f"{len(raised)} of {len(names)} markers"
    nearer = f"{1e3 * above[raised].max():.0f} mm nearer to the camera than {names[0]}"
    advice = "give camera_height in the camera file to correct it"
    advice += ", with principal_point" if center is None else ""
    where = "farther from the picture's center than they do"
    if center is not None and size is not None:
        height = max(size) * scale
        out = np.linalg.norm(pixels[:, raised] - center, axis=2) * scale * above[raised] / height
        drift = float(np.nanmax(out)) if np.isfinite(out).any() else 0.0
        where = f"up to {1e3 * drift:.0f} mm too far out (for a camera {height:.1f} m away, the width of its picture)"
    return f"{which} stand up to {nearer} and seem to lie {where}; {advice}"


def _scale(plane: float | None, lengths: Sequence[tuple[str, float]], points: Array, layout: Layout) -> Scale:
    """The scale of a video.

    Args:
        plane: Meters per pixel of the camera file's plane, which then is used [m].
        lengths: Name of each length in the pool, and its meters per pixel [m].
        points: In pixels, or with a plane in meters; NaN where not seen. Shape (T, M, 2).
        layout: The M markers.

    Raises:
        TrackingError: There is nothing to use.
    """
    between: list[tuple[str, float]] = []  # markers
    level: list[float] = []
    names, rest, heights = layout.names, layout.rest, layout.heights
    for a, b in combinations(layout.rigid, 2):
        apart = np.linalg.norm(points[:, a] - points[:, b], axis=1)
        seen = apart[np.isfinite(apart)]
        if seen.size and np.median(seen) > 0:
            known = float(np.linalg.norm(rest[a] - rest[b]))
            between.append((f"{names[a]}–{names[b]}", (plane or 1.0) * known / float(np.median(seen))))
            if abs(heights[a] - heights[b]) <= LEVEL:
                level.append(between[-1][1])
    given = [] if plane is None else [("camera file's plane", plane)]
    trusted = [value for _, value in given or lengths] or level
    if not trusted:
        raise TrackingError(
            "there is no scale: of the markers that keep their distances no two are seen together; "
            "add a known length to the camera file"
        )
    used, estimates = float(np.median(trusted)), (*given, *lengths, *between)
    values = [value for _, value in estimates]
    body_length = float(np.linalg.norm(rest[-1] - rest[0]))
    return Scale(used, (max(values) - min(values)) / used, estimates, body_length)
