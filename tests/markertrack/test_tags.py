"""Tags: which marker a tag is, and what becomes of one that can't be read."""

import cv2
import numpy as np
import pytest

from markertrack.tracking.tags import TagTracker
from swimbase.errors import TrackingError

NUMBERS = (7, 3, 21)
PLACES = np.array([[80.0, 60.0], [200.0, 90.0], [300.0, 170.0]])
BESIDE = np.array([[80.0, 60.0], [200.0, 90.0], [300.0, 110.0]])


def picture(places=PLACES, numbers=NUMBERS, family="DICT_4X4_50", sides=36.0, angle=0.3, size=(240, 380)) -> np.ndarray:
    """Tags at places, turned, drawn 4 times finer; RGB."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family))
    cells = dictionary.markerSize + 2
    image = np.full((4 * size[0], 4 * size[1]), 150, np.uint8)
    for place, number, side in zip(places, numbers, np.broadcast_to(sides, len(numbers)), strict=True):
        tag = np.pad(cv2.aruco.generateImageMarker(dictionary, number, 8 * cells), 8, constant_values=255)
        scale, middle = 4 * side / (8 * cells), (len(tag) - 1) / 2
        c, s = scale * np.cos(angle), scale * np.sin(angle)
        x, y = 4 * (np.asarray(place) + 0.5) - 0.5
        matrix = np.array([[c, -s, x - (c - s) * middle], [s, c, y - (s + c) * middle]])
        shown = cv2.warpAffine(np.stack([tag, np.full_like(tag, 255)], axis=2), matrix, image.shape[::-1])
        image = np.where(shown[:, :, 1] > 127, shown[:, :, 0], image)
    small = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
    return np.repeat(small[:, :, None], 3, axis=2)


@pytest.fixture
def tracker() -> TagTracker:
    return TagTracker("4X4_50")


def test_a_marker_is_the_tag_at_its_point_and_goes_with_its_number(tracker):
    clicks = PLACES[[2, 0, 1]] + [[5.0, -6.0], [3.0, 8.0], [-9.0, 0.0]]
    positions, confidence = tracker.start(picture(), clicks, 0.0)
    np.testing.assert_allclose(positions, PLACES[[2, 0, 1]], atol=0.15)
    np.testing.assert_array_equal(confidence, 1.0)
    swapped = PLACES[::-1] + np.array([3.3, 1.2])  # tags 7 and 21 change places from one frame to the next
    positions, confidence = tracker.follow(picture(swapped, angle=1.7), 0.1)
    np.testing.assert_allclose(positions, swapped[[2, 0, 1]], atol=0.15)
    np.testing.assert_array_equal(confidence, 1.0)


@pytest.mark.parametrize("family", ["4X4_50", "apriltag_36h11", "DICT_APRILTAG_16h5"])
def test_without_a_click_tags_are_taken_in_the_order_of_their_numbers(family):
    known = {name.lower(): name for name in dir(cv2.aruco)}
    image = picture(family=known[f"dict_{family.lower().removeprefix('dict_')}"])
    points = TagTracker(family).points(image, 3)
    np.testing.assert_allclose(points, PLACES[[1, 0, 2]], atol=0.2)
    with pytest.raises(TrackingError, match=r"the first frame shows 3 tags of .* \(3, 7, 21\); there must be 4"):
        TagTracker(family).points(image, 4)


def test_what_cannot_be_read_is_lost_and_comes_back_under_its_name(tracker):
    tracker.start(picture(), PLACES, 0.0)
    covered = picture()
    covered[40:80, 60:95] = 255
    positions, confidence = tracker.follow(covered, 0.1)
    np.testing.assert_array_equal(confidence, [0, 1, 1])
    assert np.isnan(positions[0]).all()
    moved = PLACES + np.array([20.0, 5.0])
    positions, confidence = tracker.follow(picture(moved), 0.2)
    np.testing.assert_allclose(positions, moved, atol=0.15)
    np.testing.assert_array_equal(confidence, 1.0)


def test_one_number_seen_twice_or_in_another_size_is_doubted(tracker):
    tracker.start(picture(), PLACES, 0.0)
    twice = picture([*PLACES, [80.0, 180.0]], (*NUMBERS, 3))
    np.testing.assert_array_equal(tracker.follow(twice, 0.1)[1], [1, 0, 1])
    larger = picture(sides=[36.0, 36.0, 60.0])
    np.testing.assert_array_equal(tracker.follow(larger, 0.2)[1], [1, 1, 0])
    nothing = np.full_like(larger, 90)
    np.testing.assert_array_equal(tracker.follow(nothing, 0.3)[1], 0)


@pytest.mark.parametrize(
    ("image", "points", "says"),
    [
        (np.full((240, 380, 3), 150, np.uint8), PLACES, "no tag of 4X4_50 is in the first frame"),
        (picture(), BESIDE, "point 3 is at (300, 110); the nearest tag, number 21, is 60 px away"),
        (picture(), PLACES[[0, 1, 1]] + [[0, 0], [0, 0], [3.0, 0]], "points 2 and 3 lie on the same tag, number 3"),
        (picture(numbers=(7, 3, 7)), PLACES, "tag number 7 is in the first frame twice"),
    ],
)  # fmt: skip
def test_points_that_are_no_tags_are_refused(tracker, image, points, says):
    with pytest.raises(TrackingError) as caught:
        tracker.start(image, points, 0.0)
    assert says in str(caught.value)
