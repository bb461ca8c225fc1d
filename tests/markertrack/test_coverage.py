"""How much a marker covers of a pixel, by its color."""

import numpy as np
import pytest

from markertrack.tracking.coverage import TERMS, Coverage, covered

CENTER, RADIUS = np.array([[40.0, 30.0]]), 8.0
ROWS, COLUMNS = np.mgrid[:60, :80]
AWAY = np.hypot(COLUMNS - CENTER[0, 0], ROWS - CENTER[0, 1])
DISC = np.clip(RADIUS + 0.5 - AWAY, 0.0, 1.0)
BRIGHT, GRAY, DARK = np.array([215.0, 212.0, 205.0]), np.array([120.0, 118.0, 122.0]), np.array([30.0, 32.0, 36.0])
CAR = ((np.abs(COLUMNS - 40) < 11) & (np.abs(ROWS - 30) < 20))[..., None]


def seen(share, ground, marker):
    """A marker that covers some share of each pixel, with noise."""
    light = share[..., None] * marker**2.2 + (1 - share[..., None]) * ground**2.2
    noise = np.random.default_rng(0).normal(0.0, 2.0, light.shape)
    return (light ** (1 / 2.2) + noise).clip(0, 255).astype(np.uint8)


def learned(image):
    return Coverage(image, CENTER, np.array([RADIUS]), 0.0)


def by_color(image, coverage):
    return np.array([covered(image, i, j, coverage.weights[0]) for i, j in np.ndindex(AWAY.shape)]).reshape(AWAY.shape)


def test_a_marker_is_told_from_lighter_and_darker_surroundings_at_once():
    """A gray one on a dark car that is little wider, on bright ground."""
    image = seen(DISC, np.where(CAR, DARK, BRIGHT), GRAY)
    coverage = learned(image)
    share = by_color(image, coverage)
    assert coverage.clear.all()
    assert share[AWAY < RADIUS - 1].mean() > 0.95
    beside = share[(AWAY > RADIUS + 1) & (AWAY < 2 * RADIUS)]
    assert (beside < coverage.weights[0, TERMS]).mean() > 0.95


@pytest.mark.parametrize("blur", [0.3, 0.5, 0.8])
def test_a_blurred_marker_covers_its_share(blur):
    coverage = learned(seen(DISC, BRIGHT, DARK))
    share = by_color(seen(blur * DISC, BRIGHT, DARK), coverage)
    assert share[AWAY < RADIUS - 1].mean() == pytest.approx(blur, abs=0.1)


def test_what_is_around_a_marker_is_told_from_it_in_the_light_of_now():
    """White ground turns gray in a picture; the marker stays black."""
    coverage, later = learned(seen(DISC, BRIGHT, DARK)), seen(DISC, GRAY, DARK)
    around = (AWAY > RADIUS + 1) & (AWAY < 2 * RADIUS)
    before = by_color(later, coverage)
    coverage.learn(later, CENTER, np.array([RADIUS]), np.array([0]))
    after = by_color(later, coverage)
    assert before[around].mean() > 0.3
    assert after[around].mean() < 0.1
    assert after[AWAY < RADIUS - 1].mean() > 0.95
