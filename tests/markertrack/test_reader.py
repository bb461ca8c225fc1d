import subprocess
import sys
import wave
from fractions import Fraction

import numpy as np
import pytest
from clips import CORNERS, FPS, clip, error, patched, picture, raw, read

from markertrack.video import VideoReader, VideoWriter, first_frame
from swimbase.errors import VideoError

QUARTER_TURNS = {0: 0, 90: -1, 180: 2, 270: 1}  # np.rot90 turns the other way
IDENTITY = np.array([1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30], ">i4").tobytes()


@pytest.mark.parametrize(
    ("name", "rotation"), [("swim.mp4", 0), ("swim.mp4", 90), ("swim.mov", 180), ("swim.mov", 270)]
)
def test_pictures_are_upright(tmp_path, name, rotation):
    path = clip(tmp_path / name, 6, rotation=rotation)
    frames, notes, info = read(path)
    upright = np.rot90(picture(3), QUARTER_TURNS[rotation])
    assert info.rotation == rotation
    assert (info.height, info.width) == upright.shape[:2]
    assert error(frames[3][1], upright) < 3
    assert notes == []


@pytest.mark.parametrize("matrix", [(1, 0, 0, 1), (0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_pictures_are_turned_and_mirrored_as_players_do(tmp_path, matrix, mirrored):
    """ISO/IEC 14496-12: x' = a x + c y, y' = b x + d y with y down, so (0, 1, -1, 0) turns clockwise."""
    a, b, c, d = (-value if mirrored and k < 2 else value for k, value in enumerate(matrix))
    turned = np.array([a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30], ">i4").tobytes()
    plain = clip(tmp_path / "swim.mp4", 6)
    data = plain.read_bytes()
    place = data.index(IDENTITY, data.index(b"tkhd"))
    plain.write_bytes(data[:place] + turned + data[place + 36 :])
    frames, notes, info = read(plain)
    stored = picture(0)
    height, width = stored.shape[:2] if a else stored.shape[1::-1]
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    columns, rows = a * x + b * y, c * x + d * y  # the inverse of a turn or a mirror is its transpose
    shown = stored[(rows + (stored.shape[0] - 1) / 2).astype(int), (columns + (stored.shape[1] - 1) / 2).astype(int)]
    assert (info.mirrored, bool(notes)) == (mirrored, mirrored)
    assert error(frames[0][1], shown) < 3
    assert error(first_frame(plain).scaled(width), shown) < 3


@pytest.mark.parametrize("rotation", [0, 90])
def test_scaled_pictures_match(tmp_path, rotation):
    frame = first_frame(clip(tmp_path / "swim.mp4", 3, rotation=rotation))
    half = frame.scaled(frame.image.shape[1] // 2)
    whole = frame.image.astype(float)
    blocks = whole.reshape(whole.shape[0] // 2, 2, whole.shape[1] // 2, 2, 3).mean(axis=(1, 3))
    assert half.shape == blocks.shape
    assert np.abs(half - blocks).mean() < 2
    assert half.flags.c_contiguous
    assert half.flags.writeable
    assert frame.image is frame.image
    assert frame.image.dtype == np.uint8
    with pytest.raises(ValueError, match="read-only"):
        frame.image[0, 0] = 0


def test_threads_change_nothing(tmp_path):
    path = clip(tmp_path / "swim.mp4")
    for (time, image, _), (other, same, _) in zip(read(path)[0], read(path, threads=3)[0], strict=True):
        assert time == other
        np.testing.assert_array_equal(image, same)


def test_a_video_can_be_read_again_until_the_reader_is_closed(tmp_path):
    with VideoReader(clip(tmp_path / "swim.mp4")) as reader:
        few = [frame.index for frame, _ in zip(reader, range(5), strict=False)]
        every = list(reader)
        assert [frame.time for frame in reader] == pytest.approx(np.arange(36) / FPS)
        assert reader.notes == []
        frames = iter(reader)
        next(frames)
    assert few == [0, 1, 2, 3, 4]
    assert [frame.index for frame in every] == list(range(36))
    assert error(every[20].image, picture(20)) < 3  # frames outlive the reader
    with pytest.raises(VideoError, match="was closed before its last frame; read it within its `with` block"):
        next(frames)
    with pytest.raises(VideoError, match="is closed; read it within its `with` block"):
        iter(reader)


@pytest.mark.slow
def test_memory_stays_constant(tmp_path):
    """Frames aren't kept: their memory, which FFmpeg holds, is at most that of a few of them."""
    path = tmp_path / "long.mp4"
    with VideoWriter(path, 640, 480, 30) as writer:
        for index in range(70):
            writer.write(picture(index, 640, 480))
    program = (
        "import resource, sys\nfrom markertrack.video import VideoReader\n"
        "def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "with VideoReader(sys.argv[1], threads=1) as reader:\n"
        "    for frame in reader:\n        frame.image\n        if frame.index == 20: before = peak()\n"
        "print((peak() - before) / 1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 20  # MiB; 49 frames take 65 MiB


@pytest.mark.slow
@pytest.mark.parametrize("colors", [1, 9], ids=["BT.709", "BT.2020"])
def test_ten_bits_are_read(tmp_path, colors):
    options = {"x265-params": "log-level=none", "crf": "10"}
    path = raw(tmp_path / "phone.mp4", "libx265", 6, "yuv420p10le", options=options, colors=colors)
    frame = first_frame(path)
    assert frame.image.dtype == np.uint8
    corners = [frame.image[:40, :70], frame.image[:40, 90:], frame.image[56:, :70], frame.image[56:, 90:]]
    for seen, given in zip(corners, CORNERS, strict=True):
        assert np.abs(seen.mean(axis=(0, 1)) - given).max() < 6  # clipped noise


def test_an_edit_list_is_not_an_early_end(tmp_path):
    """A trimmed video keeps its frames in the file; its edit list says which to show."""
    data = bytearray(clip(tmp_path / "swim.mp4", 36, codec="mjpeg").read_bytes())
    duration = data.index(b"elst") + 12
    whole = int.from_bytes(data[duration : duration + 4], "big")
    data[duration : duration + 4] = (whole // 2).to_bytes(4, "big")
    (tmp_path / "trimmed.mp4").write_bytes(data)
    frames, notes, _ = read(tmp_path / "trimmed.mp4")
    assert len(frames) == 18
    assert notes == []


def test_pixels_that_are_not_square_are_named(tmp_path):
    _, notes, _ = read(raw(tmp_path / "wide.mp4", "libx264", 4, pixel_shape=Fraction(4, 3)))
    assert notes == ["the pixels aren't square (4:3); lengths are distorted"]


@pytest.mark.parametrize(("name", "content", "message"), [
    ("swim.mp4", None, r"no video '.*swim\.mp4'; check the path"),
    (".", None, "is a folder without pictures; give the path of a"),
    ("empty.mp4", b"", r"is empty \(0 bytes\); copy it again"),
    ("swim.mp4", b"time,x\n0.0,2\n" * 40, "is not a video"),
    ("swim.csv", b"time,x\n0.0,2\n" * 40, "is not a video"),
])  # fmt: skip
def test_what_is_not_a_video_is_refused(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(VideoError, match=message):
        VideoReader(tmp_path / name)


def test_what_cant_be_decoded_is_refused(tmp_path):
    with wave.open(str(tmp_path / "sound.wav"), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(8000)
        sound.writeframes(bytes(16000))
    unknown = patched(clip(tmp_path / "swim.mp4"), b"avc1", b"zzzz")
    for path, threads, message in (
        (tmp_path / "sound.wav", 0, "has no video in it, only audio"),
        (unknown, 0, "no decoder for the video in '.*'; convert it to H.264, for example"),
        (tmp_path / "swim.mp4", -1, r"threads is -1; it must be 0 \(as many as there are cores\) or more"),
    ):
        with pytest.raises(VideoError, match=message):
            VideoReader(path, threads)
