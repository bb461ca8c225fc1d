import base64
import io
import json
import re
from functools import partial

import numpy as np
import pytest
from PIL import Image

from browser import played
from films import discs
from markertrack.corrections import find_stretches
from markertrack.pages import DOUBTED, EXPECTED, MOST_WITHIN, SURE, make_strips, write_review_page
from markertrack.points import Anchor, load_anchors
from markertrack.track import MarkerTrack

NAMES = ("A", "B", "C", "D")
WIDTH, HEIGHT, FRAMES, BEGIN = 480, 270, 40, 100
COLORS = [(255, 0, 0), (0, 255, 0), (255, 255, 0), (255, 0, 255)]
START = np.array([[100.25, 80.0], [135.0, 80.5], [170.0, 80.0], [420.0, 200.0]])
TRUTH = START + np.arange(FRAMES)[:, None, None] * [1.0, 1.5]

# The eye finds a disc by its color in the picture of a frame; nothing of the page's script is used.
HAND = """
const figures = () => [...document.querySelectorAll("#strip figure")];
const figure = frame => figures().find(figure => figure.querySelector("span").textContent.startsWith(`${frame} `));
const rings = frame => [...figure(frame).querySelectorAll("g > g")]
  .map(group => [group.textContent, ...group.getAttribute("class").trim().split(" ")]);
// loaded before the page is: its clock, which isn't the machine's, doesn't wait for pictures afterwards
const pictures = new Map(JSON.parse(document.getElementById("data").textContent).stretches.flatMap(stretch =>
  stretch.cuts.map(({ picture }) => [picture, Object.assign(new Image(), { src: picture })])));
function see(frame, [r, g, b]) {
  const shown = figure(frame).querySelector("image"), picture = pictures.get(shown.getAttribute("href"));
  const { width: w, height: h } = picture, canvas = document.createElement("canvas"), context = canvas.getContext("2d");
  Object.assign(canvas, { width: w, height: h });
  context.drawImage(picture, 0, 0);
  const data = context.getImageData(0, 0, w, h).data, box = shown.getBoundingClientRect();
  let n = 0, sx = 0, sy = 0;
  for (let y = 0; y < h; y++) for (let x = 0; x < w; x++) {
    const i = 4 * (y * w + x), off = Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b);
    if (off < 150) { n++; sx += x + 0.5; sy += y + 0.5; }
  }
  return [box.left + sx / n * box.width / w, box.top + sy / n * box.height / h];
}
function click(frame, at) {
  const [clientX, clientY] = at.map(Math.round);
  figure(frame).querySelector("svg").dispatchEvent(new MouseEvent("click", { clientX, clientY, bubbles: true }));
}
const point = frame => figure(frame).dispatchEvent(new PointerEvent("pointerenter"));
const count = () => document.getElementById("count").textContent;
const title = () => document.getElementById("title").textContent;
"""


def image(frame):
    return discs(TRUTH[frame], COLORS, (HEIGHT, WIDTH))


def track():
    """B is lost in frames 10 to 21, C beside it doubtful and 8 px off; D is doubtful in the last four frames."""
    positions, confidence = TRUTH.copy(), np.ones((FRAMES, 4))
    positions[10:22, 1], confidence[10:22, 1] = np.nan, 0.0
    positions[10:21, 2] += 8.0
    confidence[10:21, 2] = 0.3
    confidence[36:, 3] = 0.3
    return MarkerTrack(np.arange(FRAMES) / 20, positions, confidence)


def write(path, video="a <swim>.mp4", names=NAMES, most=40, **options):
    strips = make_strips(track(), find_stretches(track())[:most], WIDTH, HEIGHT)
    for cut in (cut for strip in strips for cut in strip.cuts):
        cut.show(image(cut.frame), (BEGIN + cut.frame) / 20)
    return write_review_page(path, video, names, WIDTH, HEIGHT, strips, first_frame=BEGIN, **options)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    command = "swim2real track 'a <swim>.mp4' --corrections 'a <swim>.corrections.json'"
    return write(tmp_path_factory.mktemp("page") / "review.html", command=command)


