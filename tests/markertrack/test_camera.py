import json
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markertrack.camera import (
    Camera,
    Scale,
    camera_for,
    fit_plane,
    fixed_camera,
    project,
)  # fmt: skip
from markertrack.camera_file import CameraFile, Length, Lens, find_board, read_camera, write_camera
from markertrack.layout import Layout
from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.robots.fish import FISH
from swimbase.errors import ArgumentError, TrackingError
from swimmers import Swimmer

SIZE = (3840, 2160)
LEVEL = np.full(9, 0.05)
ABOVE = FISH.marker_heights - FISH.marker_heights[0]

LENS = Lens(np.array([[2400.0, 0, 1930.0], [0, 2400.0, 1070.0], [0, 0, 1]]), np.array([-0.12, 0.03, 1e-3, -5e-4, 0.0]))


@dataclass(frozen=True)
class Eye:
    """A pinhole camera over the water: where world points (x, y, height) lie in its picture."""

    height: float = 2.0
    tilt: tuple[float, float] = (0.0, 0.0)  # rad, about x and y
    focal: float = 2000.0
    center: tuple[float, float] = (1919.5, 1079.5)

    def pixels(self, points, heights=0.0):
        depth = np.broadcast_to(self.height - np.asarray(heights, dtype=float), points.shape[:-1])
        # x to the right, y down, z away from the camera
        seen = np.stack([points[..., 0], -points[..., 1], depth], axis=-1) @ self._turn().T
        return self.focal * seen[..., :2] / seen[..., 2:] + np.array(self.center)

    def _turn(self):
        (ca, sa), (cb, sb) = ((np.cos(t), np.sin(t)) for t in self.tilt)
        return np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]) @ np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])

    @property
    def below(self):
        return self.pixels(np.zeros(2))

    def track(self, track, heights=ABOVE):
        return MarkerTrack(track.times, self.pixels(track.positions, heights), track.confidence)


def swim(**options):
    """A swim right under the camera, without noise, markers where the robot has them."""
    track = Swimmer(**{"heading": 0.0, "speed": 0.2, "duration": 3.0, **options}).track(noise=0, by_hand=False)
    # the swimmer's rigid markers bend a little as its whole body is a wave: put them where they are rigid
    positions = track.positions.copy()
    axes = positions[:, 1] - positions[:, 0]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for m in (1, 2):
        positions[:, m] = positions[:, 0] + FISH.rest_markers[m, 0] * axes
    return MarkerTrack(track.times, positions)


def see(track, known=None, size=SIZE, heights=FISH.marker_heights) -> Camera:
    return camera_for(track, replace(FISH.layout, heights=np.asarray(heights)), known, size)


def square(points, eye, meters=None):
    """Points of a plane, as a camera file has them."""
    return eye.pixels(points), points if meters is None else meters


POOL = np.array([[-0.8, -0.4], [0.9, -0.5], [0.7, 0.5], [-0.9, 0.45], [0.1, 0.0]])


def shape_misfit(found, true):
    """Largest distance after the best shift: the picture's origin is nowhere in the pool."""
    shift = np.nanmean(found.positions - true.positions, axis=(0, 1))
    return np.nanmax(np.linalg.norm(found.positions - true.positions - shift, axis=2))


@settings(max_examples=15, deadline=None)
@given(st.floats(0.5, 5), st.floats(500, 4000), st.floats(-3, 3))
def test_a_level_robot_under_a_straight_camera_is_recovered(height, focal, heading):
    true, eye = swim(heading=heading, duration=1.0), Eye(height, focal=focal)
    camera = see(eye.track(true, 0.0), heights=LEVEL)
    assert camera.scale.meters_per_pixel == pytest.approx(height / focal)
    assert dict(camera.scale.estimates) == pytest.approx(dict.fromkeys(("M0–M1", "M0–M2", "M1–M2"), height / focal))
    assert camera.findings() == []
    assert shape_misfit(camera.to_meters(eye.track(true, 0.0)), true) < 1e-9


