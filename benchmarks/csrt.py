"""OpenCV's CSRT, the paper's tracker: a correlation filter for each marker. It needs the contrib modules:

pip install --force-reinstall --no-deps opencv-contrib-python-headless
"""

from __future__ import annotations

import cv2
import numpy as np

from markertrack.tracking.tracker import Array, Image

REACH = 8  # box lengths around a marker that CSRT is shown: it looks at 2, times how much it has grown


class CsrtTracker:
    """Follows each marker by itself, from its appearance in the first frame.

    CSRT nearly always says that it has found its target, on a neighbor as well: of bad positions in a test clip it
    reported none as lost. So a confidence of 1 here means little, and tracks must be checked by `check_track`.

    Attributes:
        box: Side of the square around a marker that CSRT learns [px].
    """

    def __init__(self, box: int = 40):
        self.box = box
        self._trackers: list[cv2.TrackerCSRT | None] = []
        self._offsets = np.empty((0, 2))
        self._last = np.empty((0, 2))

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns the markers; gives the points as they are, and confidence 1."""
        frame = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
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
        """Looks for the markers in the next frame; confidence is 1, or 0 where CSRT says that it lost the marker."""
        frame = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
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

    def _shown(self, frame: cv2.typing.MatLike, point: Array) -> cv2.typing.MatLike:
        """The frame up to some way beyond a point: CSRT works on all that it gets, and positions are the same.

        The frame's origin stays, since CSRT's state is in its coordinates.
        """
        right, bottom = np.maximum(point, 0).astype(int) + REACH * self.box
        return frame[: int(bottom), : int(right)]
