"""How many frames a camera took per second is stated by a film, given by the user, or asked for; never made up."""

import shutil

import numpy as np
import pytest
from clips import WIDTH, clip, error, picture, raw, read
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from films import slowed
from markertrack.video import VideoReader, VideoWriter, film_name, first_frame, frames_backwards
from markertrack.video.decoding import usual_interval
from swimbase.errors import VideoError

MADE_UP = {
    "swim.mjpeg": lambda path: raw(path, "mjpeg", 12, "yuvj420p", colors=5),
    "swim.gif": lambda path: timeless_gif(raw(path, "gif", 12, "rgb8")),
}


def timeless_gif(path):
    """A GIF whose pictures have no delays."""
    data, place = bytearray(path.read_bytes()), 0
    while (place := data.find(b"\x21\xf9\x04", place)) >= 0:
        data[place + 4 : place + 6] = b"\0\0"
        place += 8
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", MADE_UP)
def test_a_rate_that_nothing_states_is_asked_for(tmp_path, name):
    film = MADE_UP[name](tmp_path / name)
    for ask in (VideoReader, lambda path: first_frame(path, 0.1)):
        with pytest.raises(VideoError, match=f"nothing in '.*{name}' states how many frames .* give them with --fps"):
            ask(film)
    assert np.isnan(first_frame(film).time)  # which no click needs
    frames, notes, info = read(film, fps=200)
    assert [time for time, *_ in frames] == pytest.approx(np.arange(12) / 200)
    assert (info.fps, info.rate_from, notes) == (200, "given", [])
    assert first_frame(film, 0.025, 200).index == 5
    assert [frame.time for frame in frames_backwards(film, 2, 4, fps=200)] == pytest.approx([0.02, 0.015, 0.01])


def test_h264_of_a_camera_that_states_no_rate_is_asked_for_it(shared):
    film = shared / "data" / "field" / "03-raw-stream-rate" / "pi.h264"
    if not film.is_file():
        pytest.skip(f"no film '{film}'")
    with pytest.raises(VideoError, match="give them with --fps"):
        VideoReader(film)
    assert [time for time, *_ in read(film, fps=60)[0]] == pytest.approx(np.arange(60) / 60)


@pytest.mark.parametrize(
    ("name", "encoder"), [("swim.h264", "libx264"), ("swim.m2v", "mpeg2video"), ("swim.mkv", "libx264")]
)
def test_a_rate_that_the_stream_or_the_container_states_is_used(tmp_path, name, encoder):
    frames, notes, info = read(raw(tmp_path / name, encoder, 12))
    assert [time for time, *_ in frames] == pytest.approx(np.arange(12) / 30, abs=1e-3)
    assert (info.fps, info.rate_from, notes) == (30, "container", [])


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["a.mp4", "a.mkv", "a.mov", "a.ts"]), st.sampled_from([7.5, 24.0, 29.97, 60.0]),
    st.floats(20.0, 2000.0), st.sets(st.integers(0, 11), min_size=6),
)  # fmt: skip
def test_times_are_the_camera_s_whatever_the_film_s_speed(tmp_path, name, played, taken, kept):
    """Frames that were dropped leave their gaps."""
    numbers = sorted(kept)
    with VideoWriter(tmp_path / name, WIDTH, 96, played) as writer:
        for k in numbers:
            writer.write(picture(k), (k - numbers[0]) / played)
    steps = np.diff(numbers)
    usual = steps[np.abs(steps - np.median(steps)) < np.median(steps) / 2].mean()
    frames, _, info = read(tmp_path / name, fps=taken)
    assert info.rate_from == "given"
    times = np.array([time for time, *_ in frames])
    expected = (np.array(numbers) - numbers[0]) / usual / taken
    assert times == pytest.approx(expected, abs=2e-3 * played / taken)  # Matroska counts milliseconds
    assert info.duration is None or info.duration <= times[-1] + 2.5 / taken * usual


