import base64
import hashlib
import io
import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import swim2real
from browser import played
from films import discs
from markertrack.pages import write_pick_page
from markertrack.points import load_points
from swimbase.errors import ArgumentError, TrackingError

NAMES = ("M0", "M1", "M2", "M3")
WIDTH, HEIGHT = 640, 360
TARGETS = np.array([[100.0, 80.0], [300.25, 200.5], [330.5, 211.0], [620.0, 340.0]])
COLORS = [(255, 0, 0), (0, 255, 0), (255, 255, 0), (255, 0, 255)]

# What a hand and an eye do. The eye finds each disc by its color on the canvas; nothing of the page's script is used.
HAND = """
const canvas = document.querySelector("canvas[tabindex]");
const drawn = () => new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)));
function pixels() {  // of a copy, since reading makes a browser treat a canvas differently
  const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
  const context = copy.getContext("2d", { willReadFrequently: true });
  for (const layer of document.querySelectorAll("#stage canvas")) context.drawImage(layer, 0, 0);
  return context.getImageData(0, 0, copy.width, copy.height).data;
}
function send(type, [x, y], more = {}) {
  const box = canvas.getBoundingClientRect(), kind = type === "wheel" ? WheelEvent : PointerEvent;
  canvas.dispatchEvent(new kind(type, { clientX: box.left + x, clientY: box.top + y, pointerId: 1, pointerType: "mouse",
    bubbles: true, cancelable: true, ...more }));
}
const click = (p, more) => { send("pointerdown", p, more); send("pointerup", p, more); };
function drag([ax, ay], [bx, by], more) {
  send("pointerdown", [ax, ay], more);
  for (let i = 1; i <= 8; i++) send("pointermove", [ax + (bx - ax) * i / 8, ay + (by - ay) * i / 8], more);
  send("pointerup", [bx, by], more);
}
const rows = () => [...document.querySelectorAll("#list button span")].map(span => span.textContent);
// mean place of a color in CSS pixels; the corners where the magnifier may be are left out
async function see([r, g, b], corners = innerWidth < 620 ? 120 : 170) {
  send("pointerleave", [0, 0]);
  await drawn();
  const { width: w, height: h } = canvas, ratio = devicePixelRatio, data = pixels();
  let n = 0, sx = 0, sy = 0;
  for (let y = 0; y < h; y++) for (let x = 0; x < w; x++) {
    if (y < corners * ratio && (x < corners * ratio || x > w - corners * ratio)) continue;
    const i = 4 * (y * w + x);
    const off = Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b);
    if (off < 120 && data[i + 3] > 200) {
      n += 1; sx += x + 0.5; sy += y + 0.5;
    }
  }
  return n ? [Math.round(sx / n / ratio), Math.round(sy / n / ratio)] : null;  // events take whole CSS pixels
}
const middle = () => [canvas.clientWidth / 2 | 0, canvas.clientHeight / 2 | 0];
async function closer(color) {  // zooms in by the wheel and brings a disc to the middle
  const p = await see(color);
  send("wheel", p, { deltaY: -150 }); send("wheel", p, { deltaY: -180 }); send("wheel", p, { deltaY: -180 });
  drag(p, middle());
  return see(color);
}
"""


def first_frame():
    return discs(TARGETS, COLORS, (HEIGHT, WIDTH))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return write_pick_page(first_frame(), NAMES, "a <swim>.mp4", tmp_path_factory.mktemp("page") / "pick.html")


@pytest.fixture
def play(page, tmp_path):
    return partial(played, page, tmp_path / "played.html", f"const COLORS = {json.dumps(COLORS)};\n{HAND}")


def points_of(text, path):
    path.write_text(text, encoding="utf-8")
    return load_points(path, NAMES, WIDTH, HEIGHT).points


@pytest.mark.slow
@pytest.mark.parametrize("window", ["1400,860", "500,900"])
def test_clicks_after_zoom_and_pan_are_points_of_the_frame(play, tmp_path, window):
    result = play(
        """
        for (const color of COLORS) { click(await closer(color)); press("fit"); }
        press("download");
        """,
        window,
    )
    assert result["names"] == ["a <swim>.points.json"]
    np.testing.assert_allclose(points_of(result["files"][0], tmp_path / "p.json"), TARGETS, atol=0.5)
    content = json.loads(result["files"][0])
    assert (content["video"], content["width"], content["height"]) == ("a <swim>.mp4", WIDTH, HEIGHT)
    assert list(content["markers"]) == list(NAMES)


