"""Trials as they are drawn: what comes of a comparison, which moments are shown, and limits that hold everything."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from views import BEAT, arm, swim

from recorded import FLOATER, PENDULUM
from swim2real.objective import ComparedBeat, ComparedProgress, ComparedTrial
from swim2real.rendering.trial_frame import COLORS, swing_chart
from swim2real.rendering.trial_view import Box, Swing, common_limits, view_of
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


@pytest.mark.parametrize(
    ("call", "words"),
    [(lambda view: replace(view, errors=view.errors[1:]), "errors has"),
     (lambda view: replace(view, path_real=view.real[1:]), "path_real has shape"),
     (lambda view: replace(view, times=view.times[::-1]), "times must"), (lambda view: view.moments(1), "count is 1"),
     (lambda view: common_limits([]), "views is empty"), (lambda view: Box(1, 0, 0, 1), "holds nothing")],
)  # fmt: skip
def test_what_does_not_fit_is_refused(call, words) -> None:
    with pytest.raises(ArgumentError, match=words):
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
