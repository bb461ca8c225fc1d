"""From pixels to meters: scale with its doubts, perspective, lens, and markers that stand higher than others.

In the order in which light met them, backward: the lens (if a camera file has one), the water's plane (a homography, or
one scale for a camera that looks straight down), the markers' heights (if the camera's height is known).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrackingError
from swim2real.tracking.camera.camera_file import CameraFile
from swim2real.tracking.camera.lens import Lens
from swim2real.tracking.camera.parallax import height_note, lowered
from swim2real.tracking.camera.plane import fit_plane, local_scale, project
from swim2real.tracking.camera.scale import LEVEL, Scale, make_scale, marker_estimates
from swim2real.trials.trial import MarkerTrack

Array = NDArray[np.float64]

LOOSEST_FIT = 0.01  # m, root mean square error of a plane's points before a person is told


@dataclass(frozen=True)
class Camera:
    """Turns pixels into meters for one video.

    Attributes:
        plane: Homography from (undistorted) pixels to meters at the height of the head's markers, y up. Shape (3, 3).
        scale: At the middle of where the head was.
        heights: Of the markers above the first one [m]. Shape (M,).
        height: Of the camera above the first marker [m]; None leaves the markers' heights uncorrected.
        center: The (undistorted) pixel straight below the camera [px]. Shape (2,).
        lens: Taken out first.
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
            track: In pixels of the upright video, with this camera's markers.
        """
        if track.marker_count != len(self.heights):
            raise TrackingError(f"the track has {track.marker_count} markers; the camera is for {len(self.heights)}")
        points = project(self.plane, _straight(self.lens, track.positions))
        if self.height is not None and self.center is not None:
            points = lowered(points, project(self.plane, self.center), self.heights, self.height)
        return MarkerTrack(track.times, points, track.confidence)

    def with_scale(self, scale: Scale) -> Camera:
        """The same camera with another scale, such as one for several videos.

        Raises:
            TrackingError: The scale comes from points or a homography, which say more.
        """
        if not np.array_equal(self.plane, _scaling(self.plane[0, 0])):
            raise TrackingError("the camera file gives a plane, which has its own scale; it can't have another one")
        return replace(self, plane=_scaling(scale.meters_per_pixel), scale=scale)

    def findings(self) -> list[str]:
        """A sentence for each thing that a person should know."""
        return [*self.scale.findings(), *self.notes]


def camera_for(
    track: MarkerTrack, rest_markers: Array, heights: Array, names: Sequence[str], rigid: Sequence[int],
    known: CameraFile | None = None, size: tuple[int, int] | None = None,
) -> Camera:  # fmt: skip
    """The camera that took a video, from what it saw and what a person knows about it.

    The scale is the median of the lengths in the camera file; without any, of the distances of markers that are rigid
    against each other and stand level: the head's. The other rigid ones are estimated too, so that a person sees
    whether they agree. They don't count, even if the camera's height is known: on the published tracks their scales
    differ more between videos (by 8.6 %, at 2 m) than the head's (6.5 %), since markers are placed by hand.

    Args:
        track: In pixels of the upright video.
        rest_markers: Marker positions of the straight robot [m]. Shape (M, 2).
        heights: Of the markers [m]. Shape (M,).
        names: Of the M markers.
        rigid: Indices of markers that keep their distances as the robot moves.
        known: The camera file.
        size: Width and height of the upright video [px], whose center is taken to lie straight below the camera.

    Raises:
        TrackingError: There is no scale, or the camera file contradicts itself or the video.
        MissingExtraError: The camera file has a lens, and OpenCV isn't installed.
    """
    given = known if known is not None else CameraFile()
    if not track.marker_count == len(rest_markers) == len(heights) == len(names):
        raise TrackingError(f"the track has {track.marker_count} markers; the robot has {len(rest_markers)}")
    above = heights - heights[0]
    pixels = np.where(track.confidence[:, :, None] > 0, _straight(given.lens, track.positions), np.nan)
    center = _center(given, size)
    raised = np.flatnonzero(np.abs(above) > LEVEL)
    if given.camera_height is not None and raised.size:
        if center is None:
            raise TrackingError(
                f"the camera file gives camera_height {given.camera_height:g} m, but nothing tells the pixel straight "
                f"below the camera (straight ahead of one that looks from the side); add principal_point"
            )
        if given.camera_height <= above.max():
            raise TrackingError(
                f"the camera file's camera_height {given.camera_height:g} m doesn't reach beyond marker "
                f"{names[int(above.argmax())]}, which stands {above.max():g} m nearer to the camera than {names[0]}; "
                f"measure from {names[0]} to the camera"
            )

    plane, residual = _plane(given, pixels)
    points = pixels if plane is None else project(plane, pixels)
    if given.camera_height is not None and center is not None:
        below = center if plane is None else project(plane, center)
        points = lowered(points, below, above, given.camera_height)
    unit = None if plane is None else local_scale(plane, _middle(pixels[:, :2]))
    # with a plane, lengths are measured in meters: what they should be over what they are, times the plane's own scale
    ratio = 1.0 if unit is None else unit
    lengths = [(one.name, ratio * one.meters / _distance(given, plane, one.pixels)) for one in given.lengths]
    markers = marker_estimates(points, ratio, rest_markers, heights, names, rigid)
    scale = make_scale(lengths, markers, unit, rest_markers)

    notes: list[str] = []
    if residual is not None and residual > LOOSEST_FIT:
        notes.append(
            f"the camera file's points fit no plane better than {1e3 * residual:.0f} mm; check their pixels and meters"
        )
    if given.camera_height is None and raised.size:
        notes.append(height_note(pixels, scale.meters_per_pixel, plane is None, center, size, above, names, rigid))
    return Camera(
        _scaling(scale.meters_per_pixel) if plane is None else plane,
        scale, above, given.camera_height, center, given.lens, residual, tuple(notes),
    )  # fmt: skip


def _plane(given: CameraFile, pixels: Array) -> tuple[Array | None, float | None]:
    """The homography that the camera file gives, turned to the side where the robot is, and its residual [m]."""
    if given.points is not None:
        try:
            plane, residual = fit_plane(_straight(given.lens, given.points[0]), given.points[1])
        except TrackingError as error:
            raise TrackingError(f"camera file: {error}") from error
    elif given.homography is not None:
        plane, residual = given.homography, None
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


def _center(given: CameraFile, size: tuple[int, int] | None) -> Array | None:
    if given.principal_point is not None:
        return _straight(given.lens, given.principal_point)
    if given.lens is not None:
        return given.lens.center
    return None if size is None else (np.array(size, dtype=float) - 1) / 2


def _distance(given: CameraFile, plane: Array | None, ends: Array) -> float:
    """Between two pixels: in undistorted pixels, or in meters with a plane."""
    straight = _straight(given.lens, ends)
    one, other = straight if plane is None else project(plane, straight)
    return float(np.linalg.norm(one - other))


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
