"""A real browser plays what the writer writes, and turns it as the reader does."""

import base64
import json
import re

import numpy as np
import pytest
from clips import clip, first_frame_corners

from browser import opened

PAGE = """<video id="video" muted></video><pre id="answer"></pre><script>
const video = document.getElementById("video"), answer = document.getElementById("answer");
// the browser's virtual time would run out before the video has played in real time
const busy = setInterval(() => { for (let i = 0, sum = 0; i < 1e7; i++) sum += i; }, 20);
video.onerror = () => { clearInterval(busy); answer.textContent = JSON.stringify({error: video.error.message}); };
video.onloadeddata = () => {
  const canvas = document.createElement("canvas"), width = video.videoWidth, height = video.videoHeight;
  canvas.width = width; canvas.height = height;
  const pen = canvas.getContext("2d");
  const at = (x, y) => Array.from(pen.getImageData(x, y, 1, 1).data.slice(0, 3));
  video.onended = () => {
    pen.drawImage(video, 0, 0);
    const corners = [at(5, 5), at(width - 6, 5), at(5, height - 6), at(width - 6, height - 6)];
    clearInterval(busy);
    answer.textContent = JSON.stringify({width, height, corners, duration: video.duration, time: video.currentTime});
  };
  video.play();
};
video.src = "data:video/mp4;base64,DATA";
</script>"""


@pytest.mark.slow
@pytest.mark.parametrize("rotation", [0, 90, 180, 270])
def test_a_browser_plays_the_video_upright(tmp_path, rotation):
    path, page = clip(tmp_path / "swim.mp4", 15, rotation=rotation), tmp_path / "page.html"
    page.write_text(PAGE.replace("DATA", base64.b64encode(path.read_bytes()).decode()))
    answer = json.loads(re.findall(r'<pre id="answer">(.*?)</pre>', opened(page)[0])[0])
    if "error" in answer:
        pytest.skip(f"this Chromium doesn't play H.264: {answer['error']}")
    shape, corners = first_frame_corners(path)
    assert (answer["height"], answer["width"]) == shape
    assert np.abs(np.array(answer["corners"]) - corners).max() <= 12
    assert answer["duration"] == pytest.approx(0.5, abs=0.01)
    assert answer["time"] == pytest.approx(0.5, abs=0.01)
