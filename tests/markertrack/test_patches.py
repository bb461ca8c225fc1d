"""A marker that is known by its picture: how it turns and grows, and what only resembles it."""

import cv2
import numpy as np
import pytest

from markertrack.tracking.patches import Patches

SIZE, RADIUS = 160, 12.0
CENTER = np.array([79.0, 81.0])
FLAT = np.full((1, 3), 85.0)  # as of a marker whose color tells nothing
FINE = 4
COARSE = np.random.default_rng(2).uniform(-1, 1, (9, 9)).astype(np.float32)
TEXTURE = cv2.resize(COARSE, None, fx=24, fy=24, interpolation=cv2.INTER_CUBIC)  # 4 times as fine as it is shown


def shown(*places, turn=0.0, size=1.0, contrast=80.0, noise=2.0, seed=0) -> np.ndarray:
    """A textured disc at some places, turned [rad] and enlarged, on gray; RGB."""
    levels = np.full((FINE * SIZE, FINE * SIZE), 120.0, np.float32)
    rows, columns = np.mgrid[: FINE * SIZE, : FINE * SIZE]
    middle = (len(TEXTURE) - 1) / 2
    for place in places:
        x, y = FINE * (np.asarray(place) + 0.5) - 0.5
        matrix = cv2.getRotationMatrix2D((middle, middle), np.degrees(turn), size)
        matrix[:, 2] += (x - middle, y - middle)
        texture = cv2.warpAffine(TEXTURE, matrix, levels.shape[::-1])
        inside = np.hypot(columns - x, rows - y) < FINE * size * RADIUS
        levels[inside] = 120 + contrast * texture[inside]
    small = cv2.resize(levels, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    small = small + np.random.default_rng(seed).normal(0, noise, small.shape)
    return np.repeat(np.clip(small, 0, 255).round().astype(np.uint8)[..., None], 3, axis=2)


def patches(image: np.ndarray, radius: float = RADIUS) -> Patches:
    return Patches(image, CENTER[None], np.array([radius]), FLAT)


@pytest.mark.parametrize(("learns", "close"), [(True, 0.5), (False, 1.0)])
@pytest.mark.parametrize(("turn", "size"), [(np.pi / 2, 1.0), (-1.0, 1 / 1.4)])
def test_a_picture_that_turns_and_grows_is_followed(turn, size, learns, close):
    """In 16 steps, while it moves by 2 px in each; less well where nothing is ever taken in."""
    known, place = patches(shown(CENTER)), CENTER
    for step in range(1, 17):
        truth = CENTER + 2.0 * step * np.array([0.6, -0.8])
        image = shown(truth, turn=turn * step / 16, size=size ** (step / 16), seed=step)
        peak = known.find(image, 0, place, 6.0)[0]
        place = np.array([peak.x, peak.y])
        assert np.hypot(*(place - truth)) < close
        assert peak.score > 0.8
        if learns:
            known.learn(image, 0, truth)


def test_the_same_pattern_with_a_tenth_of_the_contrast_is_none():
    known = patches(shown(CENTER))
    assert known.find(shown(CENTER, contrast=40.0, noise=0.5), 0, CENTER, 8.0)  # half of it is one
    assert not known.find(shown(CENTER, contrast=8.0, noise=0.5), 0, CENTER, 8.0)
    assert not known.find(shown(noise=8.0), 0, CENTER, 8.0)


def test_two_equal_ones_are_two_peaks_and_the_nearer_one_is_the_first():
    known, right = patches(shown(CENTER)), CENTER + np.array([28.0, 0.0])
    image = shown(CENTER, right)
    for along, order in ((10, (CENTER, right)), (18, (right, CENTER))):
        peaks = known.find(image, 0, CENTER + np.array([along, 0]), 24.0)
        assert len(peaks) == 2
        for peak, truth in zip(peaks, order, strict=True):
            assert np.hypot(peak.x - truth[0], peak.y - truth[1]) < 0.5
    assert len(known.find(image, 0, CENTER, 8.0)) == 1  # the other one is beyond the reach


def test_large_markers_are_looked_at_in_less_detail_and_found_as_well():
    big = cv2.resize(shown(CENTER), None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    center = 3 * (CENTER + 0.5) - 0.5
    moved = np.roll(big, (7, -11), axis=(0, 1))
    peak = Patches(big, center[None], np.array([3 * RADIUS]), FLAT).find(moved, 0, center, 20.0)[0]
    np.testing.assert_allclose((peak.x, peak.y), center + np.array([-11, 7]), atol=0.7)