@pytest.mark.slow
def test_pinch_buttons_and_keys_zoom_as_well(play, tmp_path):
    result = play(
        """
        const [cx, cy] = middle(), touch = { pointerType: "touch" };
        for (const color of COLORS) {
          const [x, y] = await see(color);
          send("pointerdown", [x - 20, y], touch); send("pointerdown", [x + 20, y], { ...touch, pointerId: 2 });
          for (let i = 1; i <= 10; i++) {  // two fingers part and carry the disc to the middle
            const f = i / 10, mx = x + (cx - x) * f, my = y + (cy - y) * f;
            send("pointermove", [mx - 20 - 30 * f, my], touch);
            send("pointermove", [mx + 20 + 30 * f, my], { ...touch, pointerId: 2 });
          }
          send("pointerup", [cx - 50, cy], touch); send("pointerup", [cx + 50, cy], { ...touch, pointerId: 2 });
          press("closer"); key("+"); key("-"); press("closer"); press("farther");
          const p = await see(color);
          said.push(Math.hypot(p[0] - cx, p[1] - cy));
          click(p, touch);
          key("0");
        }
        press("download");
        """
    )
    np.testing.assert_allclose(points_of(result["files"][0], tmp_path / "p.json"), TARGETS, atol=0.5)
    assert max(result["said"]) < 8  # the discs did come to the middle


@pytest.mark.slow
def test_undo_and_moving(play, tmp_path):
    result = play(
        """
        const places = [];
        for (const color of COLORS) places.push(await see(color));
        const [a, b, c, d] = places;
        click(a); click([b[0] + 60, b[1]]); click(b);
        key("Backspace"); key("z", { ctrlKey: true });   // both are undone
        said.push(rows().join("|"));
        click(c); click(b);                               // M1 and M2 the wrong way round
        press("undo"); press("undo");
        click(b); click(c); click([d[0] - 90, d[1] - 80]);
        drag([d[0] - 90, d[1] - 80], d);                  // M3 is dragged to its place
        click(a); click([a[0] + 50, a[1] + 50]);          // M0 is clicked and put elsewhere …
        click([a[0] + 50, a[1] + 50]); click(a);          // … and back
        click([a[0] + 200, a[1]]);
        said.push(alert_());                              // there is nothing left to place
        press("download");
        """
    )
    assert result["said"][0].split("|")[1:] == ["next", "–", "–"]
    assert "All 4 are placed" in result["said"][1]
    np.testing.assert_allclose(points_of(result["files"][0], tmp_path / "p.json"), TARGETS, atol=1.0)


@pytest.mark.slow
def test_incomplete_points_and_two_on_the_same_spot_are_refused(play):
    result = play(
        """
        const places = [];
        for (const color of COLORS) places.push(await see(color));
        press("download"); said.push(alert_());
        click(places[0]); click(places[1]);
        press("download"); said.push(alert_());
        click([5, 5]); said.push(alert_());               // beside the frame
        click(places[2]); click(places[3]);
        drag(places[1], places[2]);
        press("download"); said.push(alert_());
        """
    )
    assert result["files"] == []
    parts = ("missing: M0, M1, M2, M3. Nothing was downloaded", "2 of 4 .*: M2, M3. Nothing was downloaded",
             "outside of the frame", "M1 and M2 are on the same spot: .*Nothing was downloaded")  # fmt: skip
    for part, said in zip(parts, result["said"], strict=True):
        assert re.search(part, said)


def test_the_page_is_one_file_that_holds_the_frame(page):
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"https?://|@@", text)
    assert "<title>Pick the markers of a &lt;swim&gt;.mp4" in text
    assert "a <swim>" not in text
    data = base64.b64decode(re.search(r'src="data:image/jpeg;base64,([^"]+)"', text).group(1))
    assert np.abs(np.asarray(Image.open(io.BytesIO(data))).astype(int) - first_frame()).mean() < 2
    assert [p.name for p in page.parent.iterdir()] == ["pick.html"]


