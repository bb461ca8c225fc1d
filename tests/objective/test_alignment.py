import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swim2real.objective import align
from swim2real.objective.alignment import register, weighted_distance

PERIOD = 0.8
TIMES = np.arange(200) / 60
ONES = np.ones((200, 4))
PHASES = np.array([0.0, 0.4, 1.0, 1.9])
OFFSETS = np.array([[0.0, 0.0], [0.01, -0.02], [-0.005, 0.09], [0.03, 0.02]])


def body(times):
    """Four markers, three of them waving with harmonics. Shape (T, 4, 2)."""
    angle = 2 * np.pi * np.asarray(times)[:, None] / PERIOD - PHASES
    sideways = np.array([0.0, 0.01, 0.04, 0.08]) * (np.cos(angle) + 0.2 * np.cos(3 * angle))
    along = np.array([0.0, 0.14, 0.4, 0.55]) + 0.01 * np.cos(2 * angle)
    return np.stack([along, sideways], axis=2)


@pytest.mark.slow
@given(st.floats(0.0, PERIOD, exclude_max=True), st.sampled_from([0.0, 1.0]))
@example(0.123, 1.0)
def test_a_known_shift_is_recovered_off_the_frame_grid_with_the_registration(shift, placed):
    alignment = align(body, body(TIMES + shift) + placed * OFFSETS, TIMES, ONES, PERIOD)
    miss = (alignment.shift - shift + PERIOD / 2) % PERIOD - PERIOD / 2
    assert abs(miss) < 5e-4 * PERIOD
    assert 0 <= alignment.shift < PERIOD
    assert alignment.shape_error < 2e-4
    np.testing.assert_allclose(alignment.registration, placed * OFFSETS, atol=5e-4)


def test_lost_and_missing_frames_have_no_say():
    real = body(TIMES + 0.3)
    weights = ONES.copy()
    real[50:, 2] += 0.2  # lost, and known to be
    weights[50:, 2] = 0.0
    real[20:60, 3] = np.nan  # not seen, though nobody said so
    real[:, 1] = np.nan
    alignment = align(body, real, TIMES, weights, PERIOD)
    assert alignment.shift == pytest.approx(0.3, abs=5e-4)
    np.testing.assert_allclose(alignment.registration, 0.0, atol=1e-3)
    assert alignment.shape_error < 2e-4
    nothing = align(body, np.full((200, 4, 2), np.nan), TIMES, ONES, PERIOD)
    assert nothing.shape_error == 0.0
    np.testing.assert_array_equal(nothing.registration, 0.0)


def test_the_shift_found_is_the_best_there_is():
    real = body(TIMES + 0.21) + np.random.default_rng(0).normal(0, 0.01, (200, 4, 2))
    alignment = align(body, real, TIMES, ONES, PERIOD)

    def shape_error(shift):
        difference = real - body(TIMES + shift)
        return weighted_distance(difference - np.median(difference, axis=0), ONES)

    assert alignment.shape_error <= min(map(shape_error, np.linspace(0, PERIOD, 401))) + 1e-5
    assert alignment.shape_error == pytest.approx(shape_error(alignment.shift), rel=1e-9)


def test_registration_and_distance_count_what_has_weight():
    difference = np.zeros((5, 2, 2))
    difference[:, 0] = [[1, 10], [2, 20], [3, 30], [4, 40], [100, 1000]]
    weights = np.ones((5, 2))
    weights[4, 0] = weights[:, 1] = 0
    np.testing.assert_array_equal(register(difference, weights), [[2.5, 25], [0, 0]])
    np.testing.assert_array_equal(register(difference, np.ones((5, 2))), [[3, 30], [0, 0]])
    residual = np.array([[[3.0, 4.0], [0.0, 1.0]], [[6.0, 8.0], [np.nan, 0.0]]])
    for weights, expected in (([[1, 1], [1, 0]], 16 / 3), ([[2, 0], [1, 0]], 20 / 3), ([[0, 0], [0, 0]], 0)):
        assert weighted_distance(residual, np.array(weights, float)) == pytest.approx(expected)


def test_a_marker_is_registered_by_the_median_of_the_frames_in_which_it_counts() -> None:
    rng = np.random.default_rng(0)
    difference, weights = rng.standard_normal((40, 5, 2)), (rng.random((40, 5)) < 0.6).astype(float)
    weights[:, 0], weights[:, 1], weights[:-1, 2] = 0.0, 1.0, 0.0
    difference[weights == 0] = np.nan
    expected = [np.median(difference[weights[:, m] > 0, m], axis=0) for m in range(1, 5)]
    assert np.array_equal(register(difference, weights), [np.zeros(2), *expected])
