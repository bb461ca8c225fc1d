"""What a tracker of markers is, and the paper's: OpenCV's CSRT (a correlation filter), one for each marker."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError, MissingExtraError

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

REASONS = "nothing like it is found", "others like it are near", "it doesn't look as it did"
REACH = 8  # box lengths around a marker that CSRT is shown: it looks at 2, times how much it has grown
SMALLEST_BOX = 8


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


class CsrtTracker:
    """Follows each marker by itself, from its appearance in the first frame.

    CSRT nearly always says that it has found its target, on a neighbor as well: of bad positions in a test clip it
    reported none as lost. So a confidence of 1 here means little, and tracks must be checked by `check_track`.

    Attributes:
        box: Side of the square around a marker that CSRT learns [px].
        crop: Hide the part of the frame to the right of and below a marker's surroundings from CSRT, which else works
            on all of it. Positions are the same; how much time it saves depends on where the robot is.
    """

    def __init__(self, box: int = 40, crop: bool = True):
        if box < SMALLEST_BOX:
            raise ArgumentError(f"the box of CSRT is {box} px; it must be {SMALLEST_BOX} px or more, about 40")
        if not hasattr(cv2, "TrackerCSRT"):
            version = getattr(cv2, "__version__", "of unknown version")
            raise MissingExtraError(
                f"the installed OpenCV {version} has no TrackerCSRT: a wheel without the contrib modules, such as "
                "opencv-python, has overwritten the one with them; repair it with: "
                "pip install --force-reinstall --no-deps opencv-contrib-python-headless"
            )
        self.box = box
        self.crop = crop
        self._trackers: list[cv2.TrackerCSRT | None] = []
        self._offsets = np.empty((0, 2))
        self._last = np.empty((0, 2))

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns the markers.

        Args:
            image: First frame, RGB. Shape (H, W, 3).
            points: Where the markers are in it [px]. Shape (M, 2).
            time: Time of the frame [s]; not used by CSRT.

        Returns:
            The points as they are, and confidence 1.
        """
        frame = self._bgr(image)
        corners = np.round(points - (self.box - 1) / 2).astype(int)  # CSRT takes whole pixels
        self._offsets = points - (corners + (self.box - 1) / 2)
        self._last = points.copy()
        self._trackers = []
        for (x, y), point in zip(corners.tolist(), points, strict=True):
            tracker = cv2.TrackerCSRT.create()
            tracker.init(self._shown(frame, point), (x, y, self.box, self.box))
            self._trackers.append(tracker)
        return points.copy(), np.ones(len(points))

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Looks for the markers in the next frame.

        Args:
            image: Next frame, RGB. Shape (H, W, 3).
            time: Time of the frame [s]; not used by CSRT.

        Returns:
            Positions (M, 2) [px], NaN where CSRT says that it lost the marker, and confidence (M,): 1 or 0.
        """
        frame = self._bgr(image)
        positions = np.full_like(self._last, np.nan)
        for m, tracker in enumerate(self._trackers):
            if tracker is None:
                continue
            try:
                seen, (x, y, width, height) = tracker.update(self._shown(frame, self._last[m]))
            except cv2.error:  # the target has left the frame, and so will it for all further frames
                self._trackers[m] = None
                continue
            if seen:
                self._last[m] = x + (width - 1) / 2, y + (height - 1) / 2
                positions[m] = self._last[m] + self._offsets[m]
        return positions, np.isfinite(positions).all(axis=1).astype(float)

    def _bgr(self, image: Image) -> cv2.typing.MatLike:
        return cv2.cvtColor(image, cv2.COLOR_RGB2BGR)

    def _shown(self, frame: cv2.typing.MatLike, point: Array) -> cv2.typing.MatLike:
        """The frame up to some way beyond a point; its origin stays, since CSRT's state is in its coordinates."""
        if not self.crop:
            return frame
        right, bottom = np.maximum(point, 0).astype(int) + REACH * self.box
        return frame[: int(bottom), : int(right)]
