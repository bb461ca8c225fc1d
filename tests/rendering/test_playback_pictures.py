"""Recordings as they are drawn: that blue and red are where the arrays say, and what is written and charted."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swim2real.errors import ArgumentError
from swim2real.rendering.clip import write_clip
from swim2real.rendering.drawing import INK
from swim2real.rendering.error_chart import ErrorChart
from swim2real.rendering.panel import COLORS, Panel
from swim2real.rendering.playback_frame import PlaybackFrames
from swim2real.rendering.playback_panel import plane_panel, strength_of, way_panel
from swim2real.rendering.playback_sheet import moments_sheet, trials_overview
from swim2real.rendering.playback_view import (
    PlaybackView,
    grid_step,
    length_text,
    playback_limits,
    rounded_up,
)
from swim2real.rendering.sheet import TEXT
from swim2real.rendering.view import Box
from swim2real.video import VideoReader

NAMES = ("base", "elbow", "hand", "lamp")
LINKS = ((0, 1), (1, 2), (0, 3))
RATE = 0.45  # Hz
INDEX = 45


def arm(times: np.ndarray, swing: float) -> np.ndarray:
    """An arm that swings about its base, and a lamp above it that doesn't. Shape (T, 4, 2)."""
    angles = -np.pi / 2 + swing * np.sin(2 * np.pi * RATE * times)
    hand = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    base = np.zeros_like(hand)
    lamp = base + np.array([0.1, 0.15])
    return np.stack([base, 0.2 * hand, 0.4 * hand, lamp], axis=1) + np.array([1.0, 0.5])


def recording(
    name: str = "a",
    seconds: float = 3.0,
    start: float = 2.0,
    lost: tuple[int, ...] = (),
    diverged: bool = False,
    travels: bool = False,
) -> PlaybackView:
    times = start + np.arange(round(30 * seconds) + 1) / 30
    real, simulated = arm(times, 0.5), arm(times, 0.9)
    seen = np.ones(real.shape[:2], bool)
    seen[:, list(lost)] = False
    if diverged:
        simulated = np.full_like(simulated, np.nan)
    errors = np.linalg.norm(simulated - real, axis=2).mean(axis=1)
    shift = np.stack([0.1 * (times - times[0]), 0 * times], axis=-1)[:, None]
    ways = (real - shift, simulated - 2 * shift) if travels else (None, None)
    return PlaybackView(
        name, times, seen, real, simulated, NAMES, float(errors.mean()), errors, LINKS, "x right, z up", *ways
    )


def pixels(image) -> np.ndarray:
    return np.asarray(image).astype(int)