def test_the_scale_is_the_head_s_as_in_the_published_tables(tracks):
    for trial in tracks:
        pixels = MarkerTrack(trial.track.times, trial.track.positions / trial.meters_per_pixel * [1, -1])
        camera = see(pixels)
        assert camera.scale.meters_per_pixel == pytest.approx(trial.meters_per_pixel, rel=1e-12)
        np.testing.assert_allclose(camera.to_meters(pixels).positions, trial.track.positions, atol=1e-12)
        assert camera.scale.findings(), trial.name  # all of them are doubtful


def test_wild_frames_and_lost_samples_dont_move_the_scale_and_stay_unseen():
    track = Eye().track(swim(), 0.0)
    positions, confidence = track.positions.copy(), np.full((track.frame_count, 9), 0.7)
    positions[:9, 0] += 900
    positions[20:130, 1] = 5.0
    confidence[20:130, 1] = 0
    positions[3, 4], confidence[3, 4] = np.nan, 0
    pixels = MarkerTrack(track.times, positions, confidence)
    camera = see(pixels, heights=LEVEL)
    assert camera.scale.meters_per_pixel == pytest.approx(1e-3)
    found = camera.to_meters(pixels)
    assert np.argwhere(np.isnan(found.positions[:20]).any(axis=2)).tolist() == [[3, 4]]
    np.testing.assert_array_equal(found.confidence, confidence)


def test_lengths_that_disagree_are_told_with_each_one_s_estimate():
    positions = Eye().track(swim(), 0.0).positions.copy()
    positions[:, 2] = positions[:, 0] + 1.04 * (positions[:, 2] - positions[:, 0])
    (finding,) = see(MarkerTrack(swim().times, positions), heights=LEVEL).findings()
    assert finding.startswith("the scale is doubtful: known lengths disagree by 6.5 % (1 % is 6 mm at the last marker)")
    assert "M0–M1 1.0000, M0–M2 0.9615, M1–M2 0.9377; used is 0.9615" in finding
    many = Scale(1.1e-3, 0.25, tuple((f"length{i}", 1e-3 * (1 + 0.01 * i)) for i in range(28))).findings()[0]
    assert all(f"length{i} " in many for i in (0, 4, 23, 27))
    assert "18 between" in many
    assert Scale(1e-3, 0.02, ()).findings() == []


@settings(max_examples=25, deadline=None)
@given(st.floats(0.4, 6), st.floats(-3, 3), st.floats(0, 0.5))
def test_high_markers_are_put_where_they_are_when_the_camera_s_height_is_known(height, heading, speed):
    true, eye = swim(heading=heading, speed=speed, duration=1.0), Eye(height)
    pixels = eye.track(true)
    camera = see(pixels, CameraFile(camera_height=height))
    assert shape_misfit(camera.to_meters(pixels), true) < 1e-9
    assert camera.findings() == []


def test_without_the_camera_s_height_they_drift_and_a_height_that_cant_be_used_is_refused():
    true, eye = swim(), Eye(2.0)
    pixels = eye.track(true)
    camera = see(pixels)
    off = np.linalg.norm(camera.to_meters(pixels).positions - true.positions - [1.9195, -1.0795], axis=2)
    assert off[:, ABOVE == 0].max() < 1e-9
    # M8 begins 0.551 m from the middle, and is seen 0.05 / (2 - 0.05) of that too far out
    assert off.max() == pytest.approx(np.linalg.norm(true.positions[:, 8], axis=1).max() * 0.05 / 1.95)
    for part in ("M2 and M8 stand up to 50 mm", "7 mm too far out", "3.8 m away", "give camera_height"):
        assert part in camera.notes[0]
    assert "7 mm" not in see(pixels, size=None).notes[0]  # without the picture's size no number is made up
    track = Eye().track(swim())
    assert "add principal_point" in refusal(TrackingError, see, track, CameraFile(camera_height=2.0), size=None)
    low = refusal(TrackingError, see, track, CameraFile(camera_height=0.05))
    assert says(low, "camera_height 0.05 m", "M2", "0.05 m nearer")


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 12))
def test_a_homography_is_recovered_from_its_points(seed, count):
    rng = np.random.default_rng(seed)
    true = np.array([[1e-3, 1e-4, -1.0], [1e-4, -1e-3, 0.5], [0, 0, 1]]) + rng.normal(0, 1, (3, 3)) * [
        [1e-4, 1e-4, 0.3], [1e-4, 1e-4, 0.3], [2e-5, 2e-5, 0],
    ]  # fmt: skip
    corners = np.array([[100, 100], [3700, 150], [3600, 2000], [150, 2100]]) + rng.uniform(-90, 90, (4, 2))
    pixels = np.vstack([corners, rng.uniform(100, 2000, (count - 4, 2))])
    plane, residual = fit_plane(pixels, project(true, pixels))
    assert residual < 1e-9
    test = rng.uniform(100, 2000, (20, 2))
    np.testing.assert_allclose(project(plane, test), project(true, test), atol=1e-9)