@pytest.fixture
def play(page, tmp_path):
    return partial(played, page, tmp_path / "played.html", f"const COLORS = {json.dumps(COLORS)};\n{HAND}")


def read(text, path):
    path.write_text(text, encoding="utf-8")
    return {anchor.frame: anchor for anchor in load_anchors(path, NAMES, WIDTH, HEIGHT, "a <swim>.mp4")}


def picture(source):
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(source.split(",")[1]))))


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page.read_text(encoding="utf-8")).group(1))


@pytest.mark.slow
@pytest.mark.parametrize("window", ["1400,860", "500,900"])
def test_what_is_clicked_is_read_back(play, tmp_path, window):
    result = play(
        """
        said.push(title());
        for (const frame of [110, 117]) click(frame, see(frame, COLORS[1]));
        point(114); key("h");                                  // B is hidden there
        key("2");                                              // the other marker of this stretch
        click(117, see(117, COLORS[2]));
        point(122); figure(122).querySelector("button").click();
        key("n"); said.push(title());
        const away = see(139, COLORS[3]);
        click(139, [away[0] - 40, away[1]]); click(139, away);  // a second click moves it
        key("p"); said.push(title(), count(), rings(117));
        press("download");
        """,
        window,
    )
    assert result["names"] == ["a <swim>.corrections.json"]
    assert result["said"][:3] == [
        "B and C: lost frames 110 to 121, 5.50 to 6.05 s",
        "D: doubtful frames 136 to 139, 6.80 to 6.95 s",
        "B and C: lost frames 110 to 121, 5.50 to 6.05 s",
    ]
    assert result["said"][3] == "7 clicks; 4 placed, 2 hidden"
    assert sorted(result["said"][4]) == [
        ["A", "other", "sure"], ["B", "mine"], ["B", "mine", "expected", "settled"], ["C", "own"],
        ["C", "own", "doubted", "settled"],
    ]  # fmt: skip
    anchors = read(result["files"][0], tmp_path / "c.json")
    placed = {(f, NAMES[m]) for f, a in anchors.items() for m in np.flatnonzero(np.isfinite(a.points[:, 0]))}
    assert placed == {(110, "B"), (117, "B"), (117, "C"), (139, "D")}
    assert {(f, NAMES[m]) for f, a in anchors.items() for m in np.flatnonzero(a.hidden)} == {(114, "B"), (122, "C")}
    for frame, name in placed:
        marker = NAMES.index(name)
        np.testing.assert_allclose(anchors[frame].points[marker], TRUTH[frame - BEGIN, marker], atol=0.5)


@pytest.mark.slow
def test_undo_keys_and_what_is_refused(play, tmp_path):
    result = play(
        """
        press("download"); said.push(alert_());
        key("h"); said.push(alert_());                         // in which frame?
        press("undo"); said.push(alert_());
        const b = see(117, COLORS[1]);
        click(117, b); key("2"); click(117, b);                // two markers on the same spot
        press("copy"); said.push(alert_());
        key("Backspace");
        key("1"); key("ArrowRight"); key("ArrowRight"); key("ArrowDown", { shiftKey: true });
        key("n"); key("z", { ctrlKey: true }); said.push(title());  // nudges are one step, and in the first stretch
        key("ArrowLeft"); said.push(alert_());                 // no frame is pointed at after moving on
        point(117); key("ArrowLeft");
        const svg = figure(114).querySelector("svg");
        point(114);
        svg.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));  // where it is expected
        key("2"); svg.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true })); key("Delete");
        document.getElementById("others").value = "0";
        document.getElementById("others").dispatchEvent(new Event("change"));
        click(117, see(117, COLORS[0]));
        press("download");
        """
    )
    assert result["said"][:4] == [
        "Nothing is corrected yet. Nothing was downloaded.",
        "Point at a frame first.",
        "There is nothing to undo.",
        "B and C are on the same spot in frame 117: move one of them. Nothing was copied.",
    ]
    assert result["said"][4].startswith("B and C: lost")
    assert result["said"][5] == "Point at a frame first."
    anchors = read(result["files"][0], tmp_path / "c.json")
    assert sorted(anchors) == [114, 117]
    np.testing.assert_allclose(anchors[117].points[1] + [0.5, 0], TRUTH[17, 1], atol=0.5)
    np.testing.assert_allclose(anchors[117].points[0], TRUTH[17, 0], atol=1.5)  # cut off by the picture's edge
    np.testing.assert_allclose(anchors[114].points[1], TRUTH[14, 1], atol=0.1)
    assert np.isnan(anchors[114].points[2]).all()


