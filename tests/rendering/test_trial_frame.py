"""Frames of trials: blue and red are where the arrays say, nothing is drawn that isn't known, and clips show it."""

import itertools

import numpy as np
import pytest
from views import arm, like, near, pixels, swim

from markertrack.drawing import text_size
from markertrack.video import VideoReader
from swim2real.rendering.trial_frame import (
    COLORS,
    DIVERGED,
    GROUND,
    SIDES,
    Panel,
    TrialFrames,
    path_panel,
    plane_panel,
)  # fmt: skip
from swim2real.rendering.trial_view import Box, TrialView, common_limits
from swimbase.errors import ArgumentError, VideoError

INDEX = 45


def frames_of(view: TrialView, width: int = 480) -> TrialFrames:
    return TrialFrames(view, common_limits([view]), width)


def test_dots_rings_and_lines_are_where_they_should_be_and_y_is_up() -> None:
    view = arm()
    panel = Panel(common_limits([view]).plane, 624)
    image = pixels(plane_panel(view, INDEX, panel))
    assert image.shape == (panel.height, 624, 3)
    real, simulated = panel.places(view.real[INDEX]), panel.places(view.simulated[INDEX])
    for place in simulated:
        assert near(image, place, "simulated", 2.5) > 0.9
    for place in real[1:3]:
        angles = np.linspace(0, 2 * np.pi, 40)
        ring = np.round(place + 6.2 * panel.strength * np.stack([np.cos(angles), np.sin(angles)], axis=1)).astype(int)
        assert like(image, "real", 110)[ring[:, 1], ring[:, 0]].mean() > 0.8
    for line in view.lines:
        for a, b in itertools.pairwise(line):
            assert near(image, (simulated[a] + simulated[b]) / 2, "simulated", 0.8) > 0.5
    assert near(image, 0.4 * simulated[2] + 0.6 * simulated[3], "simulated", 4) == 0  # no line joins them
    panel = Panel(Box(-0.1, -0.2, 0.7, 0.2), 800)
    assert panel.height == 400
    np.testing.assert_allclose(panel.places(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])), [
        [99.5, 199.5], [199.5, 199.5], [99.5, 99.5],
    ])  # fmt: skip


@pytest.mark.parametrize(("made", "marker", "index"), [(arm, 2, INDEX), (swim, 3, 30)])
def test_lost_markers_and_lines_to_them_are_not_drawn(made, marker, index) -> None:
    whole, view = made(), made(lost=(marker,))
    panel = Panel(common_limits([whole]).plane, 624)
    with_it, without = (pixels(plane_panel(v, index, panel)) for v in (whole, view))
    places = panel.places(whole.real[index])
    between = (places[marker - 1] + places[marker]) / 2
    assert near(with_it, places[marker], "real", 8) > 0.2
    assert near(without, places[marker], "real", 8) == 0
    assert near(with_it, between, "real", 1.5) > 0.3
    assert near(without, between, "real", 3) == 0


@pytest.mark.parametrize(("made", "indices", "behind"), [(arm, (53, 60), (56, 2)), (swim, (1, 61), (51, 4))])
def test_a_marker_has_its_path_behind_it(made, indices, behind) -> None:
    view = made()
    panel = Panel(common_limits([view]).plane, 624)
    x, y = np.round(panel.places(view.simulated[behind])).astype(int)
    parts = [pixels(plane_panel(view, k, panel))[y - 2 : y + 3, x - 2 : x + 3] for k in indices]
    early, late = ((part[..., 2] - part[..., 0]).max() for part in parts)
    assert late > 40 > early


@pytest.mark.parametrize("made", [lambda: arm(travels=True), swim])
def test_both_paths_begin_at_the_same_start(made) -> None:
    view = made()
    panel = Panel(common_limits([view]).path, 624)
    image = pixels(path_panel(view, INDEX, panel))
    for side, path in (("real", view.path_real), ("simulated", view.path_simulated)):
        assert near(image, panel.places(path)[INDEX, 2], side, 9) > 0.1
        if made is swim and side == "real":
            continue  # both fronts are on one line, the simulated one farther
        x, y = np.round(panel.places(path[INDEX - 8, :2].mean(axis=0))).astype(int)  # the path of the front
        tint = image[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1))
        assert (tint - tint.mean()) @ (np.array(COLORS[side]) - np.mean(COLORS[side])) > 500