@pytest.mark.parametrize(
    ("points", "message"),
    [(POOL[:3], "at least 4"), (np.outer(np.arange(5.0), [1, 2]), "lie on a line"), (np.ones((5, 2)), "coincide"),
     (np.array([[0, 0], [1, 0], [2, 0], [0, 1.0]]), "lie on a line")],
)  # fmt: skip
def test_points_that_make_no_plane_are_refused(points, message):
    assert message in refusal(TrackingError, fit_plane, points, points)


def test_beyond_a_plane_s_horizon_is_nowhere_and_a_plane_that_disagrees_is_told():
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    assert "beyond its horizon; check their order" in refusal(TrackingError, fit_plane, corners, corners[[0, 2, 1, 3]])
    plane = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0.01, 1]])
    assert np.isnan(project(plane, np.array([0.0, -200.0]))).all()
    assert np.isfinite(project(plane, np.array([0.0, -50.0]))).all()
    eye = Eye(2.0, (0.1, 0.1))
    camera = see(eye.track(swim(), 0.0), CameraFile(points=square(POOL, eye, 1.05 * POOL)), heights=LEVEL)
    assert camera.scale.spread == pytest.approx(0.05 / 1.05)
    assert camera.scale.findings()
    assert camera.scale.estimates[0] == ("camera file's plane", camera.scale.meters_per_pixel)
    meters = POOL.copy()
    meters[2] += 0.3
    camera = see(Eye().track(swim()), CameraFile(points=square(POOL, Eye(), meters), camera_height=2.0))
    assert camera.residual > 0.01
    assert f"fit no plane better than {1e3 * camera.residual:.0f} mm" in camera.notes[0]


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(1.5, 4), st.booleans())
def test_a_tilted_camera_is_undone_exactly(a, b, height, as_points):
    true, eye = swim(duration=1.0), Eye(height, (a, b))
    points = square(POOL, eye)
    known = CameraFile(camera_height=height, principal_point=eye.below)
    known = (
        replace(known, points=points) if as_points else replace(known, homography=-3.0 * fit_plane(*points)[0])
    )  # a homography is one whatever its factor
    camera = see(eye.track(true), known)
    np.testing.assert_allclose(camera.to_meters(eye.track(true)).positions, true.positions, atol=1e-9)
    assert camera.scale.spread < 1e-6
    assert camera.findings() == []
    assert (camera.residual is not None) == as_points


@pytest.mark.parametrize(
    "known", [CameraFile(points=square(POOL, Eye(), POOL * [1, -1])), CameraFile(homography=np.eye(3) * 1e-3)]
)
def test_a_plane_that_leaves_the_mirror_image_is_refused(known):
    message = refusal(TrackingError, see, Eye().track(swim()), known)
    assert "is a mirror image" in message
    assert "change the sign of all y in meters" in message


def distorted(points, lens=LENS):
    matrix = lens.camera_matrix
    rays = np.concatenate(
        [(points - matrix[:2, 2]) / matrix[[0, 1], [0, 1]], np.ones((*points.shape[:-1], 1))], axis=-1
    )
    seen = cv2.projectPoints(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, lens.distortion)[0]
    return seen.reshape(points.shape)


def test_a_lens_is_taken_out_of_everything_that_is_in_pixels():
    true = swim()
    eye = Eye(2.0, (0.1, -0.1), focal=2400.0, center=(1930.0, 1070.0))
    straight = eye.track(true)
    bent = MarkerTrack(straight.times, distorted(straight.positions))
    assert np.abs(bent.positions - straight.positions).max() > 1.0
    pixels, meters = square(POOL, eye)
    known = CameraFile(
        camera_height=2.0, principal_point=distorted(eye.below), points=(distorted(pixels), meters), lens=LENS,
        lengths=(Length("tape", distorted(pixels[:2]), float(np.linalg.norm(meters[1] - meters[0]))),),
    )  # fmt: skip
    camera = see(bent, known)
    assert np.abs(camera.to_meters(bent).positions - true.positions).max() < 1e-6
    assert camera.scale.spread < 1e-5
    assert camera.residual < 1e-6


