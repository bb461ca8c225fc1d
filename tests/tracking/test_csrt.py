import cv2
import numpy as np
import pytest

from swim2real.errors import ArgumentError, MissingExtraError
from swim2real.tracking.tracker import CsrtTracker

START = np.array([[90.25, 60.5], [150.0, 64.75], [230.5, 70.0]])
STEP = np.array([2.5, 1.25])


def clip(frames, step=STEP, start=START):
    """Yellow discs that move over still noise."""
    rng = np.random.default_rng(0)
    water = rng.normal([60, 90, 120], 8, (240, 420, 3))
    y, x = np.mgrid[:240, :420]
    for k in range(frames):
        image = water.copy()
        for cx, cy in start + k * step:
            cover = np.clip(7.5 - np.hypot(x - cx, y - cy), 0, 1)[..., None]
            image = image * (1 - cover) + np.array([240, 210, 40]) * cover
        yield np.clip(image, 0, 255).astype(np.uint8)


def track(frames, crop=True, **more):
    tracker = CsrtTracker(box=24, crop=crop)
    found = []
    for k, image in enumerate(clip(frames, **more)):
        if k == 0:
            tracker.start(image, START, 0.0)
        else:
            found.append(tracker.follow(image, k / 60))
    return np.array([positions for positions, _ in found]), np.array([confidence for _, confidence in found])


@pytest.mark.slow
def test_markers_are_followed():
    positions, confidence = track(20)
    truth = START + np.arange(1, 20)[:, None, None] * STEP
    errors = np.linalg.norm(positions - truth, axis=2)
    assert errors.max() < 2.5
    assert errors.mean() < 1.2
    np.testing.assert_array_equal(confidence, 1)


@pytest.mark.slow
def test_a_crop_gives_the_same_positions():
    for step in (STEP, -STEP):
        whole, _ = track(8, crop=False, step=step)
        cropped, _ = track(8, crop=True, step=step)
        np.testing.assert_array_equal(whole, cropped)


def test_a_click_between_pixels_stays_there_while_nothing_moves():
    positions, _ = track(4, step=np.zeros(2))
    assert np.abs(positions - START).max() <= 0.5


def test_a_lost_marker_is_nan_and_the_others_go_on():
    tracker = CsrtTracker(box=24)
    first, second, third = clip(3, step=np.ones(2))
    tracker.start(first, START, 0.0)
    gone = second.copy()
    gone[:, :120] = 90
    positions, confidence = tracker.follow(gone, 1 / 60)
    np.testing.assert_array_equal(confidence, [0, 1, 1])
    assert np.isnan(positions[0]).all()
    np.testing.assert_allclose(positions[1:], START[1:] + 1, atol=1.5)
    positions, _ = tracker.follow(third, 2 / 60)
    np.testing.assert_allclose(positions[1:], START[1:] + 2, atol=1.5)


@pytest.mark.slow
def test_markers_that_leave_the_frame_do_no_harm():
    positions, confidence = track(16, step=np.array([24.0, 0.0]))
    assert positions.shape == (15, 3, 2)
    assert set(np.unique(confidence)) <= {0.0, 1.0}


def test_a_box_must_hold_something():
    with pytest.raises(ArgumentError, match="the box of CSRT is 4 px; it must be 8 px or more, about 40"):
        CsrtTracker(box=4)


def test_an_opencv_without_contrib_says_how_to_repair_it(monkeypatch):
    monkeypatch.delattr(cv2, "TrackerCSRT")
    monkeypatch.setattr(cv2, "__version__", "5.0.0")
    with pytest.raises(MissingExtraError) as caught:
        CsrtTracker()
    assert str(caught.value) == (
        "the installed OpenCV 5.0.0 has no TrackerCSRT: a wheel without the contrib modules, such as opencv-python, "
        "has overwritten the one with them; repair it with: "
        "pip install --force-reinstall --no-deps opencv-contrib-python-headless"
    )
