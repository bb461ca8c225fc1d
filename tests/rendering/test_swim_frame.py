"""Swims as they are drawn: that blue and red are where the arrays say, and that nothing is drawn that isn't known."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swim2real.errors import ArgumentError
from swim2real.rendering.drawing import text_size
from swim2real.rendering.labels import shortened
from swim2real.rendering.panel import COLORS, DIVERGED, GROUND, SIDES, Panel
from swim2real.rendering.swim_frame import draw_frame
from swim2real.rendering.swim_panel import body_panel, course_panel, distance
from swim2real.rendering.swim_view import Limits, SwimView, common_limits
from swim2real.rendering.view import Box

NAMES = ("M0", "M1", "M2", "M3", "M4")
REST = np.array([0.0, 0.12, 0.3, 0.4, 0.5])  # m
BEAT = 0.5  # s
RIGHT_SPEED, WRONG_SPEED = 0.1, 0.15  # m/s


def body(times: np.ndarray, swing: float, lag: float = 0.0) -> np.ndarray:
    """A body whose tail swings [m]. Shape (T, 5, 2)."""
    bend = swing * np.array([0.0, 0.0, 0.2, 0.5, 1.0])
    side = bend * np.cos(2 * np.pi * (times / BEAT)[:, None] - lag * np.arange(5))
    return np.stack([np.broadcast_to(REST, side.shape), side], axis=-1)


def course(shape: np.ndarray, times: np.ndarray, speed: float) -> np.ndarray:
    shift = np.stack([speed * times, 0 * times], axis=-1)[:, None]
    return shape - [REST[:2].mean(), 0] - shift


def swim(name: str = "f2_00", seconds: float = 2.0, lost: tuple[int, ...] = (), diverged: bool = False) -> SwimView:
    times = np.arange(round(60 * seconds) + 1) / 60
    real, simulated = body(times, 0.06), body(times, 0.12, 0.3)
    seen = np.ones((times.size, 5), bool)
    seen[:, list(lost)] = False
    ways = course(real, times, RIGHT_SPEED), course(simulated, times, WRONG_SPEED)
    if diverged:
        simulated, ways = np.full_like(simulated, np.nan), (ways[0], np.full_like(simulated, np.nan))
    return SwimView(name, times, seen, real, simulated, NAMES, 1 / BEAT, *ways)


def pixels(image) -> np.ndarray:
    return np.asarray(image).astype(int)


def like(image: np.ndarray, side: str, tolerance: int = 90) -> np.ndarray:
    """Which pixels are rather of a side's color than white. Shape (H, W)."""
    return np.abs(image - np.array(COLORS[side])).max(axis=-1) < tolerance