@pytest.mark.parametrize("made", [arm, swim])
def test_a_diverged_simulation_is_named_and_the_real_trial_is_there(made) -> None:
    view, good = made(diverged=True), made()
    assert (view.diverged, good.diverged) == (True, False)
    panel = Panel(common_limits([good]).plane, 624)
    image = pixels(plane_panel(view, INDEX, panel, 16))
    assert near(image, panel.places(view.real[INDEX, 2]), "real", 9) > 0.2
    if made is swim:
        x, y = np.round(panel.places(view.real[INDEX])[2] - (0, 3.5)).astype(int)
        assert np.abs(image[y, x] - GROUND).max() < 40  # a ring is hollow
    assert near(image, panel.places(good.simulated[INDEX, 2]), "simulated", 9) < 0.1
    assert np.count_nonzero(like(image, "simulated", 60).sum(axis=1) > 0.8 * text_size(DIVERGED, 12)[0]) > 10
    for nothing in (view, made(diverged=True, lost=(0, 1, 2, 3))):
        assert TrialFrames(nothing, common_limits([view, good]), 320).draw(0).shape[1] == 320


def test_a_frame_is_even_and_deterministic_and_changes_with_time() -> None:
    for view in (arm(), swim()):
        for width in (320, 642):
            frames = frames_of(view, width)
            frame = frames.draw(INDEX)
            assert (frame.dtype, frame.shape[1], frame.shape[0] % 2) == (np.uint8, width, 0)
            assert width / 2 < frame.shape[0] < 1.7 * width
            assert (frame != frames.draw(INDEX + 1)).any()
            np.testing.assert_array_equal(frame, frames_of(view, width).draw(INDEX))
    still, path = (frames_of(view, 320).draw(0).shape[0] for view in (arm(), arm(travels=True)))
    assert path > 1.2 * still
    heads = [frames_of(arm(), 640).draw(index)[:36].astype(int) for index in (0, 1)]
    changed = np.abs(heads[0] - heads[1]).max(axis=(0, 2)) > 60
    assert np.flatnonzero(changed)[0] > 400  # only the moment at the right
    rows = np.flatnonzero(np.abs(heads[0] - heads[0][0, 0]).max(axis=(1, 2)) > 100)
    assert rows[-1] - rows[0] + 1 >= 12  # px: the time can be read


@pytest.mark.parametrize("made", [arm, swim])
def test_a_clip_shows_the_nearest_samples_in_clear_colors(made, tmp_path) -> None:
    view = made(seconds=1.0)
    frames = frames_of(view, 320)
    frames.write_clip(tmp_path / "clip.mp4", 5)
    with VideoReader(tmp_path / "clip.mp4") as reader:
        images = [frame.image.astype(int) for frame in reader]
    drawn = [frames.draw((view.times.size - 1) // 5 * k) for k in range(6)]
    assert len(images) == 6
    for k, image in enumerate(images):
        errors = [np.abs(image - other).mean() for other in drawn]
        assert int(np.argmin(errors)) == k
        assert errors[k] < 3
    for side in SIDES:
        assert np.count_nonzero(like(images[1], side, 70)) > 30
    assert [path.name for path in tmp_path.iterdir()] == ["clip.mp4"]


@pytest.mark.parametrize(
    ("call", "words"),
    [(lambda view, path: frames_of(view, 641), "width is 641 px"), (lambda view, path: frames_of(view, 318), "318 px"),
     (lambda view, path: frames_of(view).draw(7), "index is 7; view 'a' has samples 0 to 6"),
     (lambda view, path: frames_of(view).write_clip(path / "no.mp4", 0), "fps is 0"),
     (lambda view, path: frames_of(view).write_clip(path / "no.gif", 10), "its ending")],
)  # fmt: skip
def test_what_is_not_allowed_is_refused_and_leaves_nothing(tmp_path, call, words) -> None:
    with pytest.raises((ArgumentError, VideoError), match=words):
        call(arm(seconds=0.2), tmp_path)
    assert list(tmp_path.iterdir()) == []
