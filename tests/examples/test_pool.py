"""The synthetic pool camera: that what it says is true of its pictures."""

import re
from dataclasses import replace

import numpy as np
import pytest
from pool import Glare, Occluder, PoolCamera, film, scene

from markertrack.track import MarkerTrack
from markertrack.video import VideoReader
from swimbase.errors import ArgumentError

HEIGHTS = np.array([0.05, 0.1, 0.0])
CAMERA = PoolCamera(width=640, height=360, view=1.4, fps=30.0, marker_radius=0.02, noise=0.0, caustics=0.0)


def swim(speed: float = 0.2, beat: float = 1.0, amplitude: float = 0.06, seconds: float = 1.0) -> MarkerTrack:
    """Three markers 0.15 m apart that go to the left; the last one beats most."""
    times = np.arange(round(200 * seconds) + 1) / 200
    along = 0.15 * np.arange(3) - speed * times[:, None]
    across = amplitude * np.array([0.1, 0.3, 1.0]) * np.sin(2 * np.pi * beat * times[:, None] - np.arange(3))
    return MarkerTrack(times + 7.0, np.stack([along, across], axis=-1))


def still(*points: tuple[float, float]) -> MarkerTrack:
    return MarkerTrack([0.0, 0.1], [points, points])


def coverage(track, camera, *indices, occluder=None, heights=HEIGHTS) -> list[np.ndarray]:
    """How much of each pixel is marker, for some frames: shown markers less invisible ones. Shapes (height, width)."""
    shown, bare = (scene(track, heights, replace(camera, contrast=c), 0, occluder=occluder) for c in (1.0, 0.0))
    total = np.subtract(camera.marker_color, camera.body_color).sum()
    return [(shown.frame(k).astype(float) - bare.frame(k)).sum(axis=2) / total for k in indices]


def around(cover: np.ndarray, point: np.ndarray, reach: int = 17) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y = np.round(point).astype(int)
    rows, columns = np.mgrid[y - reach : y + reach + 1, x - reach : x + reach + 1]
    inside = (rows >= 0) & (rows < cover.shape[0]) & (columns >= 0) & (columns < cover.shape[1])
    return columns[inside], rows[inside], cover[rows[inside], columns[inside]]


def centroid(cover: np.ndarray, point: np.ndarray) -> np.ndarray:
    x, y, weight = around(cover, point)
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()


@pytest.mark.parametrize("camera", [CAMERA, replace(CAMERA, tilt=(0.05, -0.08), shutter=0.0)])
def test_markers_are_drawn_where_the_truth_says(camera):
    track = swim()
    truth = scene(track, HEIGHTS, camera, 0).filmed.truth
    for index, cover in zip((0, 11), coverage(track, camera, 0, 11), strict=True):
        for point in truth.positions[index]:
            np.testing.assert_allclose(centroid(cover, point), point, atol=0.02)


def test_truth_is_the_projected_swim():
    track, center = swim(), (0.1, 0.02)
    filmed = scene(track, HEIGHTS, replace(CAMERA, center=center), 0).filmed
    np.testing.assert_allclose(filmed.truth.times, np.arange(31) / 30)
    position = np.stack([np.interp(filmed.truth.times + 7, track.times, track.positions[:, 1, i]) for i in (0, 1)], 1)
    factor = 2.5 / (2.5 - 0.1)  # of a marker 0.1 m above the plane, seen from 2.5 m
    pixels = [319.5, 179.5] + (position - center) * [1, -1] * factor / filmed.meters_per_pixel
    np.testing.assert_allclose(filmed.truth.positions[:, 1], pixels, atol=0.05)
    assert filmed.meters_per_pixel == pytest.approx(1.4 / 640)
    assert not filmed.hidden.any()


def test_a_higher_marker_appears_farther_out_and_larger():
    camera = replace(CAMERA, center=(0.0, 0.0))
    track = still((0.2, 0.1), (-0.2, -0.1))
    pixels = {}
    for height in (0.0, 0.25):
        heights = [height, height]
        truth = scene(track, heights, camera, 0).filmed.truth.positions[0]
        (cover,) = coverage(track, camera, 0, heights=heights)
        np.testing.assert_allclose(centroid(cover, truth[0]), truth[0], atol=0.02)
        pixels[height] = truth - camera.middle, cover.sum()
    np.testing.assert_allclose(pixels[0.25][0], pixels[0.0][0] / 0.9)
    assert pixels[0.25][1] == pytest.approx(pixels[0.0][1] / 0.9**2, rel=0.01)
    assert pixels[0.0][0][0, 1] < 0  # up in the world is up in the image


def test_motion_blur_draws_a_marker_out_over_the_way_of_one_exposure():
    track = swim(speed=0.5, amplitude=0.0)
    camera = replace(CAMERA, shutter=1.0)
    setting = scene(track, HEIGHTS, camera, 0)
    x, y, weight = around(coverage(track, camera, 15)[0], setting.filmed.truth.positions[15, 2])
    weight = weight / weight.sum()
    spread = [(weight * (axis - (weight * axis).sum()) ** 2).sum() for axis in (x, y)]
    way = 0.5 / 30 / setting.filmed.meters_per_pixel
    assert spread[0] - spread[1] == pytest.approx(way**2 / 12, rel=0.05)  # variance of a uniform distribution