def near(image: np.ndarray, place, side: str, radius: float) -> float:
    """The share of a disc that has a side's color."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    like = np.abs(image - np.array(COLORS[side])).max(axis=-1) < 90
    return float(like[np.hypot(x - place[0], y - place[1]) <= radius].mean())


def panel_of(view: PlaybackView, width: int = 624) -> Panel:
    box = playback_limits([view]).plane
    return Panel(box, width, grid_step(box))


# panels


def test_dots_rings_and_links_are_where_they_should_be():
    view = recording()
    panel = panel_of(view)
    image = pixels(plane_panel(view, INDEX, panel))
    assert image.shape == (panel.height, 624, 3)
    real, simulated = panel.places(view.real[INDEX]), panel.places(view.simulated[INDEX])
    for place in simulated:
        assert near(image, place, "simulated", 3) > 0.9
    for place in real[1:3]:
        angles = np.linspace(0, 2 * np.pi, 40)
        ring = np.round(place + 6.2 * strength_of(panel) * np.stack([np.cos(angles), np.sin(angles)], axis=1)).astype(
            int
        )
        red = np.abs(image - np.array(COLORS["real"])).max(axis=-1) < 110
        assert red[ring[:, 1], ring[:, 0]].mean() > 0.8
    for a, b in LINKS:
        assert near(image, (simulated[a] + simulated[b]) / 2, "simulated", 0.8) > 0.5
    unlinked = 0.4 * simulated[2] + 0.6 * simulated[3]
    assert near(image, unlinked, "simulated", 4) == 0


def test_lost_markers_and_links_to_them_are_not_drawn():
    whole, view = recording(), recording(lost=(2,))
    panel = panel_of(whole)
    with_it, without = (pixels(plane_panel(v, INDEX, panel)) for v in (whole, view))
    places = panel.places(whole.real[INDEX])
    between = (places[1] + places[2]) / 2
    assert near(with_it, places[2], "real", 9) > 0.2
    assert near(without, places[2], "real", 9) == 0
    assert near(with_it, between, "real", 1.5) > 0.3
    assert near(without, between, "real", 3) == 0
    assert np.isnan(view.real[:, 2]).all()


def test_a_marker_has_its_way_behind_it():
    view = recording()
    assert view.trail(60) == slice(53, 61)  # 8 % of 3 s
    panel = panel_of(view)
    early, late = (pixels(plane_panel(view, index, panel)) for index in (53, 60))
    x, y = np.round(panel.places(view.simulated[56, 2])).astype(int)
    part = [image[y - 2 : y + 3, x - 2 : x + 3] for image in (early, late)]
    blueness = [(one[..., 2] - one[..., 0]).max() for one in part]
    assert blueness[1] > 40 > blueness[0]


def test_links_that_follow_one_another_are_one_line():
    assert recording().lines == [[0, 1, 2], [0, 3]]
    assert replace(recording(), links=()).lines == []


def test_a_robot_that_travels_is_seen_from_its_first_pose():
    view = recording(travels=True)
    limits = playback_limits([view, recording()])
    panel = Panel(limits.course, 624, grid_step(limits.course))
    image = pixels(way_panel(view, INDEX, panel))
    for side, course in (("real", view.course_real), ("simulated", view.course_simulated)):
        places = panel.places(course)
        assert near(image, places[INDEX, 2], side, 9) > 0.2
        x, y = np.round(places[INDEX - 8, 0]).astype(int)  # the way of the first marker
        tint = image[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1))
        assert (tint - tint.mean()) @ (np.array(COLORS[side]) - np.mean(COLORS[side])) > 500


def test_a_diverged_playback_is_named_and_the_recording_is_there():
    view, good = recording(diverged=True), recording()
    panel = panel_of(good)
    image = pixels(plane_panel(view, INDEX, panel, 16))
    assert near(image, panel.places(view.real[INDEX, 2]), "real", 9) > 0.2
    assert near(image, panel.places(good.simulated[INDEX, 2]), "simulated", 9) == 0
    plate = np.abs(image - np.array(COLORS["simulated"])).max(axis=-1) < 60
    assert np.count_nonzero(plate.sum(axis=1) > 80) > 15
    assert PlaybackFrames(view, playback_limits([view, good]), 480).draw(0).shape[1] == 480


# frames


def test_a_frame_is_even_and_deterministic_and_changes_with_time():
    for view in (recording(), recording(travels=True)):
        limits = playback_limits([view])
        for width in (320, 640, 1282):
            frames = PlaybackFrames(view, limits, width)
            frame = frames.draw(INDEX)
            assert frame.dtype == np.uint8
            assert frame.shape[1] == width
            assert frame.shape[0] % 2 == 0
            assert (frame != frames.draw(INDEX + 1)).any()
            np.testing.assert_array_equal(frame, PlaybackFrames(view, limits, width).draw(INDEX))
    plain, way = (
        PlaybackFrames(v, playback_limits([v]), 640).draw(0).shape[0] for v in (recording(), recording(travels=True))
    )
    assert way > 1.2 * plain


def test_time_is_burned_in():
    view = recording()
    frames = PlaybackFrames(view, playback_limits([view]), 640)
    heads = [frames.draw(index)[:36].astype(int) for index in (0, 1)]
    changed = np.abs(heads[0] - heads[1]).max(axis=(0, 2)) > 60
    assert changed.any()
    assert np.flatnonzero(changed)[0] > 400  # only the moment at the right


def test_a_chart_follows_the_error():
    view = recording()
    top = rounded_up(float(view.errors.max()))
    chart = ErrorChart(view, top, 400, 14)
    image = pixels(chart.at(INDEX))
    dark = np.abs(image - INK).max(axis=-1) < 60
    head, bottom = round(1.4 * 14), image.shape[0] - round(1.3 * 0.8 * 14)
    for index in range(5, 90, 5):
        if abs(index - INDEX) < 3:
            continue
        column = round((index / 90) * 399)
        rows = head + np.flatnonzero(dark[head:bottom, column])
        expected = head + (bottom - 1 - head) * (1 - view.errors[index] / top)
        assert np.abs(rows - expected).min() < 2.5
    before, after = (np.abs(pixels(chart.at(index)) - pixels(chart.at(0))).max(axis=-1) > 40 for index in (30, 60))
    for changed, share in ((before, 30 / 90), (after, 60 / 90)):
        assert changed[head + 3 : bottom - 3, round(share * 399)].any()


def test_a_chart_of_nothing_says_so():
    view = recording(diverged=True)
    assert np.isnan(view.error)
    good, bad = (ErrorChart(v, 0.1, 400, 14).at(0) for v in (recording(), view))
    assert good.size == bad.size
    assert (pixels(good) != pixels(bad)).any()


# sheets and films


def found(sheet: np.ndarray, tile: np.ndarray) -> list[tuple[int, int]]:
    """Where a tile stands in a sheet: rows and columns of its top left pixel."""
    height, width = tile.shape[:2]
    y, x = np.unravel_index(np.argmin(tile.sum(axis=-1)), (height, width))  # its darkest pixel
    starts = np.argwhere((sheet == tile[y, x]).all(axis=-1)) - (y, x)
    starts = starts[(starts >= 0).all(axis=1)].tolist()
    return [(r, c) for r, c in starts if np.array_equal(sheet[r : r + height, c : c + width], tile)]


@pytest.mark.parametrize("travels", [False, True])
def test_a_sheet_shows_the_trial_from_start_to_end(travels):
    view = recording(travels=travels)
    sheet = moments_sheet(view, 4, 2, 240)
    panel = panel_of(view, 240)
    assert view.moments(4).tolist() == [0, 30, 60, 90]
    places = [found(sheet, np.asarray(plane_panel(view, k, panel, TEXT))) for k in view.moments(4).tolist()]
    assert all(len(place) == 1 for place in places)
    rows, columns = zip(*(place[0] for place in places), strict=True)
    assert rows[0] == rows[1] < rows[2] == rows[3]
    assert columns[0] == columns[2] < columns[1] == columns[3]
    np.testing.assert_array_equal(sheet, moments_sheet(recording(travels=travels), 4, 2, 240))


def test_all_trials_are_rows_of_one_sheet():
    views = [recording(), recording("b", 1.0, 2.3), recording("a trial with a name far too long", 2.0, 2.7)]
    limits = playback_limits(views)
    sheet = trials_overview(views, 3, 160)
    panel = Panel(limits.plane, 160, grid_step(limits.plane))
    tops = []
    for view in views:
        row = [found(sheet, np.asarray(plane_panel(view, k, panel, TEXT))[24:]) for k in view.moments(3).tolist()]
        assert all(len(place) == 1 for place in row)
        tops.append(row[0][0][0])
        assert len({place[0][0] for place in row}) == 1
    assert tops == sorted(tops)


def test_a_film_shows_the_nearest_samples(tmp_path):
    view = recording(seconds=1.0)
    frames = PlaybackFrames(view, playback_limits([view]), 480)
    write_clip(view, frames.draw, tmp_path / "clip.mp4", 10)
    with VideoReader(tmp_path / "clip.mp4") as reader:
        images = [frame.image.astype(int) for frame in reader]
    assert len(images) == 11
    for k in (0, 4, 10):
        errors = [np.abs(images[k] - frames.draw(index)).mean() for index in range(0, 31, 3)]
        assert int(np.argmin(errors)) == k


# views and limits


def test_limits_hold_everything_and_are_common():
    views = [recording(travels=True), recording("b", 1.0, travels=True)]
    limits = playback_limits(views)
    for view in views:
        for box, arrays in (
            (limits.plane, (view.real, view.simulated)),
            (limits.course, (view.course_real, view.course_simulated)),
        ):
            places = np.concatenate([array.reshape(-1, 2) for array in arrays])
            assert (places > [box.left, box.bottom]).all()
            assert (places < [box.right, box.top]).all()
        assert limits.error >= view.errors.max()
    assert playback_limits(views[::-1]) == limits
    assert playback_limits([recording()]).course is None
    nothing = recording(diverged=True, lost=(0, 1, 2, 3))
    assert playback_limits([nothing]).plane.right > 0
    assert PlaybackFrames(nothing, playback_limits([nothing]), 320).draw(0).shape[1] == 320


@given(st.floats(1e-6, 1e6))
def test_steps_are_round_and_not_much_longer(length):
    step = rounded_up(length)
    assert length <= step * (1 + 1e-6)
    assert step <= 2.5 * length * (1 + 1e-6)
    assert f"{step:.0e}"[0] in "125"


def test_lengths_are_told_in_the_unit_that_fits():
    assert [length_text(length) for length in (2.0, 0.1, 0.05, 0.0005)] == ["2 m", "0.1 m", "50 mm", "0.5 mm"]
    assert grid_step(Box(0, 0, 1.2, 0.5)) == pytest.approx(0.1)


def test_the_pace_is_that_of_the_motion():
    assert recording(seconds=20.0).pace == pytest.approx(RATE, abs=0.05)
    still = recording()
    noise = np.random.default_rng(0).normal(0, 1e-3, still.real.shape)
    assert replace(still, real=still.real[:1] + noise).pace == 0
    assert recording(lost=(0, 1, 2, 3)).pace == 0


def test_what_does_not_fit_is_refused():
    view = recording()
    limits = playback_limits([view])
    for call, message in (
        (
            lambda: replace(view, errors=view.errors[1:]),
            "view 'a': errors has shape (90,); for 91 times it must have (91,)",
        ),
        (lambda: replace(view, course_real=view.real[1:]), "view 'a': course_real has shape (90, 4, 2)"),
        (lambda: replace(view, times=view.times[::-1]), "view 'a': times must be 2 or more finite numbers that rise"),
        (lambda: view.moments(1), "count is 1; it must be 2 moments of the trial or more"),
        (lambda: PlaybackFrames(view, limits, 641), "width is 641 px; it must be even and at least 320"),
        (lambda: PlaybackFrames(view, limits, 640).draw(91), "index is 91; view 'a' has samples 0 to 90"),
        (lambda: moments_sheet(view, 4, 2, 159), "width is 159 px; a picture of a sheet must be at least 160 px wide"),
        (lambda: trials_overview([], 4, 160), "views is empty; limits need at least one view"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(message)):
            call()
