from dataclasses import dataclass, replace

import numpy as np
import pytest
from pool import PoolCamera, scene

from markertrack.both_ways import both_ways
from markertrack.quality import DOUBTFUL
from markertrack.tracking.chain import Chain
from markertrack.tracking.markers import MarkerTracker
from swim2real.robots.fish import FISH
from swimbase.errors import TrackingError
from swimmers import Swimmer

# one beat of the tail, from low in the picture to high and back
SWIMMER = Swimmer(frequency=2.5, speed=0.3, phase=np.pi, heading=0.0, amplitude=0.05, duration=0.42, fps=250.0)
CAMERA = PoolCamera(width=640, height=360, view=0.85)
COVERED = (4, 5)
GLARE = slice(9, 16)  # frames


def chain():
    return MarkerTracker(range(9), chain=True)


@dataclass(frozen=True)
class Picture:
    time: float
    image: np.ndarray
    intact: bool = True


def forth(tracker, frames, picks):
    """The way forth alone of `both_ways`."""
    for k, frame in enumerate(frames):
        yield frame, *(tracker.follow(frame.image, frame.time) if k else tracker.start(frame.image, picks, frame.time))


@dataclass(frozen=True)
class Film:
    """Pictures (T, H, W, 3), times (T,) [s], and the centers of the markers (T, M, 2) and their radius [px]."""

    pictures: np.ndarray
    times: np.ndarray
    places: np.ndarray
    radius: float

    def tracked(self, picks=None, way=forth):
        """Positions (T, M, 2), NaN where they are doubtful, and confidence (T, M)."""
        frames = map(Picture, self.times, self.pictures)
        found = way(chain(), frames, self.places[0] if picks is None else picks)
        _, positions, confidence = map(np.array, zip(*found, strict=True))
        return np.where((confidence >= DOUBTFUL)[..., None], positions, np.nan), confidence

    def only(self, frames):
        return replace(self, pictures=self.pictures[frames], times=self.times[frames], places=self.places[frames])


def filmed(camera, swimmer=SWIMMER):
    swim = scene(swimmer.track(noise=0.0, by_hand=False), FISH.marker_heights, camera, seed=1)
    times, pictures = zip(*swim, strict=True)
    truth = swim.filmed.truth.positions
    assert np.isfinite(truth).all()
    return Film(np.array(pictures), np.array(times), truth, camera.marker_radius / camera.meters_per_pixel)


@pytest.fixture(scope="module")
def film():
    """A fish that beats its tail once. Don't write into it."""
    made = filmed(CAMERA)
    made.pictures.setflags(write=False)
    return made


@pytest.fixture(scope="module")
def glared(film):
    """The same with two markers below glare for seven frames, its positions and confidence, both ways."""
    hard = painted(film, GLARE, COVERED)
    return hard, *hard.tracked(way=both_ways)


def painted(film, frames, markers, color=(255, 255, 255), reach=2.0, strength=1.0):
    """The pictures with a disc over each of some markers."""
    pictures = film.pictures.copy()
    y, x = np.mgrid[: pictures.shape[1], : pictures.shape[2]]
    for k in range(len(pictures))[frames]:
        for cx, cy in film.places[k, list(markers)]:
            under = np.hypot(x - cx, y - cy) < reach * film.radius
            mixed = (1 - strength) * pictures[k][under] + strength * np.array(color)
            pictures[k][under] = mixed.astype(np.uint8)
    return replace(film, pictures=pictures)


def errors(film, positions):
    """NaN for lost markers [px]. Shape (T, M)."""
    return np.linalg.norm(positions - film.places, axis=2)


def rmse(film, positions):
    return float(np.sqrt(np.nanmean(errors(film, positions) ** 2)))


def test_markers_are_found_to_a_fraction_of_a_pixel(film):
    positions, confidence = film.tracked()
    assert np.isfinite(positions).all()
    assert rmse(film, positions) < 0.1
    assert errors(film, positions).max() < 0.5
    assert np.median(confidence) > 0.9


