"""What a tracker of markers is: started with points in the first frame, it follows them from frame to frame."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


class Tracker(Protocol):
    """Follows markers. Pixels of the upright image, x to the right, y down, the top-left pixel's center at (0, 0)."""

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Takes the first frame.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Of the markers, as picked [px]. Shape (M, 2).
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
            image: As before.
            time: Later than the last one [s].

        Returns:
            Positions, NaN where a marker is lost [px], shape (M, 2), and confidence from 0 (lost) to 1, shape (M,).
        """
        ...
