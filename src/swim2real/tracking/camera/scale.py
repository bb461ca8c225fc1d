"""How large a pixel is: from several known lengths, so that a person sees when they disagree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrackingError

Array = NDArray[np.float64]

DISAGREEMENT = 0.02  # of the scale, by which known lengths may differ before a person is told
LEVEL = 1e-3  # m, heights that count as the same


@dataclass(frozen=True)
class Scale:
    """How large a pixel is, and how well that is known.

    Attributes:
        meters_per_pixel: The one that is used [m].
        spread: Range of all estimates, relative to it.
        estimates: Name of each known length, and what it says by itself [m].
        body_length: Of the robot, for what a doubt means in millimeters [m]; 0 when unknown.
    """

    meters_per_pixel: float
    spread: float
    estimates: tuple[tuple[str, float], ...]
    body_length: float = 0.0

    def findings(self) -> list[str]:
        """A sentence when the estimates disagree by more than 2 %."""
        if self.spread <= DISAGREEMENT:
            return []
        listed = ", ".join(f"{name} {1e3 * value:.4f}" for name, value in self.estimates)
        meaning = f" (1 % is {10 * self.body_length:.0f} mm at the last marker)" if self.body_length > 0 else ""
        return [
            f"the scale is doubtful: known lengths disagree by {100 * self.spread:.1f} %{meaning}; "
            f"mm per pixel by {listed}; used is {1e3 * self.meters_per_pixel:.4f}; "
            f"measure a length in the pool and add it to the camera file"
        ]


def make_scale(
    lengths: Sequence[tuple[str, float]], markers: Sequence[tuple[str, float, bool]], plane: float | None,
    rest_markers: Array,
) -> Scale:  # fmt: skip
    """The scale of a video.

    Args:
        lengths: Name of each length in the pool, and its meters per pixel [m].
        markers: Likewise of distances between markers, and whether they stand level.
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
        heights: Of the markers [m]. Shape (M,).
        names: Of the M markers.
        rigid: Indices of markers that keep their distances.
    """
    found: list[tuple[str, float, bool]] = []
    for a, b in combinations(rigid, 2):
        apart = np.linalg.norm(points[:, a] - points[:, b], axis=1)
        seen = apart[np.isfinite(apart)]
        if seen.size and np.median(seen) > 0:
            rest = float(np.linalg.norm(rest_markers[a] - rest_markers[b]))
            level = bool(abs(heights[a] - heights[b]) <= LEVEL)
            found.append((f"{names[a]}–{names[b]}", unit * rest / float(np.median(seen)), level))
    return found


def common_scale(scales: Mapping[str, Scale]) -> Scale:
    """One scale for several videos of a camera that didn't move: the median of theirs, each listed by its video.

    Args:
        scales: Of each video, by name.
    """
    if not scales:
        raise TrackingError("a common scale needs at least one video")
    values = [scale.meters_per_pixel for scale in scales.values()]
    middle = float(np.median(values))
    body_length = max(scale.body_length for scale in scales.values())
    estimates = tuple((name, scale.meters_per_pixel) for name, scale in scales.items())
    return Scale(middle, (max(values) - min(values)) / middle, estimates, body_length)