def test_hidden_markers_are_lost_and_found_again_at_their_places(glared):
    film, positions, confidence = glared
    seen = np.isfinite(positions[:, :, 0])
    np.testing.assert_array_equal(seen, confidence >= DOUBTFUL)
    assert confidence.max() <= 1
    assert not seen[GLARE, COVERED].any()
    assert seen[: GLARE.start].all()
    assert seen[GLARE.stop + 1 :].all()  # one frame later at the latest
    assert np.delete(seen, COVERED, axis=1).mean() > 0.99
    assert np.nanmax(errors(film, positions)) < 1


@pytest.mark.slow
def test_a_fish_that_was_hidden_as_a_whole_is_found_again(film):
    pictures = film.pictures.copy()
    pictures[5:17] = pictures[0, 0, 0]  # nothing but water for 0.2 s
    positions, confidence = replace(film, pictures=pictures).tracked()
    assert (confidence[5:17] == 0).all()
    assert np.isfinite(positions[21:]).all()
    assert np.nanmax(errors(film, positions)) < 1


def test_points_may_be_off_by_three_pixels(film):
    early, turns = film.only(slice(4)), np.random.default_rng(2).uniform(0, 2 * np.pi, len(film.places[0]))
    positions, _ = early.tracked(film.places[0] + 3 * np.stack([np.cos(turns), np.sin(turns)], axis=1))
    assert np.isfinite(positions).all()
    assert rmse(early, positions) < 0.25


def test_points_without_markers_are_refused(film):
    beside = film.places[0] + [0.0, 4 * film.radius]
    for image, points, says in (
        (film.pictures[0], beside, r"[5-9] of 9 points, such as \(\d+, \d+\).*`swim2real pick`"),
        (np.full_like(film.pictures[0], 120), film.places[0], "9 of 9 points"),
    ):
        with pytest.raises(TrackingError, match=f"no marker stands out at {says}"):
            chain().start(image, points, 0.0)


def test_markers_that_leave_the_image_are_lost_until_they_return(film):
    # cut off above, where the tail beats out of the image and in again
    top = round(film.places[0, :, 1].min() - 2 * film.radius)
    cut = replace(film, pictures=film.pictures[:, top:], places=film.places - [0, top])
    height = cut.places[..., 1]
    outside, inside = height < -film.radius, height > film.radius + 1
    assert inside[0].all()
    assert inside[-1].all()
    assert outside.any()
    positions, _ = cut.tracked()
    assert np.isnan(positions[outside]).all()
    assert np.isfinite(positions[inside][:, 0]).mean() > 0.9
    assert np.isfinite(positions[-5:]).all()
    assert np.nanmax(errors(cut, positions)) < 1


@pytest.mark.parametrize(
    ("marker", "body"),
    [
        pytest.param((30, 30, 32), (205, 205, 200), id="black on white", marks=pytest.mark.slow),
        pytest.param((74, 80, 86), (34, 38, 44), id="gray on black"),
    ],
)
def test_markers_of_other_colors(marker, body):
    short = filmed(replace(CAMERA, marker_color=marker, body_color=body), replace(SWIMMER, duration=0.1))
    positions, _ = short.tracked()
    assert np.isfinite(positions).all()
    assert rmse(short, positions) < 0.25


@pytest.mark.parametrize(("along", "clear"), [((0, 90, 130, 150, 165, 225), True), ((0, 20, 40, 60, 80, 100), False)])
def test_spots_are_given_in_the_order_of_the_body_and_clear_only_one_way(along, clear):
    body = np.column_stack([along, np.zeros(6)])
    spots = np.delete(body, 2, axis=0)[::-1] + np.array([5.0, 3.0])
    chosen, margins = Chain(body).fit(np.zeros((6, 5)), spots)
    if clear:
        np.testing.assert_array_equal(chosen, [4, 3, -1, 2, 1, 0])
    assert (margins[chosen >= 0] > 0.5).all() == clear  # equal distances fit the other way around