REST3 = np.array([[0.0, 0.0], [0.14, 0.0], [0.35, 0.0]])
HEIGHTS3 = np.array([0.0, 0.0, 0.05])
SMALL = Lens(np.array([[900.0, 0, 630], [0, 910, 350], [0, 0, 1]]), np.array([-0.21, 0.06, 0.001, -0.002, 0.0]))
PLANE = np.array([[0.002, 1e-4, -1.2], [5e-5, -0.0021, 0.8], [1e-5, 2e-5, 1.0]])


@pytest.mark.parametrize(
    "known",
    [None, CameraFile(camera_height=2.0), CameraFile(homography=PLANE), CameraFile(camera_height=2.0, lens=SMALL),
     CameraFile(camera_height=1.5, homography=PLANE, lens=SMALL)],
    ids=["scale", "height", "plane", "lens", "all"],
)  # fmt: skip
def test_markers_come_back_from_meters_to_their_pixels(known):
    steps = np.random.default_rng(0).normal(size=(40, 3, 2))
    pixels = np.array([400.0, 300.0]) + 500 * REST3 + 4 * np.cumsum(steps, axis=0)
    pixels[7, 1] = np.nan
    track = MarkerTrack(np.arange(40) / 60, pixels)
    camera = camera_for(track, Layout(("a", "b", "c"), REST3, HEIGHTS3, (0, 0, 1)), known, (1280, 720))
    world = camera.to_meters(track).positions
    assert camera.to_pixels(world) == pytest.approx(pixels, abs=1e-3, nan_ok=True)
    again = fixed_camera(known, camera.scale.meters_per_pixel, HEIGHTS3, (1280, 720))
    assert again.to_pixels(world) == pytest.approx(pixels, abs=1e-3, nan_ok=True)
    assert "add points to the camera file" in refusal(TrackingError, fixed_camera, None, None, HEIGHTS3, (1280, 720))


def board_picture(eye):
    """A chessboard of 9 by 6 squares of 50 mm upside down in the water's plane, as the camera sees it."""
    rows, columns = np.indices((8, 11)) - 1
    black = ((rows + columns) % 2 == 0) & (rows >= 0) & (rows < 6) & (columns >= 0) & (columns < 9)
    canvas = np.kron(np.where(black, 0, 255).astype(np.uint8), np.ones((40, 40), np.uint8))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) * canvas.shape[::-1]
    seen = eye.pixels((corners / 40 - [5.5, 4.0]) * [-0.05, 0.05])
    matrix = cv2.getPerspectiveTransform((corners - 0.5).astype(np.float32), seen.astype(np.float32))
    return cv2.warpPerspective(canvas, matrix, (1920, 1080), flags=cv2.INTER_AREA, borderValue=255)


def test_a_chessboard_gives_the_plane():
    eye = Eye(1.0, (0.12, -0.1), focal=1500.0, center=(959.5, 539.5))
    picture = board_picture(eye)
    known = CameraFile(points=find_board(np.repeat(picture[:, :, None], 3, axis=2), (9, 6), 0.05))
    assert len(known.points[0]) == 8 * 5
    true = swim(speed=0.0)
    camera = see(eye.track(true, 0.0), known, (1920, 1080), LEVEL)
    assert camera.residual < 2e-4
    assert camera.scale.spread < 5e-3
    found = camera.to_meters(eye.track(true, 0.0))
    np.testing.assert_allclose(found.body, true.body, atol=2e-3)  # left is left, whichever way the board lies


@pytest.mark.parametrize(
    ("squares", "size", "error", "message"),
    [((9, 6), 0.05, TrackingError, "no chessboard of 9 x 6"), ((2, 6), 0.05, ArgumentError, "squares are 2 x 6"),
     ((9, 6), 0.0, ArgumentError, "square_size is 0.0 m")],
)  # fmt: skip
def test_a_board_that_isnt_there_is_refused(squares, size, error, message):
    assert message in refusal(error, find_board, np.full((400, 600), 200, np.uint8), squares, size)


