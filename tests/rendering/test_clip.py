"""Clips of swims and of real films: how many frames, at which times, and what they show."""

import re
import subprocess
import sys

import numpy as np
import pytest

from swim2real.errors import ArgumentError, VideoError
from swim2real.rendering.clip import clip_times, film_clip, write_clip
from swim2real.rendering.film import film_frames
from swim2real.rendering.swim_frame import draw_frame
from swim2real.rendering.swim_view import SwimView, common_limits
from swim2real.video import VideoReader, VideoWriter

NAMES = ("M0", "M1", "M2", "M3")
FILM_TIMES = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.31, 0.4, 0.5])  # s


def swim(seconds: float = 1.0, seed: int = 0) -> SwimView:
    """A swim with noise, sampled 60 times a second."""
    times = np.arange(round(60 * seconds) + 1) / 60
    side = 0.1 * np.sin(4 * np.pi * times[:, None] - np.arange(4)) * np.array([0, 0, 0.4, 1.0])
    real = np.stack([np.broadcast_to([0, 0.1, 0.3, 0.5], side.shape), side], axis=-1)
    noisy = real + np.random.default_rng(seed).normal(0, 2e-3, real.shape)
    course = real - np.stack([0.05 + 0.1 * times, 0 * times], axis=-1)[:, None]
    return SwimView("f2_00", times, np.ones(side.shape, bool), noisy, real, NAMES, 2.0, course, course)


def write(view: SwimView, path, fps: float, width: int = 480) -> None:
    limits = common_limits([view])
    write_clip(view, lambda index: draw_frame(view, index, limits, width), path, fps)


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


def test_a_clip_shows_the_nearest_sample_of_each_time(tmp_path):
    view = swim()
    limits = common_limits([view])
    write(view, tmp_path / "clip.mp4", 10)
    times, images = read(tmp_path / "clip.mp4")
    np.testing.assert_allclose(times, np.arange(11) / 10, atol=1e-4)
    for k in (0, 3, 7, 10):
        errors = [
            np.abs(images[k] - draw_frame(view, index, limits, 480)).mean()
            for index in (6 * k - 6, 6 * k, 6 * k + 6)
            if 0 <= index <= 60
        ]
        expected = np.abs(images[k] - draw_frame(view, 6 * k, limits, 480)).mean()
        assert expected == min(errors)
        assert expected < 2.5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip.mp4"]


def test_a_clip_keeps_its_colors(tmp_path):
    write(swim(0.2), tmp_path / "clip.mp4", 10, 640)
    _, images = read(tmp_path / "clip.mp4")
    for color in ((213, 43, 30), (0, 84, 190)):
        assert np.count_nonzero(np.abs(images[1] - color).max(axis=-1) < 70) > 60


def test_clips_are_small_and_deterministic(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        write(swim(4.0), tmp_path / name, 10, 640)
    content = (tmp_path / "a.mp4").read_bytes()
    assert content == (tmp_path / "b.mp4").read_bytes()
    assert len(content) < 100_000


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
    view = swim(0.2)
    for call, message in (
        (lambda path: write(view, path, 0), "fps is 0; it must be finite and above 0 frames a second"),
        (lambda path: write(view, path, 10, 641), "width is 641 px; it must be even and at least 320"),
        (lambda path: film_clip(film, path, float("nan")), "fps is nan; it must be finite and above 0"),
        (lambda path: film_clip(film, path, 10, 62), "width is 62 px; it must be even and at least 64"),
        (lambda path: film_clip(film, path, 10, 64, -1), "seconds is -1; it must be 0 or more, or None for the whole"),
        (lambda path: film_clip(film, path, 10, start=9), "ends before start, 9 s; give a start within the film"),
        (lambda path: film_clip(film, film, 10), "would replace it; give path another name"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(message)):
            call(tmp_path / "no.mp4")
    with pytest.raises(VideoError, match="its ending must be one of"):
        write(view, tmp_path / "no.gif", 10)
    with pytest.raises(VideoError, match="nothing"):
        film_clip(tmp_path / "nothing.mp4", tmp_path / "no.mp4", 10)
    assert list(tmp_path.iterdir()) == []
    assert film.is_file()


def test_importing_the_modules_imports_neither_pillow_nor_av():
    code = (
        "import sys, swim2real.rendering.swim_sheet, swim2real.rendering.playback_sheet, swim2real.rendering.encoding"
    )
    code += "\nprint('PIL' in sys.modules or 'av' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "False"
