import cv2
import numpy as np
import pytest

from markertrack.tracking import opencv
from markertrack.tracking.opencv import CsrtTracker
from swimbase.errors import ArgumentError, MissingExtraError

START = np.array([[90.25, 60.5], [150.0, 64.75], [230.5, 70.0]])
STEP = np.array([2.5, 1.25])


def clip(frames, step=STEP):
    """Yellow discs that move over still noise."""
    water = np.random.default_rng(0).normal([60, 90, 120], 8, (240, 420, 3))
    y, x = np.mgrid[:240, :420]
    for k in range(frames):
        image = water.copy()
        for cx, cy in START + k * step:
            cover = np.clip(7.5 - np.hypot(x - cx, y - cy), 0, 1)[..., None]
            image = image * (1 - cover) + np.array([240, 210, 40]) * cover
        yield np.clip(image, 0, 255).astype(np.uint8)


def track(frames, **more):
    tracker = CsrtTracker(box=24)
    first, *others = clip(frames, **more)
    tracker.start(first, START, 0.0)
    positions, confidence = zip(*(tracker.follow(image, k / 60) for k, image in enumerate(others, 1)), strict=True)
    return np.array(positions), np.array(confidence)


@pytest.mark.slow
@pytest.mark.parametrize("step", [STEP, -STEP])
def test_markers_are_followed_and_a_crop_changes_nothing(monkeypatch, step):
    positions, confidence = track(12, step=step)
    errors = np.linalg.norm(positions - (START + np.arange(1, 12)[:, None, None] * step), axis=2)
    assert errors.max() < 2.5
    assert errors.mean() < 1.2
    np.testing.assert_array_equal(confidence, 1)
    monkeypatch.setattr(opencv, "REACH", 1000)  # it is shown the whole picture
    np.testing.assert_array_equal(positions, track(12, step=step)[0])


def test_a_click_between_pixels_stays_there_while_nothing_moves():
    assert np.abs(track(4, step=np.zeros(2))[0] - START).max() <= 0.5


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


def test_a_box_must_hold_something_and_opencv_have_csrt(monkeypatch):
    with pytest.raises(ArgumentError, match="box of CSRT is 4 px; it must be 8 px or more"):
        CsrtTracker(box=4)
    monkeypatch.delattr(cv2, "TrackerCSRT")
    with pytest.raises(MissingExtraError, match=r"no TrackerCSRT.*pip install .*opencv-contrib-python-headless"):
        CsrtTracker()