@pytest.mark.slow
def test_earlier_corrections_stay_in_the_file(tmp_path):
    points = np.full((4, 2), np.nan)
    points[0] = [11.5, 12.25]
    earlier = Anchor(7, points, np.array([False, True, False, False]))
    page = write(tmp_path / "review.html", anchors=[earlier])
    result = played(page, tmp_path / "played.html", HAND, 'press("download"); said.push(count());')
    (anchor,) = read(result["files"][0], tmp_path / "c.json").values()
    assert anchor.frame == 7
    np.testing.assert_array_equal(anchor.points, earlier.points)
    np.testing.assert_array_equal(anchor.hidden, earlier.hidden)
    assert result["said"] == ["0 clicks; 1 placed, 1 hidden"]


def test_the_page_is_one_file_that_holds_the_pictures(page):
    text, data = page.read_text(encoding="utf-8"), data_of(page)
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)|@@[A-Z]+@@", text)
    assert "<title>Correct the track of a &lt;swim&gt;.mp4" in text
    assert "a <swim>" not in text
    assert data["command"].endswith("--corrections 'a <swim>.corrections.json'")
    cut = data["stretches"][0]["cuts"][1]
    left, top, width, height = cut["box"]
    seen = image(cut["frame"] - BEGIN)[top : top + height, left : left + width]
    assert np.abs(picture(cut["picture"]).astype(int) - seen).mean() < 4
    assert [p.name for p in page.parent.iterdir()] == ["review.html"]


def test_a_page_says_how_many_stretches_it_leaves_out(tmp_path, monkeypatch):
    assert data_of(write(tmp_path / "a.html", most=1, more=4))["more"] == 4
    monkeypatch.setattr("markertrack.pages.MOST_BYTES", 10)
    data = data_of(write(tmp_path / "b.html", more=4))
    assert (len(data["stretches"]), data["more"]) == (1, 5)


def test_a_strip_shows_the_stretch_and_the_frames_beside_it():
    (both, last) = make_strips(track(), find_stretches(track()), WIDTH, HEIGHT)
    frames = [cut.frame for cut in both.cuts]
    assert (frames[0], frames[1], frames[-2], frames[-1]) == (9, 10, 21, 22)
    assert len(frames) == MOST_WITHIN + 2
    assert [cut.frame for cut in last.cuts] == [35, 36, 37, 38, 39]
    for strip in (both, last):
        for cut in strip.cuts:
            left, top, width, height = cut.box
            assert 0 <= left <= left + width <= WIDTH
            assert 0 <= top <= top + height <= HEIGHT
            for marker in strip.stretch.markers:  # with room around it, but at the film's edge
                x, y = TRUTH[cut.frame, marker] - [left, top]
                assert 20 <= x <= width - 20
                assert 9 <= y <= height - 9
    states = {mark.marker: mark.state for mark in both.cuts[3].marks}
    assert states == {0: SURE, 1: EXPECTED, 2: DOUBTED} | ({3: SURE} if 3 in states else {})
