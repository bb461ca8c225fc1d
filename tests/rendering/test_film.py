"""Real films: frames at given times, small copies, and sheets, upright and with time and number burned in."""

import re

import numpy as np
import pytest

from swim2real.errors import ArgumentError, VideoError
from swim2real.rendering.film import clip_times, film_clip, film_frames, film_sheet
from swim2real.video import VideoReader, VideoWriter

FILM_TIMES = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.31, 0.4, 0.5])  # s


def read(path) -> tuple[list[float], list[np.ndarray]]:
    with VideoReader(path) as reader:
        frames = [(frame.time, frame.image.astype(int)) for frame in reader]
    return [time for time, _ in frames], [image for _, image in frames]


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


def levels(images) -> list[int]:
    """Which frame of the film each picture shows, by its gray."""
    return [round((np.median(image[image.shape[0] // 2 :]) - 40) / 20) for image in images]


@pytest.mark.parametrize(
    ("duration", "fps", "count"), [(1.0, 10, 11), (0.99, 10, 10), (4.0, 8, 33), (0.1, 5, 1), (0.7 / 3 * 3, 10, 8)]
)
def test_times_of_a_clip(duration, fps, count):
    np.testing.assert_allclose(clip_times(duration, fps), np.arange(count) / fps)


def test_a_film_is_copied_upright_at_the_nearest_frames(film, tmp_path):
    film_clip(film, tmp_path / "copy.mp4", 10, 320)
    times, images = read(tmp_path / "copy.mp4")
    np.testing.assert_allclose(times, np.arange(6) / 10, atol=1e-4)
    assert images[0].shape == (240, 320, 3)
    assert levels(images) == [0, 2, 4, 5, 6, 7]
    film_clip(film, tmp_path / "short.mp4", 10, 320, seconds=0.2)
    assert levels(read(tmp_path / "short.mp4")[1]) == [0, 2, 4]
    film_clip(film, tmp_path / "fast.mp4", 40, 320, seconds=0.1)
    assert levels(read(tmp_path / "fast.mp4")[1]) == [0, 0, 1, 1, 2]
    film_clip(film, tmp_path / "late.mp4", 10, 320, seconds=0.2, start=0.1)
    assert levels(read(tmp_path / "late.mp4")[1]) == [2, 4, 5]


def test_a_film_has_its_time_burned_in(film):
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


def test_frames_of_a_film_end_with_it(film):
    assert [time for time, _ in film_frames(film, [], 64)] == []
    times = [time for time, _ in film_frames(film, [0.02, 0.48, 0.52, 0.9, 5.0], 64)]
    np.testing.assert_allclose(times, [0.0, 0.5, 0.5], atol=1e-4)
    for times, message in (
        ([0.2, 0.1], "a time of a film is 0.1 s; it must be finite, 0 or more, and later than the last"),
        ([-0.1], "a time of a film is -0.1 s"),
        ([float("nan")], "a time of a film is nan s"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(message)):
            list(film_frames(film, times, 64))
    with pytest.raises(ArgumentError, match="width is 63 px; it must be even and at least 64"):
        list(film_frames(film, [0.0], 63))


def test_what_is_not_allowed_is_refused_and_leaves_nothing(film, tmp_path):
    for call, words in (
        (lambda path: film_clip(film, path, float("nan")), "fps is nan"),
        (lambda path: film_clip(film, path, 10, 62), "width is 62 px; it must be even and at least 64"),
        (lambda path: film_clip(film, path, 10, 64, -1), "seconds is -1; it must be 0 or more"),
        (lambda path: film_clip(film, path, 10, start=9), "ends before start, 9 s"),
        (lambda path: film_clip(film, film, 10), "would replace it; give path another name"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(words)):
            call(tmp_path / "no.mp4")
    with pytest.raises(VideoError, match="nothing"):
        film_clip(tmp_path / "nothing.mp4", tmp_path / "no.mp4", 10)
    assert list(tmp_path.iterdir()) == []
    assert film.is_file()


def test_a_film_sheet_shows_frames_at_times(tmp_path):
    path = tmp_path / "real.mp4"
    with VideoWriter(path, 64, 48, 10, crf=5) as writer:
        for k in range(6):
            writer.write(np.full((48, 64, 3), 40 + 30 * k, np.uint8))
    sheet = film_sheet(path, [0.0, 0.19, 0.52], 2, 160).astype(int)
    places = []
    for level in (40, 100, 190):
        where = np.argwhere(np.abs(sheet - level).max(axis=-1) < 3)
        (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0)
        assert (bottom - top + 1, right - left + 1) == (120, 160)
        places.append((top, left))
    assert places[0][0] == places[1][0] < places[2][0]
    assert places[0][1] == places[2][1] < places[1][1]
    with pytest.raises(ArgumentError, match=re.escape(f"none of the 2 times lies within '{path}'; give times within")):
        film_sheet(path, [7.0, 8.0], 2, 160)
    with pytest.raises(ArgumentError, match="none of the 0 times lies within"):
        film_sheet(path, [], 2, 160)
