"""OpenCV's detector of ArUco and AprilTag markers: a tag carries a number, so none becomes another."""

from __future__ import annotations

import cv2
import numpy as np

from markertrack.tracking.tracker import Array, Image
from swimbase.errors import ArgumentError, TrackingError

SMALLEST_TAG = 10.0  # px of a side, below which its bits can't be read
COMMON = ("APRILTAG_36h11", "4X4_1000", "5X5_1000", "6X6_1000", "APRILTAG_25h9", "APRILTAG_16h5", "7X7_1000",
          "ARUCO_ORIGINAL")  # fmt: skip  # dictionaries that tags at the points are looked up in
SIZES = 1.5  # by which a tag may look larger or smaller than when it was last seen


class TagTracker:
    """Reads all tags anew in every frame.

    A marker is the tag whose center is nearest to its point in the first frame. Where a tag isn't read, is read twice
    or has changed its size at once, the marker is lost. A tag that is read has confidence 1: its number is sure.

    Attributes:
        tags: Name of the dictionary that the tags are of, such as `4X4_50` or `APRILTAG_36h11`.
    """

    def __init__(self, tags: str):
        """Takes the tags of a dictionary.

        Args:
            tags: Name of the dictionary, as OpenCV has it, with or without `DICT_`.

        Raises:
            ArgumentError: OpenCV has no dictionary of this name.
        """
        self.tags = tags
        dictionary = cv2.aruco.getPredefinedDictionary(_number(tags))
        self._parameters = cv2.aruco.DetectorParameters()
        # lines along the sides: a quarter of the error of the other refinements on blurred tags
        self._parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        self._detector = cv2.aruco.ArucoDetector(dictionary, self._parameters)
        self._numbers: list[int] = []  # of the markers' tags
        self._sides = np.empty(0)  # of each marker's tag when it was last seen [px]

    def points(self, image: Image, count: int) -> Array:
        """Centers of the tags of a picture in the order of their numbers, so that nobody has to click them.

        Args:
            image: RGB. Shape (H, W, 3).
            count: Number of tags that there must be.

        Returns:
            Centers [px]. Shape (count, 2).

        Raises:
            TrackingError: There are more or fewer tags, or one number twice.
        """
        numbers, centers, _ = self.read(image)
        if len(numbers) != count or len(set(numbers)) < count:
            seen = ", ".join(map(str, sorted(numbers))) or "none"
            raise TrackingError(
                f"the first frame shows {len(numbers)} tags of {self.tags} ({seen}); there must be {count}, one for "
                f"each marker; begin where all are seen (--from), or pick the points"
            )
        return centers[np.argsort(numbers)]

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Takes the first frame: which tag is which marker.

        Args:
            image: RGB. Shape (H, W, 3).
            points: Places of the markers, as picked [px]. Shape (M, 2).
            time: Time stamp [s]; not used.

        Returns:
            Centers of the tags [px], shape (M, 2), and confidence 1.

        Raises:
            TrackingError: A point lies on no tag, or two lie on one.
        """
        numbers, centers, sides = self.read(image)
        if not numbers:
            raise TrackingError(
                f"no tag of {self.tags} is in the first frame; give the dictionary of your tags with --tags, let each "
                f"have a white border, and begin where all are seen (--from)"
            )
        apart = np.linalg.norm(points[:, None] - centers, axis=2)
        nearest = apart.argmin(axis=1)
        for m, tag in enumerate(nearest.tolist()):
            if apart[m, tag] > sides[tag]:
                raise TrackingError(
                    f"point {m + 1} is at ({points[m, 0]:g}, {points[m, 1]:g}); the nearest tag, number "
                    f"{numbers[tag]}, is {apart[m, tag]:.0f} px away; pick the centers of tags of {self.tags}"
                )
            earlier = nearest[:m].tolist()
            if tag in earlier:
                raise TrackingError(
                    f"points {earlier.index(tag) + 1} and {m + 1} lie on the same tag, number {numbers[tag]}; pick one "
                    f"point for each tag"
                )
        self._numbers, self._sides = [numbers[tag] for tag in nearest.tolist()], sides[nearest]
        twice = next((number for number in self._numbers if numbers.count(number) > 1), None)
        if twice is not None:
            raise TrackingError(f"tag number {twice} is in the first frame twice; give each tag its own number")
        return centers[nearest], np.ones(len(points))

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Reads the tags of the next frame.

        Args:
            image: RGB. Shape (H, W, 3).
            time: Time stamp [s]; not used.

        Returns:
            Centers (M, 2) [px], NaN where a tag isn't read, and confidence (M,): 1 or 0.
        """
        numbers, centers, sides = self.read(image, float(self._sides.min()) / SIZES)
        found = np.full((len(self._numbers), 2), np.nan)
        for m, number in enumerate(self._numbers):
            if numbers.count(number) != 1:
                continue
            tag = numbers.index(number)
            if 1 / SIZES <= sides[tag] / self._sides[m] <= SIZES:
                found[m], self._sides[m] = centers[tag], sides[tag]
        return found, np.isfinite(found[:, 0]).astype(float)

    def read(self, image: Image, smallest: float = SMALLEST_TAG) -> tuple[list[int], Array, Array]:
        """Reads all tags of a picture, whichever markers they are.

        Args:
            image: RGB. Shape (H, W, 3).
            smallest: Side below which tags are left out [px].

        Returns:
            Their numbers, centers [px], shape (N, 2), and the means of their sides [px], shape (N,).
        """
        # OpenCV leaves out what is small against the picture: 4 of 100 of a 4K one are 40 px
        self._parameters.minMarkerPerimeterRate = 4 * smallest / max(image.shape[:2])
        self._detector.setDetectorParameters(self._parameters)
        # the weights of the eye; tags are black and white
        gray = (image @ np.array([0.299, 0.587, 0.114])).round().astype(np.uint8)
        corners, numbers, _ = self._detector.detectMarkers(gray)
        if not corners:
            return [], np.empty((0, 2)), np.empty(0)
        quads = np.array(corners, dtype=float).reshape(-1, 4, 2)
        sides = np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=2).mean(axis=1)
        return [int(number) for number in np.ravel(numbers)], _centers(quads), sides


def dictionary_at(image: Image, points: Array) -> str | None:
    """The dictionary of which tags lie at most of some points, if there is one.

    Args:
        image: RGB. Shape (H, W, 3).
        points: Places [px]. Shape (K, 2).
    """
    for name in COMMON:
        numbers, centers, sides = TagTracker(name).read(image)
        if numbers and np.mean((np.linalg.norm(points[:, None] - centers, axis=2) < sides).any(axis=1)) > 0.5:
            return name
    return None


def _centers(quads: Array) -> Array:
    """Where the diagonals cross, which is a square's center also in perspective. Shapes (N, 4, 2) to (N, 2)."""
    first, second = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    between = quads[:, 1] - quads[:, 0]
    along = (between[:, 0] * second[:, 1] - between[:, 1] * second[:, 0]) / (
        first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    )
    return quads[:, 0] + along[:, None] * first


def _number(tags: str) -> int:
    """The number of a dictionary."""
    known = {name.removeprefix("DICT_").lower(): name for name in dir(cv2.aruco) if name.startswith("DICT_")}
    name = known.get(tags.removeprefix("DICT_").lower())
    if name is None:
        listed = ", ".join(sorted({name.removeprefix("DICT_") for name in known.values()}))
        raise ArgumentError(f"tags is '{tags}'; OpenCV has the dictionaries {listed}")
    return int(getattr(cv2.aruco, name))