@given(st.integers(50, 500), st.integers(0, 20), st.lists(st.integers(1, 4), min_size=30, max_size=60))
def test_the_usual_interval_bears_gaps_and_a_coarse_clock(interval, offset, steps):
    regular = [1 if k % 3 else step for k, step in enumerate(steps)]  # two thirds of all frames follow at once
    stamps = [offset + interval * int(k) + int(k) % 2 for k in np.cumsum(regular)]
    assert usual_interval(stamps) == pytest.approx(interval, abs=1.1)
    assert usual_interval(stamps[:1]) is None


def test_a_camera_that_says_how_fast_it_was_is_quoted(tmp_path):
    said = {"com.android.capture.fps": "240.000000"}
    phone = slowed(clip(tmp_path / "plain.mp4", 6), tmp_path / "phone.mp4", 1, **said)
    _, (note,), _ = read(phone)
    assert "took 240 frames per second, and the film plays 30: give --fps 240" in note
    assert read(phone, fps=240)[1] == []


def save(image, path):
    Image.fromarray(image).save(path, quality=100) if path.suffix == ".jpg" else Image.fromarray(image).save(path)


def test_a_folder_and_a_pattern_are_films_in_the_order_of_their_numbers(tmp_path):
    folder = tmp_path / "swim"
    folder.mkdir()
    for k in (*range(7, 11), 12, 13):
        save(picture(k), folder / f"cam2-{k}.png")
    for other in (".hidden-3.png", "notes.txt", "cam2.csv"):
        (folder / other).write_text("nothing")
    for path in (folder, folder / "cam2-%d.png"):
        frames, notes, info = read(path, fps=100)
        assert [time for time, *_ in frames] == pytest.approx([0, 0.01, 0.02, 0.03, 0.05, 0.06])
        shown = [error(image, picture(k)) for (_, image, _), k in zip(frames, (7, 8, 9, 10, 12, 13), strict=True)]
        assert shown == [0] * 6
        assert notes == ["1 frame missing between the numbers 10 and 12"]
        assert (info.fps, info.rate_from, info.frame_count) == (100, "given", 6)
        with pytest.raises(VideoError, match="states how many frames"):
            VideoReader(path)
    with pytest.raises(VideoError, match=r"'.*cam2-7\.png' has one frame only; .* which is '.*cam2-%d\.png'"):
        VideoReader(folder / "cam2-7.png", fps=100)
    shutil.copy(folder / "cam2-7.png", folder / "left-7.png")
    with pytest.raises(VideoError, match=r"pictures of several series; give one of them: '.*/cam2-%d\.png', '.*/left-"):
        VideoReader(folder, fps=100)
    with pytest.raises(VideoError, match=r"there is no picture '.*right-%d\.png'"):
        VideoReader(folder / "right-%d.png", fps=100)


def test_a_broken_picture_is_left_out_and_a_smaller_one_is_told(tmp_path):
    for k in range(6):
        save(picture(k) if k != 4 else picture(k)[::2, ::2], tmp_path / f"{k:04d}.jpg")
    (tmp_path / "0002.jpg").write_bytes((tmp_path / "0002.jpg").read_bytes()[:300])
    frames, notes, _ = read(tmp_path, fps=10)
    assert [time for time, *_ in frames] == pytest.approx([0, 0.1, 0.3, 0.4, 0.5])
    assert notes == [
        "1 frame broken and left out, at 0.200 s",
        "1 frame of another size, at 0.400 s; scaled to that of the first",
    ]


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_stack_of_tiff_is_a_film(tmp_path, bits):
    """Gray levels of 12 bits, as cameras write them into 16, aren't dark."""
    gray = [picture(k)[..., 0].astype(int) * (2**bits - 1) // 255 for k in range(5)]
    pages = [Image.fromarray(page.astype(np.uint8 if bits == 8 else np.uint16)) for page in gray]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:])
    frames, notes, info = read(tmp_path / "stack.tif", fps=500)
    assert len(frames) == info.frame_count == 5
    assert all(error(shown, picture(k)[..., :1]) < 1 for k, (_, shown, _) in enumerate(frames))
    assert notes == []
    assert film_name(tmp_path / "stack.tif") == "stack"
    (tmp_path / "stack.tif").rename(tmp_path / "stack1.tif")
    with pytest.raises(VideoError, match=r"stack1\.tif' has 5 pictures; give such a file by itself"):
        VideoReader(tmp_path, fps=1)