def test_glare_over_markers_hides_them_for_its_time_only():
    camera = replace(CAMERA, glares=(Glare(10 / 30, 17 / 30, over=(1,)),), noise=2.0)
    setting = scene(swim(), HEIGHTS, camera, 0)
    expected = np.zeros((31, 3), dtype=bool)
    expected[10:17, 1] = True
    np.testing.assert_array_equal(setting.filmed.hidden, expected)
    assert np.isfinite(setting.filmed.truth.positions).all()
    column, row = np.round(setting.filmed.truth.positions[12, 1]).astype(int)
    assert setting.frame(12)[row, column].min() > 245
    assert setting.frame(9)[row, column].min() < 100


def test_hidden_means_that_less_than_half_of_a_marker_is_seen():
    glare = Glare(center=(-0.35, 0.0), velocity=(0.7, 0.05), radius=0.05, stretch=1.5)
    camera = replace(CAMERA, glares=(glare,), center=(0.35, 0.0), view=0.9)
    rod = Occluder(((0.12, -0.5), (0.16, 0.5)), width=0.04, height=0.2)
    track = swim(speed=0.4)
    filmed = scene(track, HEIGHTS, camera, 0).filmed
    assert np.isnan(filmed.truth.positions[-1, 0]).all()
    assert np.all(filmed.truth.confidence[-1] == [0, 0, 1])
    hidden = scene(track, HEIGHTS, camera, 0, occluder=rod).filmed.hidden
    _, scales = camera.project(np.zeros((3, 2)), HEIGHTS, (0.35, 0.0))
    pixels, _ = camera.project(track.positions[::20], HEIGHTS, (0.35, 0.0))
    compared = 0
    covers = coverage(track, camera, *range(0, 31, 6), occluder=rod)
    for index, (points, cover) in enumerate(zip(pixels[::2], covers, strict=True)):
        for marker, point in enumerate(points):
            share = around(cover, point)[2].sum() / (np.pi * (0.02 * scales[marker]) ** 2)
            if abs(share - 0.5) > 0.08:
                assert hidden[6 * index, marker] == (share < 0.5), (index, marker, share)
                compared += 1
    assert compared > 12
    assert 0.2 < hidden.mean() < 0.8


def test_a_marker_may_leave_the_image_and_come_back():
    camera = replace(CAMERA, center=(0.15, -0.17), view=0.6)
    filmed = scene(swim(speed=0.0, amplitude=0.2, seconds=2.0), HEIGHTS, camera, 0).filmed
    gone = np.isnan(filmed.truth.positions[:, 2]).all(axis=1)
    assert not gone[0]
    assert np.diff(gone.astype(int)).tolist().count(-1) == 2  # two beats, so it comes back twice
    assert filmed.hidden[gone, 2].all()


def test_a_swim_that_does_not_fit_says_which_view_it_needs():
    camera = replace(CAMERA, view=0.5)
    with pytest.raises(
        ArgumentError, match=r"the swim needs a view of (\d\.\d\d) m and the camera has 0.5 m; set"
    ) as e:
        scene(swim(), HEIGHTS, camera, 0)
    needed = float(str(e.value).split(" m and")[0].split()[-1])
    scene(swim(), HEIGHTS, replace(CAMERA, view=needed), 0)
    with pytest.raises(ArgumentError, match="needs a view"):
        scene(swim(), HEIGHTS, replace(CAMERA, view=needed - 0.02), 0)


def test_a_seed_is_a_film():
    camera = replace(CAMERA, width=320, height=180, noise=2.0, caustics=0.5, glints=5.0, jitter=0.2, dropped=0.2)
    track = swim(seconds=0.3)
    first, other = list(scene(track, HEIGHTS, camera, 0)), next(iter(scene(track, HEIGHTS, camera, 1)))
    again = scene(track, HEIGHTS, camera, 0)
    assert [time for time, _ in first] == again.filmed.truth.times.tolist()
    for index in (5, 0, 2):  # in any order
        np.testing.assert_array_equal(again.frame(index), first[index][1])
    assert not np.array_equal(first[0][1], other[1])
    assert first[0][1].shape == (180, 320, 3)
    assert first[0][1].dtype == np.uint8


