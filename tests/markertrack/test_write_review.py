import base64
import io
import json
import re

import numpy as np
import pytest
from PIL import Image

from markertrack.following import write_review
from markertrack.track import MarkerTrack
from markertrack.video import VideoWriter

SIZE, LENGTH, BEGIN = (160, 96), 30, 8


def place(frame):
    return np.array([20.0 + 3 * frame, 40.0])


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A white dot on black that moves by 3 px a frame."""
    path = tmp_path_factory.mktemp("film") / "dot.mp4"
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    with VideoWriter(path, *SIZE, fps=25) as writer:
        for frame in range(LENGTH):
            cover = np.clip(5.5 - np.hypot(*(np.stack([x, y], axis=2) - place(frame)).transpose(2, 0, 1)), 0, 1)
            writer.write(np.repeat(np.round(255 * cover)[..., None], 3, axis=2).astype(np.uint8))
    return path


def track(*lost, begin=BEGIN):
    positions = np.array([[place(frame)] for frame in range(begin, LENGTH)])
    positions[list(lost)] = np.nan
    return MarkerTrack(np.arange(len(positions)) / 25, positions)


def test_frames_are_those_of_the_video_and_none_are_written_where_nothing_is_doubtful(video, tmp_path):
    page = write_review(video, track(*range(5, 12)), ("dot",), tmp_path / "r.html", BEGIN, "swim2real track …")
    data = json.loads(re.search(r'id="data">(.*?)</script>', page.read_text(encoding="utf-8")).group(1))
    assert (data["video"], data["width"], data["height"], data["command"]) == ("dot.mp4", *SIZE, "swim2real track …")
    (stretch,) = data["stretches"]
    assert (stretch["first"], stretch["last"], stretch["reason"]) == (13, 19, "lost")
    assert [cut["frame"] for cut in stretch["cuts"]] == list(range(12, 21))
    for cut in stretch["cuts"]:
        assert cut["time"] == pytest.approx(cut["frame"] / 25, abs=1e-6)
        left, top, *_ = cut["box"]
        picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(cut["picture"].split(",")[1]))).convert("L"))
        y, x = np.nonzero(picture > 128)
        np.testing.assert_allclose([left + x.mean(), top + y.mean()], place(cut["frame"]), atol=0.6)
        ((_, mx, my, state),) = cut["marks"]
        np.testing.assert_allclose([mx, my], place(cut["frame"]), atol=0.01)  # straight on while it is lost
        assert state == (0 if 13 <= cut["frame"] <= 19 else 2)
    page.unlink()
    assert write_review(video, track(), ("dot",), tmp_path / "r.html", BEGIN, "") is None
    assert not list(tmp_path.iterdir())
