"""The films that trackers are measured on: their truth is right, and the same numbers give the same film."""

import sys
from dataclasses import replace
from hashlib import sha256
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from lattice_camera import drawn
from lattice_films import Result
from lattice_looks import filmed
from lattice_real import ALONE, real_film
from lattice_scenes import random_film
from lattice_truth import Body, Box, Camera, Glare, Occluder, Scene, planned

from markertrack.tracking.markers import MarkerTracker

WHITE, BLACK = (230, 230, 230), (20, 20, 20)
CAMERA = Camera(320, 240, fps=50, shutter=0.8, bend=0.08, softness=2.0, electrons=1e6, read_noise=1.0, uneven=0.0,
                texture=0.0, background=WHITE, quality=12, seed=3)  # fmt: skip


def scene(speed=(400.0, -150.0), turning=3.0, **options):
    """A plate with two markers that slides [px/s] and turns [rad/s]."""
    plate = Body((Box((0.0, 0.0), (60.0, 15.0), 4.0),), np.array([[-40.0, 0.0], [40.0, 0.0]]), WHITE)

    def poses(times):
        return np.column_stack([90 + speed[0] * times, 170 + speed[1] * times, turning * times])[:, None]

    return Scene((plate,), None, (), poses, BLACK, radius=8.0, seconds=0.2, squares=False, **options)


def centroid(image, place, reach, gamma):
    """Of darkness around a place [px]; the picture is made linear first."""
    left, top = np.round(place).astype(int) - reach
    patch = (image[top : top + 2 * reach + 1, left : left + 2 * reach + 1].mean(axis=2) / 255) ** gamma
    dark = np.clip(np.median(patch) - patch, 0, None)
    dark[dark < 0.05 * dark.max()] = 0
    rows, columns = np.mgrid[: len(patch), : len(patch)]
    return np.array([left + (columns * dark).sum() / dark.sum(), top + (rows * dark).sum() / dark.sum()])


def film(path=Path("none.mp4"), camera=CAMERA, **options):
    return planned("plate", scene(**options), camera, path)


@pytest.mark.parametrize("squares", [False, True])
def test_markers_are_drawn_where_the_truth_has_them(squares):
    made = film(turning=1.0)
    made = replace(made, scene=replace(made.scene, squares=squares))
    assert made.speed.max() > 8  # blurred
    assert np.abs(CAMERA.picture(made.scene.plane(made.times)) - made.scene.plane(made.times)).max() > 2  # and bent
    for image, places in zip(drawn(made), made.places, strict=True):
        found = [centroid(image, place, 22, CAMERA.gamma) for place in places]
        assert np.abs(np.array(found) - places).max() < 0.2


def test_covered_markers_are_known():
    still = {"speed": (0.0, 0.0), "turning": 0.0}
    assert (film(**still).covered == 0).all()
    left, right = film(**still).places[0]
    covers = (Occluder(0.05, 0.1, Box(tuple(left), (12.0, 12.0), 2.0), BLACK),
              Glare(0.12, 0.2, tuple(right), (40.0, 40.0), 2.0))  # fmt: skip
    made = film(**still, covers=covers)
    occluded, glaring = (made.times >= 0.05) & (made.times <= 0.1), made.times >= 0.12
    np.testing.assert_array_equal(made.visible, np.column_stack([~occluded, ~glaring]))
    for image, visible, places in zip(drawn(made), made.visible, made.places, strict=True):
        for seen, place in zip(visible, places, strict=True):
            x, y = np.round(place).astype(int)
            contrast = float(image[y, x + 13].mean()) - float(image[y, x].mean())
            assert (contrast > 100) == seen


def test_swaps_doubts_and_losses_are_told_apart():
    made = film(speed=(0.0, 0.0), turning=0.0)
    found, confidence = made.places.copy(), np.ones(made.places.shape[:2])
    found[1] = found[1, ::-1]  # swapped
    found[2, 0, 1] += 9.0  # wrong, but its own
    found[3, 0, 1] += 9.0
    confidence[3, 0] = 0.4  # wrong, with a doubt
    found[4:7, 1], confidence[4:7, 1] = np.nan, 0.0
    result = Result(made, found, confidence, track_time=0.0, decode_time=0.0)
    assert np.argwhere(result.silent).tolist() == [[1, 0], [1, 1], [2, 0]]
    assert np.argwhere(result.swapped).tolist() == [[1, 0], [1, 1]]
    assert np.argwhere(result.wrong & ~result.sure).tolist() == [[3, 0]]
    assert np.argwhere(result.lost).tolist() == [[3, 0], [4, 1], [5, 1], [6, 1]]
    assert result.longest == pytest.approx(3 / made.fps)
    assert result.worst == pytest.approx(80.0, abs=5.0)  # the markers' distance


def digest(made):
    """Of the truth of a film and of two of its pictures."""
    parts = [made.times, made.places, made.speed, made.covered, made.picks, *islice(filmed(made), 2)]
    return sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def test_the_same_seed_gives_the_same_film(tmp_path):
    index = len(ALONE) + 1
    made, again, *others = (real_film(*of, tmp_path) for of in ((2, index), (2, index), (2, index + 1), (3, index)))
    assert (made.name, made.camera, digest(made)) == (again.name, again.camera, digest(again))
    assert len({digest(one) for one in (made, *others)}) == 3
    first, again, other = (random_film(5, index, tmp_path) for index in (0, 0, 2))
    np.testing.assert_array_equal(first.places, again.places)
    assert first.camera == again.camera != other.camera


@pytest.mark.parametrize("index", [20])  # oval+tone+halo+shake: 24 markers, up to 15 px a frame
def test_a_real_film_is_followed_without_a_silent_error(tmp_path, index):
    made, count = real_film(2, index, tmp_path), 20
    tracker = MarkerTracker(made.bodies.tolist(), made.fixed)
    found = [
        tracker.follow(image, time) if frame else tracker.start(image, made.picks, time)
        for frame, (image, time) in enumerate(zip(islice(filmed(made), count), made.times, strict=False))
    ]
    positions, confidence = (np.array(part) for part in zip(*found, strict=True))
    cut = {name: getattr(made, name)[:count] for name in ("times", "places", "speed", "covered")}
    result = Result(replace(made, **cut), positions, confidence, track_time=0.0, decode_time=0.0)
    assert made.speed[:count].max() > 10
    assert np.argwhere(result.silent).tolist() == []
    assert result.lost.mean() < 0.02
    assert result.rmse < 0.3