def near(image: np.ndarray, place, side: str, radius: float) -> float:
    """The share of a disc that has a side's color."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return float(like(image, side)[np.hypot(x - place[0], y - place[1]) <= radius].mean())


def test_simulated_dots_and_real_rings_are_where_they_should_be():
    view = swim()
    panel = Panel(common_limits([view]).body, 624)
    image = pixels(body_panel(view, 30, panel))
    assert image.shape == (panel.height, 624, 3)
    real, simulated = panel.places(view.real[30]), panel.places(view.simulated[30])
    assert np.hypot(*(real - simulated).T)[2:].min() > 8  # so that they can be told apart
    for place in simulated:
        assert near(image, place, "simulated", 2.5) > 0.9
    for place in real[2:]:
        angles = np.linspace(0, 2 * np.pi, 40)
        around = np.round(place + 6.2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)).astype(int)
        assert like(image, "real", 110)[around[:, 1], around[:, 0]].mean() > 0.8
    for place in real[2:4]:  # the last one is on its trail
        away = np.round(place - (0, 3.5)).astype(int)
        assert np.abs(image[away[1], away[0]] - GROUND).max() < 40  # a ring is hollow
    for start, end in itertools.pairwise(simulated):
        assert near(image, (start + end) / 2, "simulated", 0.8) > 0.5


def test_both_axes_have_the_same_scale_and_y_is_up():
    panel = Panel(Box(-0.1, -0.2, 0.7, 0.2), 800)
    assert panel.height == 400
    np.testing.assert_allclose(panel.places(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])), [
        [99.5, 199.5], [199.5, 199.5], [99.5, 99.5],
    ])  # fmt: skip


def test_lost_markers_are_not_drawn():
    whole, view = swim(), swim(lost=(3,))
    panel = Panel(common_limits([whole]).body, 624)
    place = panel.places(whole.real[30, 3])
    with_it, without = (pixels(body_panel(v, 30, panel)) for v in (whole, view))
    assert near(with_it, place, "real", 8) > 0.2
    assert near(without, place, "real", 8) == 0
    between = panel.places((whole.real[30, 3] + whole.real[30, 4]) / 2)
    assert near(with_it, between, "real", 1.5) > 0.3
    assert near(without, between, "real", 3) == 0  # a gap in the line
    assert near(without, panel.places(whole.real[30, 4]), "real", 8) > 0.2
    assert np.isnan(view.real[:, 3]).all()
    assert np.isnan(view.course_real[:, 3]).all()


def test_the_frame_says_which_markers_are_lost():
    panel = Panel(common_limits([swim()]).body, 624)
    images = [pixels(body_panel(swim(lost=lost), 30, panel, 18)) for lost in ((), (3,), (1, 2, 3), tuple(range(5)))]
    written = [like(image, "real", 60)[-36:, 312:] for image in images]
    assert not written[0].any()
    starts = [int(np.flatnonzero(text.any(axis=0))[0]) for text in written[1:]]
    assert starts[1] < starts[0] - 20  # three names take more room than one
    assert all(np.flatnonzero(text.any(axis=0))[-1] < 311 for text in written[1:])
    narrow = Panel(panel.box, 180)
    image = pixels(body_panel(swim(lost=(0, 1, 2, 3)), 30, narrow, 13))
    assert np.flatnonzero(like(image, "real", 60)[-22:].any(axis=0))[0] > 36  # a number in place of names


def test_the_trail_is_the_last_beat_of_the_last_marker():
    view = swim()
    panel = Panel(common_limits([view]).body, 624)
    assert view.last_beat(60) == slice(30, 61)
    assert view.last_beat(5) == slice(0, 6)
    early, late = (pixels(body_panel(view, index, panel)) for index in (1, 61))
    before = panel.places(view.simulated[51, -1])  # a third of a beat ago
    assert np.hypot(*(before - panel.places(view.simulated[61, -1]))) > 40

    def blue(image):
        x, y = np.round(before).astype(int)
        return (image[y - 2 : y + 3, x - 2 : x + 3, 2] - image[y - 2 : y + 3, x - 2 : x + 3, 0]).max()

    assert blue(late) > 60
    assert blue(early) < 20


@pytest.mark.parametrize("side", SIDES)
def test_a_course_shows_how_far_both_heads_have_come(side):
    view, index = swim(), 90
    panel = Panel(common_limits([view]).course, 304)
    image = pixels(course_panel(view, index, side, panel))
    for other, speed in (("real", RIGHT_SPEED), ("simulated", WRONG_SPEED)):
        assert distance(view, index, other) == pytest.approx(1.5 * speed)
        column = round(panel.places(np.array([-1.5 * speed, 0]))[0])
        tint = image[:, column - 1 : column + 2] - image[:, column - 1 : column + 2].mean(axis=-1, keepdims=True)
        hue = np.array(COLORS[other]) - np.mean(COLORS[other])
        share = ((tint @ hue) / np.linalg.norm(hue) > 35).any(axis=1).mean()
        assert share == pytest.approx(0.5 if other == "real" else 1.0, abs=0.2)  # dashed, solid
    other = SIDES[1 - SIDES.index(side)]
    places = panel.places((view.course_real if side == "real" else view.course_simulated)[index])
    assert all(near(image, place, side, 4) > 0.1 for place in places)
    assert near(image, places[-1], other, 4) == 0


def test_a_frame_is_even_and_deterministic_and_changes_with_time():
    view = swim()
    limits = common_limits([view])
    for width in (320, 480, 640, 1282):
        frame = draw_frame(view, 30, limits, width)
        assert frame.dtype == np.uint8
        assert frame.shape[1] == width
        assert frame.shape[0] % 2 == 0
        assert width / 2 < frame.shape[0] < 1.2 * width
        np.testing.assert_array_equal(frame, draw_frame(swim(), 30, limits, width))
        assert (frame != draw_frame(view, 31, limits, width)).any()


def test_text_can_be_read():
    frame = pixels(draw_frame(swim(), 30, common_limits([swim()]), 640))
    head = np.abs(frame[:36] - frame[0, 0]).max(axis=(1, 2)) > 100
    rows = np.flatnonzero(head[:36])
    assert rows[-1] - rows[0] + 1 >= 12  # px


def test_a_diverged_simulation_is_named():
    view, good = swim(diverged=True), swim()
    assert view.diverged
    assert not good.diverged
    limits = common_limits([view, good])
    frame = pixels(draw_frame(view, 30, limits, 640))
    panel = Panel(limits.body, 624)
    image = pixels(body_panel(view, 30, panel))
    assert near(image, panel.places(view.real[30, 4]), "real", 8) > 0.2  # the real swim is there all the same
    assert near(image, panel.places(good.simulated[30, 4]), "simulated", 8) == 0
    plate = like(frame, "simulated", 60)
    wide = text_size(DIVERGED, 12)[0]
    assert np.count_nonzero(plate.sum(axis=1) > 0.8 * wide) > 20
    assert np.isnan(distance(view, 30, "simulated"))


def test_limits_hold_everything_and_are_common():
    views = [swim(), swim("slow", seconds=1.0)]
    limits = common_limits(views)
    for view in views:
        for box, arrays in ((limits.body, (view.real, view.simulated)), (limits.course, (view.course_real,))):
            points = np.concatenate([array.reshape(-1, 2) for array in arrays])
            assert (points > [box.left, box.bottom]).all()
            assert (points < [box.right, box.top]).all()
    assert common_limits(views[::-1]) == limits
    assert common_limits([swim(diverged=True, lost=tuple(range(5)))]).body.right > 0


@given(far=st.floats(2.0, 1e6))
def test_a_swim_that_goes_astray_does_not_shrink_the_others(far):
    view = swim()
    astray = replace(view, course_simulated=view.course_simulated - [far, 0.0])
    real, all_of_it = common_limits([replace(view, course_simulated=view.course_real)]), common_limits([astray])
    ratio = (all_of_it.course.right - all_of_it.course.left) / (real.course.right - real.course.left)
    assert 1 < ratio < 1.7
    image = course_panel(astray, 30, "simulated", Panel(all_of_it.course, 304))
    assert not like(pixels(image), "simulated").any()


@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0))
def test_boxes_are_neither_flat_nor_tall(wide, tall):
    view = swim()
    points = np.zeros_like(view.real)
    points[0, 0], points[1, 0] = (0.0, 0.0), (wide, tall)
    box = common_limits([replace(view, real=points, simulated=points)]).body
    assert 0.29 < (box.top - box.bottom) / (box.right - box.left) < 0.71
    assert box.left < 0
    assert box.right > wide
    assert box.bottom < 0
    assert box.top > tall


def test_a_beat_begins_where_the_tail_is_at_the_left_and_lies_in_the_middle():
    for seconds in (0.8, 1.3, 2.0, 5.0):
        view = swim(seconds=seconds)
        times, shares = view.beat(8)
        np.testing.assert_allclose(shares, np.arange(8) / 8)
        assert (times >= 0).all()
        assert (times <= seconds).all()
        phase = times / BEAT - shares
        np.testing.assert_allclose(phase, np.round(phase), atol=1e-6)  # the tail is a cosine
        assert abs(times.mean() - seconds / 2) < BEAT
    short = swim(seconds=0.3)
    times, shares = short.beat(4)
    np.testing.assert_allclose(times, [0, 0.075, 0.15, 0.225], atol=1e-9)
    np.testing.assert_allclose(shares, times / BEAT)
    times, _ = swim(lost=(4,)).beat(8)  # by the simulated tail, which lags behind by 4 x 0.3
    assert (times[0] / BEAT - 1.2 / (2 * np.pi)) % 1 == pytest.approx(0, abs=1e-6)


def test_nearest_samples():
    view = swim()
    np.testing.assert_array_equal(
        view.nearest(np.array([-1, 0, 0.008, 0.0085, 0.05, 2.0, 9.0])), [0, 0, 0, 1, 3, 120, 120]
    )


def test_long_names_are_cut_off():
    assert shortened("short", 16, 200) == "short"
    cut = shortened("a name that is much too long for its place", 16, 120)
    assert cut.startswith("a name")
    assert cut.endswith("...")
    assert text_size(cut, 16)[0] <= 120


def test_arrays_are_copied_and_frozen():
    view = swim()
    times = view.times.copy()
    other = replace(view, times=times)
    times[:] = 0
    assert other.times[1] > 0
    with pytest.raises(ValueError, match="read-only"):
        view.real[0] = 0


def test_what_does_not_fit_is_refused():
    view = swim()
    for changes, message in (
        ({"real": view.real[1:]}, "real has shape (120, 5, 2); for 121 times and 5 marker names it must have (121, 5"),
        ({"seen": view.seen[:, 1:]}, "seen has shape (121, 4); for 121 times and 5 marker names it must have (121, 5)"),
        ({"frequency": 0.0}, "view 'f2_00': frequency is 0.0 Hz; it must be finite and above 0"),
        ({"frequency": float("nan")}, "frequency is nan Hz"),
        ({"times": view.times[::-1]}, "view 'f2_00': times must be 2 or more finite numbers that rise"),
        ({"marker_names": ("M0",)}, "view 'f2_00': it has 1 marker names; at least 2 are needed"),
    ):  # fmt: skip
        with pytest.raises(ArgumentError, match=re.escape(message)):
            replace(view, **changes)
    limits = common_limits([view])
    for index, width, message in (
        (121, 640, "index is 121; view 'f2_00' has samples 0 to 120"),
        (-1, 640, "index is -1"),
        (0, 318, "width is 318 px; it must be even and at least 320"),
        (0, 641, "width is 641 px; it must be even and at least 320"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(message)):
            draw_frame(view, index, limits, width)
    with pytest.raises(ArgumentError, match="views is empty; limits need at least one view"):
        common_limits([])
    with pytest.raises(ArgumentError, match="count is 0; it must be 1 picture of the beat or more"):
        view.beat(0)
    message = "a box from (1, 0) to (0, 1) m holds nothing; left must be below right and bottom below top"
    with pytest.raises(ArgumentError, match=re.escape(message)):
        Limits(Box(1, 0, 0, 1), Box(0, 0, 1, 1))
