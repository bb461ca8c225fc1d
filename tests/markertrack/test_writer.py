import re

import numpy as np
import pytest
from clips import FPS, HEIGHT, WIDTH, clip, error, picture, read

from markertrack.video import VideoReader, VideoWriter
from swimbase.errors import VideoError

FORMATS = [
    ("swim.mp4", "h264"), ("swim.mkv", "h264"), ("swim.ts", "h264"), ("swim.avi", "h264"), ("swim.mov", "hevc"),
    ("swim.mov", "mjpeg"), ("swim.avi", "mjpeg"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "codec"), FORMATS)
def test_pictures_and_times_come_back(tmp_path, name, codec):
    frames, notes, info = read(clip(tmp_path / name, codec=codec))
    assert len(frames) == 36
    for index, (time, image, intact) in enumerate(frames):
        assert time == pytest.approx(index / FPS, abs=0.6e-3)  # Matroska counts milliseconds
        assert error(image, picture(index)) < 3.0
        assert intact
    assert (info.width, info.height, info.fps, info.codec) == (WIDTH, HEIGHT, FPS, codec)
    assert info.frame_count == 36
    assert info.duration == pytest.approx(36 / FPS, abs=1e-3)
    assert notes == []


@pytest.mark.parametrize("codec", ["h264", "hevc", "mjpeg"])
def test_colors_come_back(tmp_path, codec):
    colors = np.array(
        [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [255, 255, 255], [0, 0, 0], [128, 128, 128], [90, 9, 50]]
    )
    bars = np.repeat(np.repeat(colors[None].astype(np.uint8), 64, axis=0), 16, axis=1)
    frames, _, _ = read(clip(tmp_path / "bars.mp4", 3, lambda index: bars, codec=codec, crf=8))
    assert np.abs(frames[1][1][32, 8::16] - colors).max() <= 4


def test_times_make_a_variable_frame_rate(tmp_path):
    times = np.cumsum([0, 0.033, 0.034, 0.1, 0.008, 0.0041, 0.5, 0.033])
    with VideoWriter(tmp_path / "swim.mp4", WIDTH, HEIGHT, 29.97) as writer:
        for index, time in enumerate(times):
            writer.write(picture(index), time)
        writer.write(picture(8))  # without a time: one interval later
    frames, notes, _ = read(tmp_path / "swim.mp4")
    np.testing.assert_allclose([frame[0] for frame in frames], [*times, times[-1] + 1 / 29.97], atol=2e-5)
    assert all(error(image, picture(index)) < 3 for index, (_, image, _) in enumerate(frames))
    assert notes == []
    data = (tmp_path / "swim.mp4").read_bytes()
    assert 0 < data.index(b"moov") < data.index(b"mdat")  # plays while it loads


def test_the_file_appears_at_the_end_and_an_error_leaves_what_was_there(tmp_path):
    path, part = tmp_path / "swim.mp4", tmp_path / "swim.mp4.part"
    with VideoWriter(path, WIDTH, HEIGHT, 30) as writer:
        writer.write(picture())
        assert part.exists()
        assert not path.exists()
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), VideoWriter(path, WIDTH, HEIGHT, 30) as writer:  # noqa: PT012
        writer.write(picture())
        _ = 1 / 0
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("codec", ["h264", "mjpeg"])
def test_odd_sizes_get_their_last_row_and_column_twice(tmp_path, codec):
    def odd(index):
        image = np.full((97, 161, 3), 60, np.uint8)
        image[-1], image[:, -1] = 220, 220
        return image

    frames, _, info = read(clip(tmp_path / "odd.mp4", 3, odd, codec=codec, crf=5))
    assert (info.width, info.height) == (162, 98)
    image = frames[0][1]
    assert np.abs(image[-2:] - 220).max() < 25
    assert np.abs(image[:, -2:] - 220).max() < 25
    assert np.abs(image[:-4, :-4] - 60).max() < 25


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"path": "nowhere/swim.mp4"}, r"no folder '.*nowhere'"), ({"path": "folder.mp4"}, "it is a folder"),
        ({"path": "swim.gif"}, r"its ending must be one of \.mp4, \.mov"), ({"width": 0}, "0 x 96 px; both must be"),
        ({"path": "taken.mp4"}, r"taken\.mp4' can't be written: Is a directory"),  # also for the superuser
        ({"fps": 0}, "fps is 0; it must lie within"), ({"fps": float("nan")}, "fps is nan; it must lie within"),
        ({"codec": "divx"}, "codec is 'divx'; it must be one of h264, hevc, mjpeg"),
        ({"crf": 60}, "crf is 60; it must lie within 0"), ({"rotation": 45}, "rotation is 45; it must be 0, 90"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused(tmp_path, changes, message):
    for folder in ("folder.mp4", "taken.mp4.part"):
        (tmp_path / folder).mkdir()
    given = {"path": "swim.mp4", "width": 160, "height": 96, "fps": 30, **changes}
    with pytest.raises(VideoError, match=message):
        VideoWriter(tmp_path / given.pop("path"), **given)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("image", [np.zeros((96, 161, 3), "u1"), np.zeros((96, 160), "u1"), np.zeros((96, 160, 3))])
def test_wrong_pictures_are_refused(tmp_path, image):
    said = rf"shape {re.escape(str(image.shape))} of {image.dtype}"
    with pytest.raises(VideoError, match=said), VideoWriter(tmp_path / "swim.mp4", 160, 96, 30) as writer:
        writer.write(image)
    assert list(tmp_path.iterdir()) == []


def test_times_must_rise_and_avi_takes_none(tmp_path):
    with VideoWriter(tmp_path / "swim.mp4", WIDTH, HEIGHT, 30) as writer:
        writer.write(picture(), 0.2)
        for time in (0.2, -1.0, float("nan")):
            with pytest.raises(VideoError, match=rf"is {time} s; .* after the last \(0\.200000 s\)"):
                writer.write(picture(), time)
    with pytest.raises(VideoError, match="is closed; write within its `with` block"):
        writer.write(picture())
    avi = VideoWriter(tmp_path / "swim.avi", WIDTH, HEIGHT, 30, codec="mjpeg")
    with pytest.raises(VideoError, match=r"AVI has a constant frame rate; write \.mp4 or \.mkv"), avi as writer:
        writer.write(picture(), 0.0)
    with pytest.raises(VideoError, match="no picture was written to"), VideoWriter(tmp_path / "a.mp4", 160, 96, 30):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["swim.mp4"]


@pytest.mark.parametrize("codec", ["h264", "hevc", "mjpeg"])
def test_nothing_is_printed(tmp_path, capfd, codec):
    path = clip(tmp_path / "swim.mp4", codec=codec)
    data = bytearray(path.read_bytes())
    middle = data.index(b"mdat") + len(data) // 3
    data[middle : middle + 200] = bytes(200)
    path.write_bytes(data)
    with VideoReader(path) as reader:
        for _ in reader:
            pass
    out = capfd.readouterr()
    assert (out.out, out.err) == ("", "")