def test_dropped_and_late_frames_have_their_true_times():
    track = swim(seconds=4.0)
    steady = scene(track, HEIGHTS, CAMERA, 3).filmed.truth
    dropped = scene(track, HEIGHTS, replace(CAMERA, dropped=0.3), 3).filmed.truth
    kept = np.round(dropped.times * 30).astype(int)
    np.testing.assert_allclose(dropped.times, kept / 30)
    assert dropped.times[0] == 0
    assert 0.6 < kept.size / steady.frame_count < 0.8
    np.testing.assert_allclose(dropped.positions, steady.positions[kept])
    late = scene(track, HEIGHTS, replace(CAMERA, jitter=0.4), 3).filmed.truth
    off = (late.times - steady.times) * 30
    assert off[0] == 0
    assert np.abs(off).max() <= 0.2
    assert off.std() == pytest.approx(0.4 / np.sqrt(12), rel=0.15)
    moved = [np.interp(late.times, steady.times, steady.positions[:, 0, 0])]
    np.testing.assert_allclose(late.positions[:, 0, 0], moved[0], atol=0.1)


@pytest.mark.parametrize(("change", "message"), [
    ({"width": 641}, "camera width is 641 px; it must be an even number from 16 on"),
    ({"fps": 0.0}, "camera fps is 0.0 Hz; it must be above 0"),
    ({"view": np.nan}, "camera view is nan m; it must be above 0"),
    ({"shutter": 1.2}, "camera shutter is 1.2; it must lie within 0 and 1"),
    ({"dropped": 1.0}, "camera dropped is 1.0; it must lie within 0 and 0.9"),
    ({"tilt": (0.0, 0.6)}, "camera tilt is (0.0, 0.6) rad; each angle must lie within -0.5 and 0.5"),
    ({"center": (0.0, np.inf)}, "camera center is (0.0, inf); it must be two finite numbers (x, y) in m"),
    ({"body_color": (0, 0, 256)}, "camera body_color is (0, 0, 256); it must be three numbers"),
])  # fmt: skip
def test_a_camera_that_cannot_be(change, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        replace(CAMERA, **change)


GAP = MarkerTrack([0, 1], [[[0, 0]], [[np.nan, 0]]])


@pytest.mark.parametrize(("track", "heights", "camera", "options", "message"), [
    (swim(), [0.0, 0.0], {}, {}, "heights have shape (2,); give 3 finite numbers in m"),
    (swim(), [0.0, 0.0, 3.0], {}, {}, "a marker is 3 m high and the camera 2.5 m; raise camera_height"),
    (GAP, [0.0], {}, {}, "only a swim without gaps can be filmed"),
    (swim(), HEIGHTS, {}, {"body_half_width": -1}, "body_half_width is -1 m; it must be 0, for no body, or more"),
    (swim(), HEIGHTS, {"glares": (Glare(over=(3,)),)}, {}, "a glare lies over markers (3,); there are markers 0"),
    (swim(), HEIGHTS, {}, {"links": [(0, 3)]}, "a link joins markers (0, 3); there are markers 0 to 2"),
    (swim(seconds=0.02), HEIGHTS, {}, {}, "leaves 1 frame at 30 frames per second; at least 2 are needed"),
    (swim(), HEIGHTS, {}, {"occluder": Occluder(((0, 0), (1, 1)), height=3)}, "the occluder is 3 m high"),
])  # fmt: skip
def test_things_that_cannot_be_filmed(track, heights, camera, options, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        scene(track, heights, replace(CAMERA, **camera), 0, **options)


def test_links_are_bars_between_their_markers():
    camera = replace(CAMERA, contrast=0.0, noise=0.0, caustics=0.0)
    shown, bare = (
        scene(swim(), HEIGHTS, camera, 0, body_half_width=0.01, links=links).frame(0).astype(float)
        for links in ([(0, 2)], [])
    )
    truth = scene(swim(), HEIGHTS, camera, 0).filmed.truth.positions[0]
    rows, columns = np.nonzero(np.abs(shown - bare).sum(axis=2) > 30)
    across = (truth[2] - truth[0])[::-1] * [-1, 1] / np.linalg.norm(truth[2] - truth[0])
    off = (np.stack([columns, rows], axis=1) - truth[0]) @ across
    assert np.abs(off).max() * camera.meters_per_pixel == pytest.approx(0.01, abs=camera.meters_per_pixel)
    assert np.ptp(columns) == pytest.approx(abs(truth[2, 0] - truth[0, 0]), rel=0.15)


@pytest.mark.parametrize(("rotation", "dropped"), [pytest.param(0, 0.0, marks=pytest.mark.slow), (90, 0.3)])
def test_a_film_is_read_back_as_it_was_filmed(tmp_path, rotation, dropped):
    camera = replace(CAMERA, dropped=dropped, noise=1.0)
    shown = scene(swim(seconds=0.3), HEIGHTS, camera, 0)
    filmed = film(shown, tmp_path / "swim.mp4", rotation=rotation)
    assert (filmed.truth.frame_count < 10) == (dropped > 0)
    with VideoReader(tmp_path / "swim.mp4") as video:
        assert (video.info.width, video.info.height, video.info.rotation) == (640, 360, rotation)
        read = list(video)
    np.testing.assert_allclose([frame.time for frame in read], filmed.truth.times, atol=1e-4)
    for frame in read[::5]:
        assert np.abs(frame.image.astype(float) - shown.frame(frame.index)).mean() < 3
