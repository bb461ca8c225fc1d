"""A video read from one of its frames back to an earlier one."""

import numpy as np
import pytest
from clips import HEIGHT, WIDTH, clip, noisy, raw

from markertrack.video import VideoReader, frames_backwards, reader
from swimbase.errors import VideoError

COUNT = 23
BYTES = int(1.5 * WIDTH * HEIGHT)  # of a decoded frame


@pytest.fixture(scope="module", params=["few key frames", "no key frame after the first, frames stored out of order"])
def video(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("backwards")
    if request.param == "few key frames":
        return clip(folder / "film.mp4", COUNT, show=noisy)
    return raw(folder / "film.mkv", "libx264", COUNT, options={"g": "250", "bf": "3", "preset": "ultrafast"})


def shown(frames):
    return [(frame.index, frame.time, frame.intact, frame.image) for frame in frames]


@pytest.mark.parametrize(("first", "last"), [(0, COUNT - 1), (4, 16), (7, 7), (0, 0)])
@pytest.mark.parametrize("part", [1, 5, 1000])
def test_the_same_frames_come_in_reverse_order(video, monkeypatch, part, first, last):
    monkeypatch.setattr(reader, "MOST_BYTES", part * BYTES + BYTES // 2)
    with VideoReader(video, threads=1) as film:
        forward = shown(frame for frame in film if first <= frame.index <= last)
    found = shown(frames_backwards(video, first, last, threads=1))
    assert [frame[:3] for frame in found] == [frame[:3] for frame in reversed(forward)]
    for (*_, image), (*_, other) in zip(found, reversed(forward), strict=True):
        np.testing.assert_array_equal(image, other)


def test_no_more_frames_are_kept_than_there_is_room_for(video, monkeypatch, tmp_path):
    """Each part is decoded from the beginning to its end: 23 + 18 + 13 + 8 + 3 frames of parts of 5."""
    read = []

    class Counted(VideoReader):
        def __iter__(self):
            for frame in super().__iter__():
                read.append(frame.index)
                yield frame

    monkeypatch.setattr(reader, "VideoReader", Counted)
    monkeypatch.setattr(reader, "MOST_BYTES", 5 * BYTES)
    frames = frames_backwards(video, 0, COUNT - 1, threads=1)
    assert next(frames).index == COUNT - 1
    assert len(read) == COUNT
    assert [frame.index for frame in frames] == list(range(COUNT - 2, -1, -1))
    assert len(read) == 23 + 18 + 13 + 8 + 3
    assert list(frames_backwards(video, 5, 4)) == []
    with pytest.raises(VideoError, match=r"none\.mp4"):
        next(frames_backwards(tmp_path / "none.mp4", 0, 3))
