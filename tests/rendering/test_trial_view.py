"""Trials as they are drawn: what comes of a comparison, which moments are shown, and limits that hold everything."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from views import ARM_RATE, BEAT, arm, swim

from recorded import FLOATER, PENDULUM
from swim2real.objective import ComparedBeat, ComparedProgress, ComparedTrial
from swim2real.rendering.trial_frame import COLORS, swing_chart
from swim2real.rendering.trial_view import Box, Swing, common_limits, grid_step, length_text, rounded_up, view_of
from swim2real.robots.fish import FISH
from swimbase.errors import ArgumentError

TIMES = np.arange(11) / 10


def compared(markers: int, **more) -> ComparedTrial:
    """A trial whose simulation is 10 mm off along y; the first marker is lost in all frames but the first two."""
    real = np.zeros((11, markers, 2)) + np.stack([0.1 * np.arange(markers), np.zeros(markers)], axis=1)
    real[:, 1:, 1] += 0.05 * TIMES[:, None]
    weights = np.ones((11, markers))
    weights[2:, 0] = 0
    values = {
        "registration": np.zeros((markers, 2)), "path_real": real + 1.0,
        "path_simulated": real + np.array([1.0, 1.01]), **more,
    }  # fmt: skip
    return ComparedTrial("t", "aligned_marker_error", TIMES, weights, real, real + np.array([0.0, 0.01]), **values)


def test_a_recording_is_drawn_with_its_links_and_axes() -> None:
    view = view_of(compared(3), PENDULUM)
    assert (view.frequency, view.path_real, view.about) == (None, None, "")
    assert view.axes == "x right, z up"
    assert view.lines == ((0, 1, 2),) or PENDULUM.links == ()
    assert np.isnan(view.real[2:, 0]).all()
    assert view.error == pytest.approx(0.01)
    np.testing.assert_allclose(view.errors, 0.01)


def test_a_robot_that_travels_is_seen_from_its_first_pose() -> None:
    progress = 0.1 * TIMES
    trial = compared(4, frame=(0, 1), progress=ComparedProgress(progress, progress, 0.1, 0.1))
    view = view_of(trial, FLOATER)
    assert view.axes == "nose at the origin, neck to its right"
    assert view.path_real is not None
    assert view.path_simulated is not None
    np.testing.assert_allclose(view.path_real[0, :2, 1], 0, atol=1e-12)
    np.testing.assert_allclose(view.path_simulated[0, 0], 0, atol=1e-12)
    assert view.path_real[-1, 1, 1] == pytest.approx(0.05)
    assert view_of(replace(trial, weights=np.zeros((11, 4))), FLOATER).path_real is None


def test_a_swim_is_registered_by_markers_that_were_seen() -> None:
    registration = np.zeros((9, 2))
    registration[0], registration[1:] = (5.0, 5.0), (0.02, 0.0)
    progress = 0.1 * TIMES
    beat = ComparedBeat(1.5, 1.5, 0.0, 0.0, np.zeros((11, 9, 2)))
    way = ComparedProgress(progress, progress, 0.1, 0.1)
    trial = compared(9, registration=registration, frame=(0, 1), beat=beat, progress=way)
    view = view_of(trial, FISH)
    assert (view.about, view.axes) == ("1.50 Hz", "body frame, head at the left")
    assert view.lines == (tuple(range(9)),)
    np.testing.assert_allclose(view.simulated[0, 0], trial.simulated[0, 0] + [0.02, 0])  # its neighbor's
    np.testing.assert_array_equal(view.path_simulated, trial.path_simulated)
    bad = view_of(replace(trial, divergence="it grew"), FISH)
    assert bad.diverged
    assert np.isnan(bad.error)
    assert np.isnan(bad.errors).all()


def test_limits_hold_everything_and_are_common() -> None:
    views = [arm(travels=True), arm("b", 1.0, travels=True)]
    limits = common_limits(views)
    for view in views:
        for box, arrays in (
            (limits.plane, (view.real, view.simulated)), (limits.path, (view.path_real, view.path_simulated))
        ):  # fmt: skip
            places = np.concatenate([array.reshape(-1, 2) for array in arrays])
            assert (places > [box.left, box.bottom]).all()
            assert (places < [box.right, box.top]).all()
        assert limits.error >= view.errors.max()
    assert common_limits(views[::-1]) == limits
    assert common_limits([arm()]).path is None
    assert common_limits([arm(diverged=True, lost=(0, 1, 2, 3))]).plane.right > 0


@settings(max_examples=20)
@given(far=st.floats(2.0, 1e6))
def test_a_simulation_that_goes_astray_does_not_shrink_the_others(far) -> None:
    view = swim(seconds=0.5)
    astray = replace(view, path_simulated=view.path_simulated - [far, 0.0])
    alone, both = common_limits([replace(view, path_simulated=view.path_real)]).path, common_limits([astray]).path
    assert 1 < (both.right - both.left) / (alone.right - alone.left) < 2.0


@settings(max_examples=20)
@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0))
def test_boxes_are_neither_flat_nor_tall(wide, tall) -> None:
    view = swim(seconds=0.5)
    points = np.zeros_like(view.real)
    points[0, 0], points[1, 0] = (0.0, 0.0), (wide, tall)
    box = common_limits([replace(view, real=points, simulated=points)]).plane
    assert 0.29 < (box.top - box.bottom) / (box.right - box.left) < 0.91
    assert box.left < 0 < wide < box.right
    assert box.bottom < 0 < tall < box.top


@settings(max_examples=50)
@given(st.floats(1e-6, 1e6))
def test_steps_are_round_and_not_much_longer(length) -> None:
    step = rounded_up(length)
    assert length <= step * (1 + 1e-6)
    assert step <= 2.5 * length * (1 + 1e-6)
    assert f"{step:.0e}"[0] in "125"


def test_lengths_are_told_in_the_unit_that_fits() -> None:
    assert [length_text(length) for length in (2.0, 0.1, 0.05, 0.0005)] == ["2 m", "0.1 m", "50 mm", "0.5 mm"]
    assert grid_step(Box(0, 0, 1.2, 0.5)) == pytest.approx(0.1)


def test_the_pace_is_that_of_the_motion() -> None:
    assert arm(seconds=20.0).pace == pytest.approx(ARM_RATE, abs=0.05)
    still = arm()
    noise = np.random.default_rng(0).normal(0, 1e-3, still.real.shape)
    assert replace(still, real=still.real[:1] + noise).pace == 0
    assert arm(lost=(0, 1, 2, 3)).pace == 0
    assert swim().pace == 1 / BEAT


def test_a_beat_begins_where_the_tail_is_at_the_left_and_lies_in_the_middle() -> None:
    times, shares = arm().moments(4)  # without a beat: from start to end
    np.testing.assert_allclose(times, [2, 3, 4, 5])
    np.testing.assert_allclose(shares, [0, 1 / 3, 2 / 3, 1])
    for seconds in (0.8, 1.3, 2.0, 5.0):
        times, shares = swim(seconds=seconds).moments(8)
        np.testing.assert_allclose(shares, np.arange(8) / 8)
        assert (times >= 0).all()
        assert (times <= seconds).all()
        phase = times / BEAT - shares
        np.testing.assert_allclose(phase, np.round(phase), atol=1e-6)  # the tail is a cosine
        assert abs(times.mean() - seconds / 2) < BEAT
    times, shares = swim(seconds=0.3).moments(4)
    np.testing.assert_allclose(times, [0, 0.075, 0.15, 0.225], atol=1e-9)
    np.testing.assert_allclose(shares, times / BEAT)
    times, _ = swim(lost=(4,)).moments(8)  # by the simulated tail, which lags behind by 4 x 0.3
    assert (times[0] / BEAT - 1.2 / (2 * np.pi) + 0.5) % 1 == pytest.approx(0.5, abs=1e-6)


def test_trails_are_a_beat_of_the_tail_or_a_share_of_the_trial_of_all() -> None:
    nearest = swim().nearest(np.array([-1, 0, 0.008, 0.0085, 0.05, 2.0, 9.0]))
    np.testing.assert_array_equal(nearest, [0, 0, 0, 1, 3, 120, 120])
    assert swim().trail(60) == (slice(30, 61), (4,))
    assert swim().trail(5) == (slice(0, 6), (4,))
    assert arm().trail(60) == (slice(53, 61), (0, 1, 2, 3))  # 8 % of 3 s


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda view: replace(view, errors=view.errors[1:]), "view 'a': errors has shape (90,); it must have (91,)"),
        (lambda view: replace(view, path_real=view.real[1:]), "view 'a': path_real has shape (90, 4, 2)"),
        (lambda view: replace(view, seen=view.seen[:, 1:]), "seen has shape (91, 3); it must have (91, 4)"),
        (lambda view: replace(view, times=view.times[::-1]), "times must be 2 or more finite numbers that rise"),
        (lambda view: view.moments(1), "count is 1"),
        (lambda view: swim().moments(0), "count is 0"),
        (lambda view: common_limits([]), "views is empty"),
        (lambda view: Box(1, 0, 0, 1), "a box from (1, 0) to (0, 1) m holds nothing"),
    ],
)
def test_what_does_not_fit_is_refused(call, words) -> None:
    with pytest.raises(ArgumentError, match=re.escape(words)):
        call(arm())


def test_small_differences_are_enlarged_and_large_ones_are_not() -> None:
    view = view_of(compared(3), PENDULUM)  # 10 mm off along y, the first marker is lost at the end
    factor, enlarged = view.enlarged(0.6)
    assert factor == 5  # 10 times would be more than a tenth of the width
    np.testing.assert_allclose((enlarged.simulated - enlarged.real)[:, 1:, 1], 0.05)
    assert np.isnan(enlarged.simulated[2:, 0]).all()
    assert view.enlarged(0.15)[0] == 1
    assert swim(diverged=True).enlarged(1.0)[0] == 1


def test_the_swings_of_the_head_have_the_whole_trials_scale() -> None:
    swings = [Swing("yaw", "deg", np.array([0.0, 3.0, np.nan]), np.array([0.0, -size, 1.0])) for size in (4.0, 14.0)]
    assert [swing.size for swing in swings] == [4.0, 14.0]
    views = [replace(swim(), swings=(swing,)) for swing in swings]
    assert common_limits(views).swings == (20.0,)
    chart = np.asarray(swing_chart(swings[1], np.array([0.0, 0.1, 0.2]), 20.0, 200, 11.0))
    assert chart.shape[1] == 200
    assert (chart == COLORS["simulated"]).all(axis=2).any()
    assert not common_limits([swim()]).swings
