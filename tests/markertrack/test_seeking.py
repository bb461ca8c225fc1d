"""Any frame of a film by its number."""

import random

import numpy as np
import pytest
from clips import clip

from markertrack.video import SeekableFilm, VideoReader
from swim2real.demo.example import FILMS
from swimbase.errors import VideoError


@pytest.fixture(scope="module")
def frames():
    """Every tenth frame of a film, thumbnails, as the reader has them."""
    with VideoReader(FILMS / "f1_00.mp4") as reader:
        return {frame.index: (frame.time, frame.image[::8, ::8].copy()) for frame in reader if frame.index % 10 == 0}


def test_frames_in_any_order_are_those_of_the_reader(frames):
    film, numbers = SeekableFilm(FILMS / "f1_00.mp4"), list(frames)
    random.Random(0).shuffle(numbers)
    for number in numbers:
        frame = film.frame(number)
        time, image = frames[number]
        assert frame.index == number
        assert frame.time == pytest.approx(time, abs=1e-6)
        np.testing.assert_array_equal(frame.image[::8, ::8], image)
    film.close()


def test_a_key_frame_is_the_readers_and_the_next_frame_is_exact(tmp_path):
    path = FILMS / "f1_00.mp4"
    with VideoReader(path) as reader:
        images = {frame.index: frame.image[::8, ::8].copy() for frame in reader}
    film = SeekableFilm(path)
    for number in (239, 0, 60):
        key = film.key_frame(number)
        assert key.index <= number
        np.testing.assert_array_equal(key.image[::8, ::8], images[key.index])
        np.testing.assert_array_equal(film.frame(number).image[::8, ::8], images[number])
    film.close()


@pytest.mark.parametrize("rotation", [90, 180])
def test_turned_films_are_upright(tmp_path, rotation):
    path = clip(tmp_path / "swim.mp4", 12, rotation=rotation)
    film = SeekableFilm(path)
    with VideoReader(path) as reader:
        images = [frame.image for frame in reader]
        assert film.size == (reader.info.width, reader.info.height)
    assert len(film.times) == len(images)
    for number in (7, 0, 11, 3):
        np.testing.assert_array_equal(film.frame(number).image, images[number])
    film.close()


def test_a_number_that_is_none_and_a_cut_film_are_sentences(tmp_path):
    film = SeekableFilm(FILMS / "f1_00.mp4")
    with pytest.raises(VideoError, match=rf"has frames 0 to {len(film.times) - 1}, and none of number 9999"):
        film.frame(9999)
    film.close()
    cut = tmp_path / "cut.mp4"
    cut.write_bytes((FILMS / "f1_00.mp4").read_bytes()[:32])
    with pytest.raises(VideoError, match="cut off"):
        SeekableFilm(cut)
