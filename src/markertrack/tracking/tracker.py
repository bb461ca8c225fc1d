"""What a tracker of markers is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swimbase.arrays import Array, Mask
from swimbase.errors import TrackingError

Image = NDArray[np.uint8]

EVEN = 0.5  # likelihood, likeness or share above which something is rather so than not
FAINT = 0.4  # of a contrast, below which an edge or a picture is noise or texture
AGREE = 0.5, 3.0  # radii, or px, within which two say the same of where a marker is
EXACT = 1.0, 0.1  # px, or radii, to which a place is known
DETAIL = 10.0  # px radius up to which pictures of markers are compared in full detail
RATE = 0.1  # of what is seen of a marker without a doubt that is taken in, in each frame
AGAIN = 2  # frames that a marker must be certain in, one after the other, after it was lost
DOUBT = 0.45  # confidence of a marker that may be another one: `quality` counts less than a half as lost


class Tracker(Protocol):
    """Follows markers from the points in the first frame on.

    Pixels are those of the upright image, x to the right, y down, the top-left pixel's center at (0, 0).
    """

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Takes the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Places of the markers, as picked [px]. Shape (M, 2).
            time: Time stamp [s].

        Returns:
            Positions [px], shape (M, 2), and confidence from 0 to 1, shape (M,), as `follow` gives them.

        Raises:
            TrackingError: No marker can be made out where one was picked.
        """
        ...

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Takes the next frame.

        Args:
            image: RGB, of the same size. Shape (H, W, 3).
            time: Time stamp, later than the last one [s].

        Returns:
            Positions, NaN where a marker is lost [px], shape (M, 2), and confidence from 0 (lost) to 1, shape (M,).
        """
        ...


def check_points(image: Image, points: Array) -> None:
    """Refuses points (M, 2) that aren't in a frame.

    Raises:
        TrackingError: One isn't.
    """
    height, width = image.shape[:2]
    if not ((points >= 0) & (points <= [width - 1, height - 1])).all():
        raise TrackingError(f"{len(points)} points must be finite and lie in the frame of {width} x {height} px")


def check_order(time: float, last: float) -> None:
    """Refuses a frame that isn't after the last one.

    Raises:
        TrackingError: It isn't.
    """
    if time <= last:
        raise TrackingError(f"frame time {time:.4f} s isn't after the last one; call start() first, then in order")


def contradict(first: Array, second: Array, radii: Array | float) -> Mask:
    """Whether two opinions on where markers are contradict each other. Shapes (..., 2) twice, (...), (...)."""
    return np.asarray(np.linalg.norm(first - second, axis=-1) > np.maximum(AGREE[0] * np.asarray(radii), AGREE[1]))


def inside(places: Array, image: Image, margin: Array | float = 0.0) -> Mask:
    """Whether places are in a picture. Shapes (..., 2), (...)."""
    edge = np.asarray(margin)[..., None]
    return np.asarray(((places >= edge) & (places <= np.array(image.shape[1::-1]) - 1 - edge)).all(axis=-1))
