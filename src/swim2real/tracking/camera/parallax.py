"""Markers that stand higher than others: a camera above sees them farther from the point straight below it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swim2real.tracking.camera.scale import LEVEL
from swim2real.trials import frames

Array = NDArray[np.float64]

_CORRELATED = 30  # frames whose residuals count as one when the camera's height is sought in a track
_PLAUSIBLE_HEIGHTS = (0.5, 10.0)  # m


def lowered(points: Array, below: Array, heights: Array, camera_height: float) -> Array:
    """Where the markers stand, from where they seem to lie on the plane: exact, however the camera is tilted.

    Args:
        points: Where the lines of sight meet the plane, in pixels or meters. Shape (T, M, 2).
        below: The plane's point straight below the camera, in the same unit. Shape (2,).
        heights: Of the markers above the plane [m]. Shape (M,).
        camera_height: Above the plane [m].
    """
    return below + (points - below) * (1 - heights / camera_height)[:, None]


def camera_height_seen(pixels: Array, heights: Array, center: Array, rigid: Sequence[int]) -> float | None:
    """The height at which the camera seems to hang, from how a raised marker shifts against the head on its way.

    A marker on the head that stands higher lies still against it but for a share `height / camera height` of its
    distance from the picture's center. Of the fish's published tracks four of six give 1.7 to 2.5 m, and the others
    nothing, so it is a hint and never used by itself.

    Args:
        pixels: Shape (T, M, 2).
        heights: Of the markers above the first [m]. Shape (M,).
        center: The pixel straight below the camera [px]. Shape (2,).
        rigid: Indices of markers that keep their distances.

    Returns:
        Above the first marker [m]; None where the track doesn't show it, or no rigid marker stands higher.
    """
    raised = [m for m in rigid if abs(heights[m]) > LEVEL]
    if not raised or not {0, 1} <= set(rigid):
        return None
    marker = raised[0]
    axes = frames.body_axes(pixels)
    aside = np.stack([-axes[:, 1], axes[:, 0]], axis=1)
    terms = np.stack([axes, aside, pixels[:, marker] - center], axis=2)  # (T, 2, 3)
    offsets = pixels[:, marker] - pixels[:, 0]
    good = np.isfinite(terms).all(axis=(1, 2)) & np.isfinite(offsets).all(axis=1)
    if np.count_nonzero(good) < 2 * _CORRELATED:
        return None
    matrix, values = terms[good].reshape(-1, 3), offsets[good].ravel()
    fitted, _, rank, _ = np.linalg.lstsq(matrix, values, rcond=None)
    if rank < 3:
        return None
    rest = values - matrix @ fitted
    variance = float(rest @ rest) / len(values) * _CORRELATED * float(np.linalg.inv(matrix.T @ matrix)[2, 2])
    share = float(fitted[2])
    if share <= 0 or share < 3 * np.sqrt(variance):
        return None
    height = float(heights[marker]) / share
    return height if _PLAUSIBLE_HEIGHTS[0] <= height <= _PLAUSIBLE_HEIGHTS[1] else None


def height_note(
    pixels: Array, scale: float, flat: bool, center: Array | None, size: tuple[int, int] | None,
    above: Array, names: Sequence[str], rigid: Sequence[int],
) -> str:  # fmt: skip
    """A sentence on what the markers' heights do when nothing corrects them.

    Args:
        pixels: NaN where not seen [px]. Shape (T, M, 2).
        scale: Meters per pixel [m].
        flat: Whether the camera looks straight down, with one scale.
        center: The pixel straight below the camera [px]. Shape (2,).
        size: Of the video [px].
        above: Heights of the markers above the first [m]. Shape (M,).
        names: Of the M markers.
        rigid: Indices of markers that keep their distances.
    """
    raised = np.flatnonzero(np.abs(above) > LEVEL)
    which = " and ".join(names[m] for m in raised.tolist())
    nearer = f"{1e3 * above[raised].max():.0f} mm nearer to the camera than {names[0]}"
    begin = f"{which} stand up to {nearer} and seem to lie"
    advice = "give camera_height in the camera file to correct it"
    if center is None:
        return f"{begin} farther from the picture's center than they do; {advice}, with principal_point"
    height = camera_height_seen(pixels, above, center, rigid) if flat else None
    if height is not None:
        basis = f"{height:.1f} m away, as the track suggests"
    elif size is not None:
        height = max(size) * scale
        basis = f"{height:.1f} m away, as far as its picture is wide"
    else:
        return f"{begin} farther from the picture's center than they do; {advice}"
    share = above[raised] / height
    out = np.linalg.norm(pixels[:, raised] - center, axis=2) * scale * share
    drift = float(np.nanmax(out)) if np.isfinite(out).any() else 0.0
    return f"{begin} up to {1e3 * drift:.0f} mm too far out (estimated for a camera {basis}); {advice}"
