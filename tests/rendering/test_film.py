"""Real films: frames at given times, small copies, and sheets, upright and with time and number burned in."""

import numpy as np
import pytest

from markertrack.video import VideoReader, VideoWriter
from swim2real.rendering.film import film_clip, film_frames, film_sheet
from swimbase.errors import ArgumentError, VideoError

FILM_TIMES = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.31, 0.4, 0.5])  # s
NAN = float("nan")


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A film of 8 frames of rising gray in 64 x 48 px, lying on its side, with a white corner at the top left."""
    path = tmp_path_factory.mktemp("film") / "real.mp4"
    with VideoWriter(path, 48, 64, 20, crf=5, rotation=90) as writer:
        for k, time in enumerate(FILM_TIMES):
            image = np.full((64, 48, 3), 40 + 20 * k, np.uint8)
            image[48:, :16] = 250  # bottom left as it is stored: top left when turned clockwise
            writer.write(image, float(time))
    return path


@pytest.mark.parametrize(("fps", "options", "levels"), [
    (10, {}, [0, 2, 4, 5, 6, 7]), (10, {"seconds": 0.2}, [0, 2, 4]),
    (40, {"seconds": 0.1}, [0, 0, 1, 1, 2]),
    (10, {"seconds": 0.2, "start": 0.1}, [2, 4, 5]),
])  # fmt: skip
def test_a_film_is_copied_upright_at_the_nearest_frames(film, tmp_path, fps, options, levels):
    film_clip(film, tmp_path / "copy.mp4", fps, 320, **options)
    with VideoReader(tmp_path / "copy.mp4") as reader:
        frames = [(frame.time, frame.image.astype(int)) for frame in reader]
    np.testing.assert_allclose([time for time, _ in frames], np.arange(len(levels)) / fps, atol=1e-4)
    assert frames[0][1].shape == (240, 320, 3)
    assert [round((np.median(image[120:]) - 40) / 20) for _, image in frames] == levels


def test_a_film_whose_rate_was_given_is_shown_on_the_camera_s_clock(tmp_path):
    with VideoWriter(tmp_path / "slow.mp4", 64, 48, 5) as writer:
        for k in range(6):
            writer.write(np.full((48, 64, 3), 40 * k, np.uint8))
    (time, _), (other, _) = film_frames(tmp_path / "slow.mp4", [0.02, 0.05], 320, rate=100)
    assert (time, other) == (0.02, 0.05)
    assert film_sheet(tmp_path / "slow.mp4", [0.02, 0.05], 2, 320, rate=100).shape[1] > 600


def test_a_film_has_its_time_burned_in_and_frames_end_with_it(film):
    pictures = dict(film_frames(film, [0.0, 0.1, 0.3], 320))
    np.testing.assert_allclose(list(pictures), [0, 0.1, 0.31], atol=1e-4)
    for image in pictures.values():
        plate = image[4:22, 6:120].astype(int)
        assert plate.max() > 220
        assert np.median(plate) < 70
        rows = np.flatnonzero((plate.min(axis=-1) > 180).any(axis=1))
        assert rows[-1] - rows[0] + 1 >= 8
        assert image[30:56, 8:72].min() > 225  # the film's white corner, turned to the top left
    stamps = [image[:24, :140].astype(int) for image in pictures.values()]
    assert np.abs(stamps[0] - stamps[1]).max() > 100
    assert list(film_frames(film, [], 64)) == []
    times = [time for time, _ in film_frames(film, [0.02, 0.48, 0.52, 0.9, 5.0], 64)]
    np.testing.assert_allclose(times, [0.0, 0.5, 0.5], atol=1e-4)


@pytest.mark.parametrize(("call", "words"), [
    (lambda film, path: film_clip(film, path, NAN), "fps is nan"),
    (lambda film, path: film_clip(film, path, 10, 62), "width is 62 px"),
    (lambda film, path: film_clip(film, path, 10, 64, -1), "seconds is -1"),
    (lambda film, path: film_clip(film, path, 10, start=9), "ends before start, 9 s"),
    (lambda film, path: film_clip(film, film, 10), "would replace it"),
    (lambda film, path: list(film_frames(film, [0.2, 0.1], 64)), "0.1 s"),
    (lambda film, path: film_sheet(film, [7.0, 8.0], 2, 160), "none of the 2 times"),
    (lambda film, path: film_clip(path.with_name("nothing.mp4"), path, 10), "nothing"),
])  # fmt: skip
def test_what_is_not_allowed_is_refused_and_leaves_nothing(film, tmp_path, call, words):
    with pytest.raises((ArgumentError, VideoError), match=words):
        call(film, tmp_path / "no.mp4")
    assert list(tmp_path.iterdir()) == []
    assert film.is_file()