def test_names_in_the_page_are_data_not_markup(tmp_path):
    path = write_pick_page(first_frame(), NAMES, "</script>@@DATA@@.mp4", tmp_path / "p.html", TARGETS)
    text = path.read_text(encoding="utf-8")
    assert text.count("</script>") == 2
    data = json.loads(re.search(r'id="data">(.*?)</script>', text).group(1))
    assert data["video"] == "</script>@@DATA@@.mp4"
    assert data["places"] == [0.0, 0.4011, 0.4561, 1.0]  # along the line through the markers
    text = write_pick_page(first_frame(), NAMES, "a\udcff\u202eb.mp4", tmp_path / "p.html").read_text("utf-8")
    assert "<h1>a\\udcff\\u202eb.mp4" in text
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}';" in text


@pytest.mark.parametrize("image", [np.zeros((4, 4)), np.zeros((4, 4, 4), np.uint8), np.zeros((0, 4, 3), np.uint8)])
def test_what_is_not_a_frame_or_place_is_refused(tmp_path, image):
    with pytest.raises(ArgumentError, match=r"it must be uint8 with shape \(H, W, 3\)"):
        write_pick_page(image, NAMES, "a.mp4", tmp_path / "p.html")
    with pytest.raises(TrackingError, match=r"can't write .*: No such file or directory; give a place .* with --out"):
        write_pick_page(first_frame(), NAMES, "a.mp4", tmp_path / "no" / "p.html")
    assert not list(tmp_path.iterdir())


def test_nothing_else_of_the_program_is_a_server():
    """The page is a file: no module listens, but that of `ui`, and Dask's scheduler for `compare --cluster local:N`."""
    package = Path(swim2real.__file__).parent
    listens = re.compile(
        r"http\.server|socketserver|_server\(|\.listen\(|\.bind\(|bind_sockets|webbrowser|LocalCluster\("
    )
    texts = {path.relative_to(package).as_posix(): path.read_text("utf-8") for path in package.rglob("*.py")}
    assert {name for name, text in texts.items() if listens.search(text)} == {"comparison/cluster.py", "ui/server.py"}


@pytest.mark.slow
def test_a_click_beside_the_middle_snaps_to_it_unless_it_is_not_wanted(play, tmp_path):
    result = play(
        """
        const places = [];
        for (const color of COLORS) places.push(await see(color));
        const beside = ([x, y]) => [x + 6, y - 4];   // on the disc, whose radius is 16 px of the screen here
        for (const p of places) click(beside(p));
        said.push(...rows());
        press("clear");
        for (const p of places) click(beside(p), { altKey: true });
        said.push(...rows());
        press("clear"); press("snap");
        for (const p of places) click(beside(p));
        said.push(...rows());
        press("clear"); press("snap");
        click([places[1][0] + 100, places[1][1] - 100]);   // plain water
        said.push(rows()[0]);
        """
    )
    rows = [np.array([list(map(float, row.split(", "))) for row in result["said"][k : k + 4]]) for k in (0, 4, 8)]
    np.testing.assert_allclose(rows[0], TARGETS, atol=0.15)
    offs = [np.linalg.norm(each - TARGETS, axis=1) for each in rows[1:]]
    assert np.min(offs) > 2
    np.testing.assert_array_equal(rows[1], rows[2])
    water = np.array(list(map(float, result["said"][12].split(", "))))
    assert np.linalg.norm(water - TARGETS[1]) > 30


@pytest.mark.slow
@pytest.mark.parametrize("gap", [4.0, 12.0])  # px; a disc has a radius of 7
def test_no_click_snaps_to_the_common_middle_of_two_discs(tmp_path, gap):
    targets = np.array([[100.0, 80.0], [300.0, 200.0], [300.0 + gap, 202.0], [600.0, 300.0]])
    page = write_pick_page(discs(targets, COLORS[:1] * 4, (HEIGHT, WIDTH)), NAMES, "a.mp4", tmp_path / "pick.html")
    result = played(
        page, tmp_path / "played.html", HAND,
        f"""
        const [cx, cy] = middle(), k = 0.98 * Math.min(2 * cx / {WIDTH}, 2 * cy / {HEIGHT});
        for (const [x, y] of {(targets - [WIDTH / 2, HEIGHT / 2]).tolist()})
          click([(x + 0.5) * k + cx + 1.5, (y + 0.5) * k + cy]);
        said.push(rows());
        """,
    )  # fmt: skip
    (rows,) = result["said"]
    off = np.linalg.norm(np.array([list(map(float, row.split(", "))) for row in rows]) - targets, axis=1)
    np.testing.assert_array_less(off, [0.15, 1.2, 1.2, 0.15])
