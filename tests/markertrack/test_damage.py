import shutil
from functools import cache

import av
import numpy as np
import pytest
from av import VideoFrame
from clips import FPS, clip, cut, damage, error, noisy, packets, raw, read

from markertrack.video import VideoReader
from markertrack.video.damage import marked
from markertrack.video.decoding import Picture
from swimbase.errors import VideoError

QUIET = {"x265-params": "log-level=none"}
OPTIONS = {"libx264": {}, "libx265": QUIET, "mjpeg": {}}


def _made(path, encoder, options, **more):
    pixels = "yuvj420p" if encoder == "mjpeg" else "yuv420p"
    return raw(path, encoder, pixels=pixels, options={"g": "12", **options}, colors=5 if "j" in pixels else 1, **more)


def _numbers(frames):
    return [round(time * FPS) for time, _, _ in frames]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Makes a video of an encoder once, and copies it into a folder; gives its path and its frames."""

    @cache
    def made(name, encoder):
        path = _made(tmp_path_factory.mktemp(encoder) / name, encoder, OPTIONS[encoder])
        return path, read(path)[0]

    def copied(folder, name, encoder):
        path, frames = made(name, encoder)
        return shutil.copy(path, folder / name), frames

    return copied


BROKEN = [("swim.mp4", "libx264", packet, 4) for packet in (14, 15, 16, 18)]
BROKEN += [("swim.mp4", "libx264", 16, 1), ("swim.mp4", "libx265", 17, 1), ("swim.avi", "mjpeg", 16, 4)]


@pytest.mark.parametrize(("name", "encoder", "packet", "threads"), BROKEN)
def test_a_broken_frame_is_left_out(tmp_path, whole, name, encoder, packet, threads):
    path, frames = whole(tmp_path, name, encoder)
    whole = dict(enumerate(frames))
    frames, notes, _ = read(damage(path, packet), threads=threads)
    missing = sorted(set(whole) - set(_numbers(frames)))
    assert len(missing) == 1 or encoder == "libx265"  # whose decoder gives up those that lean on it as well
    assert any(f"broken and left out, at {missing[0] / FPS:.3f}" in note for note in notes) or len(missing) > 4
    for number, (time, image, intact) in zip(_numbers(frames), frames, strict=True):
        assert time == pytest.approx(whole[number][0])
        if intact:
            assert error(image, whole[number][1]) < 0.1
    smeared = [time for time, _, intact in frames if not intact]
    if encoder == "mjpeg":
        assert not smeared
    if smeared:
        assert notes[-1].startswith(f"{len(smeared)} frame")
        assert "after a broken one may be smeared" in notes[-1]
        assert max(smeared) < 24 / FPS  # a key frame
    assert all(intact for time, _, intact in frames if time > 23.5 / FPS)


def test_pictures_that_lean_on_a_broken_one_are_marked(tmp_path):
    """Without frames in both directions, everything up to the next key frame is smeared."""
    path = _made(tmp_path / "swim.mp4", "libx264", {"bf": "0", "sc_threshold": "0"})
    whole = read(path)[0]
    frames, _, _ = read(damage(path, 15, (0.3, 0.7)))
    worse = [n for n, (_, image, _) in zip(_numbers(frames), frames, strict=True) if error(image, whole[n][1]) > 0.5]
    assert worse == list(range(16, 24))
    assert [n for n, (_, _, intact) in zip(_numbers(frames), frames, strict=True) if not intact] == worse


@pytest.mark.parametrize(
    ("name", "encoder", "threads"),
    [("swim.mp4", "libx264", 1), ("swim.mkv", "libx264", 4), ("swim.mp4", "libx265", 4), ("swim.avi", "mjpeg", 4)],
)  # fmt: skip
def test_a_video_that_ends_early_gives_what_it_has(tmp_path, whole, name, encoder, threads):
    path, known = whole(tmp_path, name, encoder)
    frames, notes, _ = read(cut(path, 0.6), threads=threads)
    assert 12 < len(frames) < 30
    for number, (_, image, _) in zip(_numbers(frames), frames, strict=True):
        assert error(image, known[number][1]) < 0.1
    early = [note for note in notes if note.startswith("the video ends early: the file says ")]
    assert len(early) == 1
    assert ("36 frames" in early[0]) or ("1.200 s" in early[0])


def test_a_stream_that_is_cut_or_begins_in_the_middle_is_read(tmp_path):
    """MPEG-TS doesn't say how long it is."""
    path = raw(tmp_path / "swim.ts", "libx264", options={"g": "12"})
    whole, data = read(path)[0], path.read_bytes()
    frames, notes, _ = read(cut(path, (packets(path)[20][0] + 500) / len(data)))
    assert 15 < len(frames) < 25
    assert all(error(image, whole[n][1]) < 0.1 for n, (_, image, _) in zip(_numbers(frames), frames, strict=True))
    assert any("broken and left out" in note for note in notes)
    (tmp_path / "later.ts").write_bytes(data[188 * (len(data) // 188 // 4) :])
    frames, _, _ = read(tmp_path / "later.ts")
    assert frames[0][0] == 0.0
    assert len(frames) == 24
    assert error(frames[0][1], noisy(12)) < 8


def test_an_index_or_frames_that_are_not_there_are_named(tmp_path):
    data = clip(tmp_path / "swim.mp4").read_bytes()
    with av.open(str(tmp_path / "late.mp4"), "w") as late, av.open(str(tmp_path / "swim.mp4")) as early:
        stream = late.add_stream_from_template(early.streams.video[0])
        for packet in early.demux(video=0):
            if packet.size:
                packet.stream = stream
                late.mux(packet)
    (tmp_path / "head.mp4").write_bytes(data[:100])  # cut within the index
    (tmp_path / "swim.mp4").write_bytes(data[: data.index(b"mdat") + 4])
    for path, message in (
        (cut(tmp_path / "late.mp4", 0.7), r"ends before its index \(the 'moov' box\)|it was cut off: copy it again"),
        (tmp_path / "head.mp4", "it was cut off: copy it again"),
        (tmp_path / "swim.mp4", "not one frame of '.*' can be decoded; it is cut off or damaged"),
    ):
        with pytest.raises(VideoError, match=message):
            VideoReader(path)


def _restamped(path, stamps):
    """A Matroska file, in milliseconds, of key frames with these time stamps."""
    return read(raw(path, "mjpeg", len(stamps), "yuvj420p", lambda index: stamps[index], colors=5))


def test_time_stamps_that_do_not_rise_are_mended_and_gaps_named(tmp_path):
    frames, notes, _ = _restamped(tmp_path / "swim.mkv", [0, 1, 2, 2, 4, 3, 6, 7])
    times = np.array([frame[0] for frame in frames])
    assert np.all(np.diff(times) > 0)
    good = np.array([0, 1, 2, 4, 6, 7])
    np.testing.assert_allclose(times[good], good / FPS, atol=1e-3)
    assert times[3] == pytest.approx(2.5 / FPS, abs=2e-3)
    assert len(notes) == 1
    assert notes[0].startswith("2 frames with a time stamp that doesn't come after the one before, at 0.08")
    frames, notes, _ = _restamped(tmp_path / "swim.mkv", [*range(10), *range(100, 110)])
    assert frames[10][0] == pytest.approx(100 / FPS, abs=1e-3)
    assert notes == ["no frames for more than 1 s after the one at 0.300 s"]


def test_joined_videos_run_on(tmp_path):
    """Cameras split long recordings; joined byte by byte, their time stamps begin anew."""
    one = raw(tmp_path / "one.ts", "libx264", options={"g": "12"})
    two = clip(tmp_path / "two.ts", 36, lambda index: noisy(index)[:64, :128])
    (tmp_path / "both.ts").write_bytes(one.read_bytes() + two.read_bytes())
    frames, notes, info = read(tmp_path / "both.ts")
    first = len(frames) - 36
    assert 34 <= first <= 36  # packet counters jump at the joint, so the last frames may count as damaged
    np.testing.assert_allclose([frame[0] for frame in frames], np.arange(len(frames)) / FPS, atol=1e-4)
    assert {frame[1].shape for frame in frames} == {(info.height, info.width, 3)}
    start, end = first / FPS, (len(frames) - 1) / FPS
    assert f"the time stamps begin anew at {start:.3f} s; joined without a gap" in notes
    assert f"36 frames of another size, from {start:.3f} to {end:.3f} s; scaled to that of the first" in notes


def drifting(index: int, speed: int = 37) -> np.ndarray:
    """A textured ground that drifts by 1 px a frame, and a bar that moves by more than its width [px a frame]."""
    grain = np.random.default_rng(0).normal(0, 1, (140, 260))
    smooth = sum(np.roll(grain, (i, j), (0, 1)) for i in range(-3, 4) for j in range(-3, 4)) * 3 + 120
    image = smooth[20:116, 40 + index : 200 + index].clip(0, 255).astype(np.uint8)
    left = 20 + speed * index % 120
    image[30:60, left : left + 10] = 250
    return np.repeat(image[:, :, None], 3, axis=2)


def judged(images, stamps=None) -> list[int]:
    """Numbers of the pictures that look damaged."""
    pictures = (
        Picture(VideoFrame.from_ndarray(image, format="rgb24").reformat(format="yuv420p"), stamp, True, 0)
        for image, stamp in zip(images, stamps or range(len(images)), strict=True)
    )
    found = list(marked(pictures))
    assert [picture.stamp for picture in found] == list(stamps or range(len(images)))
    return [i for i, picture in enumerate(found) if picture.odd]


@pytest.mark.parametrize("harm", ["gray", "earlier"])
def test_a_picture_that_differs_from_both_its_neighbors_is_odd(harm):
    assert judged([drifting(i) for i in range(24)]) == []  # however fast the bar is
    images = [drifting(i, 0) for i in range(24)]
    assert judged(images) == []
    images[12][48:96] = 128 if harm == "gray" else images[4][48:96]
    assert judged(images) == [12]


def test_motion_that_sets_in_a_step_in_time_and_few_pictures_are_no_damage():
    for count in (1, 2, 5):
        assert judged([drifting(i) for i in range(count)]) == []
    still = [drifting(0)] * 12
    assert judged([*still, *(drifting(i) for i in range(1, 13))]) == []
    jumps = [drifting(i) for i in [*range(8), *range(12, 22)]]  # four are missing
    assert judged(jumps, [*range(8), *range(12, 22)]) == []


def test_what_looks_damaged_is_not_intact_and_told(tmp_path):
    path = tmp_path / "swim.avi"
    raw(path, "mjpeg", pixels="yuvj420p", colors=5)
    frames, notes, _ = read(damage(path, 20))
    whole, _, _ = read(raw(tmp_path / "whole.avi", "mjpeg", pixels="yuvj420p", colors=5))
    shown = {round(time * FPS): (image, intact) for time, image, intact in frames}
    wrong = [i for i, (image, _) in shown.items() if error(image, whole[i][1]) > 3]
    assert all(not shown[i][1] for i in wrong)
    assert all(intact for i, (_, intact) in shown.items() if i not in wrong)
    assert (20 not in shown) or any("1 frame that may be damaged, by what they show, at 0.667 s" in n for n in notes)