# the file


FULL = {
    "format": 1, "camera_height": 2, "principal_point": [1919.5, 1079.5],
    "lengths": [{"name": "tape", "pixels": [[1, 2], [3, 4]], "meters": 0.5}, {"pixels": [[1, 2], [3, 9]], "meters": 1}],
    "points": [{"pixel": [x, y], "meters": [x / 100, -y / 100]} for x, y in ((0, 0), (100, 0), (100, 100), (0, 100))],
    "lens": {"camera_matrix": [[2400, 0, 1930], [0, 2400, 1070], [0, 0, 1]], "distortion": [0.1, 0, 0, 0]},
}  # fmt: skip


def file_with(tmp_path, **changes):
    content = {key: value for key, value in {**FULL, **changes}.items() if value is not ...}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(content))
    return path


def test_what_was_written_is_read_again(tmp_path):
    first = read_camera(file_with(tmp_path))
    plane = replace(first, points=None, homography=np.array([[1e-3, 0, 0], [0, -1e-3, 0], [0, 0, 1]]))
    for camera in (first, plane, CameraFile()):
        write_camera(tmp_path / "one.json", camera)
        write_camera(tmp_path / "two.json", read_camera(tmp_path / "one.json"))
        assert (tmp_path / "one.json").read_text() == (tmp_path / "two.json").read_text()
    assert read_camera(tmp_path / "two.json") == CameraFile()
    assert refusal(TrackingError, write_camera, tmp_path / "nowhere" / "c.json", CameraFile()).startswith(
        "can't write camera file"
    )


@pytest.mark.parametrize(("changes", "parts"), [
    ({"format": 2}, ("'format' is 2", "1")),
    ({"format": ...}, ("'format' is missing",)),
    ({"height": 2}, ("'height'", "did you mean 'camera_height'?")),
    ({"homography": np.eye(3).tolist()}, ("points and a homography", "keep one")),
    ({"camera_height": -2}, ("'camera_height' is -2", "above 0")),
    ({"principal_point": [1, float("nan")]}, ("'principal_point[1]' is NaN", "finite")),
    ({"points": ..., "homography": [[1, 2], [3, 4]]}, ("'homography[0]' is [1, 2]", "at least 3")),
    ({"points": ..., "homography": [[1, 2, 3]] * 3}, ("'homography'", "can't be inverted")),
    ({"points": FULL["points"][:3]}, ("at least 4 entries",)),
    ({"points": [{"pixel": [1, "a"], "meters": [1, 2]}] * 4}, ("'points[0].pixel[1]' is \"a\"", "a number")),
    ({"lengths": [{"pixels": [[0, 1e-320], [0, 0]], "meters": 1}]}, ("'lengths[0].pixels'", "the same pixel")),
    ({"points": [{"pixel": [1, 2], "meters": [1e308, 0]}] * 4}, ("'points[0].meters[0]' is 1e+308", "at most")),
    ({"lengths": [{"pixels": [[1, 2], [1, 3]], "meters": 0}]}, ("'lengths[0].meters' is 0", "at least")),
    ({"lens": {**FULL["lens"], "distortion": [0, 0]}}, ("2 numbers", "4, 5, 8, 12, 14")),
    ({"lens": {**FULL["lens"], "camera_matrix": np.zeros((3, 3)).tolist()}}, ("[[fx, 0, cx]", "above 0")),
])  # fmt: skip
def test_camera_files_that_cant_be_used_are_refused(tmp_path, changes, parts):
    path = file_with(tmp_path, **changes)
    assert says(refusal(TrackingError, read_camera, path), f"camera file '{path}'", *parts)


@pytest.mark.parametrize(("text", "part"), [(None, " is not there"), ("{", " can't be read as JSON: "), ("[]", ": []")])
def test_a_camera_file_that_isnt_one_is_refused(tmp_path, text, part):
    path = tmp_path / "camera.json"
    if text:
        path.write_text(text)
    assert refusal(TrackingError, read_camera, path).startswith(f"camera file '{path}'{part}")
