"""From films to a fit by clicks alone, in a real browser."""

import json
import re
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from live_page import FILM, Tunnel, serving, unpacked

from browser import browser
from markertrack.video import VideoWriter
from swim2real import open_run
from swim2real.demo.example import FILMS

playwright = pytest.importorskip("playwright.sync_api", reason="the page is clicked by Playwright; it isn't installed")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import stranger_by_clicks  # noqa: E402

LONG = 240_000  # ms: compiling is part of it on a fresh machine


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "pool").mkdir()
    for name in (FILM, "camera.json"):
        shutil.copy(FILMS / name, tmp_path / "pool" / name)
    return tmp_path / "pool"


@pytest.fixture
def page():
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=browser(), args=["--no-sandbox"])
        page = chromium.new_context(viewport={"width": 1280, "height": 900}).new_page()
        page.context.set_default_timeout(LONG)
        wrong, requests = [], []
        page.refused = wrong  # sentences of the server, of which one test expects one
        page.context.on("weberror", lambda error: wrong.append(str(error.error)))
        page.context.on(
            "response", lambda answer: answer.status in (400, 500) and wrong.append(f"{answer.status} {answer.url}")
        )
        page.context.on("request", lambda request: requests.append(request.url))
        yield page
        chromium.close()
        assert wrong == []
        assert all(url.startswith(("http://127.0.0.1:", "blob:http://127.0.0.1:")) for url in requests)


def clicked(page, place):
    """A click on a place of the film, when the whole film is shown."""
    box = page.locator("#stage canvas[tabindex]").bounding_box()
    k = min(box["width"] / 1280, box["height"] / 720) * 0.98
    x, y = (box["width"] - 1280 * k) / 2, (box["height"] - 720 * k) / 2
    page.mouse.click(box["x"] + x + (place[0] + 0.5) * k, box["y"] + y + (place[1] + 0.5) * k)


def slid(page, share):
    """A click on the first slider, once it stands still."""
    slider = page.locator("#sliders input").first
    box = slider.bounding_box()
    slider.click(position={"x": share * box["width"], "y": box["height"] / 2})


def shows(page, selector, text):
    playwright.expect(page.locator(selector)).to_contain_text(text, timeout=LONG)


@pytest.mark.slow
def test_from_a_film_to_a_fit_by_clicks(folder, page):
    with serving(folder) as server:
        page.goto(server.address)
        shows(page, "#status", "Click M0")
        for place in PLACES.values():
            clicked(page, (place[0] + 1.5, place[1] - 1.0))  # a hand, beside the middle
        shows(page, "#status", "All 9 are placed")
        for button, count in (("#undo", 8), (None, 9)):
            page.click(button) if button else clicked(page, place)
            page.wait_for_timeout(1000)
            saved = json.loads((folder / "f0_50.points.json").read_text())["markers"]
            assert len(saved) == count
        page.click("#track")
        shows(page, "#said", "241 frames")
        shows(page, "#status", "correction")
        shows(page, "#film", "✓")
        query = f"?film={FILM}&robot=fish&reference=reference&trial=f0_50"
        found = unpacked(server.call("film", query=query)["track"]["positions"], 241, 9)[0]
        off = np.linalg.norm(found - list(saved.values()), axis=1)
        assert np.median(off) < 0.3  # px: clicks have snapped to the middles

        page.click("#tofit")
        page.click("#tofilm")  # before the fit is there
        page.wait_for_timeout(3000)
        shows(page, "#status", "All 9 are placed")
        page.click("#tofit")
        shows(page, "#trials output", "mm")
        before = page.inner_text("#trials output")
        slid(page, 0.9)
        playwright.expect(page.locator("#trials output").first).not_to_have_text(before, timeout=LONG)
        page.click("#back")
        playwright.expect(page.locator("#trials output").first).to_have_text(before, timeout=LONG)

        page.click("#search")
        shows(page, "#progress", "mm")
        page.reload()
        shows(page, "#doing", "search from here, into fit-1")
        page.click("#stop")
        shows(page, "#said", "run fit-1:")
        playwright.expect(page.locator("#from")).to_have_value("fit-1")
        assert open_run(folder / "fit-1").outcome is not None
        page.click("[data-work=report]")
        shows(page, "#said", "report.html is written")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_strangers_robot_from_films_to_good_by_clicks_alone(tmp_path, page):
    folder = tmp_path / "pool"
    films = stranger_by_clicks.made(folder)
    with serving(folder) as server:
        page.goto(server.address)
        stranger_by_clicks.clicked(page, films, 0.0)
        shows(page, "#said", "run fit-1: Good: ")
        shows(page, "#verdict", "Good")
        shows(page, "#from", "fit-1")
    run = open_run(folder / "fit-1")
    assert run.outcome.verdict.title == "Good"
    assert run.outcome.fit.error < 1e-3  # m
    assert (folder / "fit-1/report.html").is_file()


def points_of(folder, count):
    """Points in the file, once so many are there."""
    for _ in range(100):
        with suppress(OSError, ValueError):
            markers = json.loads((folder / "f0_50.points.json").read_text())["markers"]
            if len(markers) == count:
                return markers
        time.sleep(0.1)
    raise AssertionError(markers)


PLACES = json.loads((FILMS / "f0_50.points.json").read_text())["markers"]


@pytest.mark.slow
def test_two_pages_lose_nothing_of_each_other(folder, page):
    places = list(PLACES.values())
    with serving(folder) as server:
        other = page.context.new_page()
        for one in (page, other):
            one.goto(server.address)
            shows(one, "#status", "Click M0")
        for place in places[:3]:
            clicked(page, place)
        points_of(folder, 3)
        shows(other, "#status", "Click M3")
        for place in places[3:6]:
            clicked(other, place)
        points_of(folder, 6)
        shows(page, "#status", "Click M6")
        clicked(page, places[6])
        page.reload()  # at once
        shows(page, "#status", "Click M7")
        for one in (page, other):
            shows(one, "#status", "Click M7")
        for one, number in ((page, 7), (other, 8)):  # at once
            one.click(f"#list li:nth-child({number + 1}) button")
            clicked(one, places[number])
        saved = points_of(folder, 9)
        assert np.abs(np.subtract([saved[name] for name in PLACES], places)).max() < 3  # px
        page.click("#track")
        for one in (page, other):
            shows(one, "#status", "correction")

        for one in (page, other):
            one.click("#tofit")
            shows(one, "#trials", "mm")
        slider = page.locator("#sliders input").first
        slid(page, 0.8)
        name, value = slider.get_attribute("name"), float(slider.input_value())
        shows(other, "#from", "sliders.json")
        page.reload()
        shows(page, "#trials", "mm")
        playwright.expect(page.locator("#from")).to_have_value("sliders.json")
        assert float(page.locator(f"#sliders input[name={name}]").input_value()) == pytest.approx(value, abs=2e-3)
        for one in (page, other):
            one.click("#keep")
        for one in (page, other):
            shows(one, "#note", "is written")
            shows(one, "#from", "values-2.json")
        page.click("#search")
        shows(other, "#doing", "search from here, into fit-1")
        other.click("#search")
        shows(other, "#alert", "one thing at a time")
        wrong = page.refused  # the other page was told so
        assert len(wrong) == 1
        wrong.clear()
        other.click("#stop")
        for one in (page, other):
            shows(one, "#said", "run fit-1:")
        shows(page, "#verdict", " ")
        assert open_run(folder / "fit-1").outcome is not None


@pytest.mark.slow
@pytest.mark.parametrize("how", ["cut", "silent"])
def test_a_lost_tunnel_loses_nothing(folder, page, how):
    places = list(PLACES.values())
    with serving(folder) as server, Tunnel(server.port) as tunnel:
        page.goto(re.sub(":[0-9]+/", f":{tunnel.port}/", server.address))
        shows(page, "#status", "Click M0")
        for place in places[:3]:
            clicked(page, place)
        points_of(folder, 3)
        tunnel.state = how
        for place in places[3:6]:
            clicked(page, place)
        shows(page, "#alert", "The server doesn't answer")
        points_of(folder, 3)
        tunnel.state = "open"
        points_of(folder, 6)
        playwright.expect(page.locator("#alert")).to_be_empty(timeout=LONG)
        tunnel.state = how
        clicked(page, places[6])
        shows(page, "#alert", "The server doesn't answer")
        tunnel.state = "open"
        page.reload()
        points_of(folder, 7)
        shows(page, "#status", "Click M7")
        for place in places[7:]:
            clicked(page, place)
        points_of(folder, 9)
        page.click("#track")
        shows(page, "#status", "correction")
        page.click("#tofit")
        shows(page, "#trials output", "mm")
        before = page.inner_text("#trials output")
        tunnel.state = how
        slid(page, 0.9)
        shows(page, "#alert", "The server doesn't answer")
        tunnel.state = "open"
        playwright.expect(page.locator("#trials output").first).not_to_have_text(before, timeout=LONG)
        playwright.expect(page.locator("#alert")).to_be_empty(timeout=LONG)
        shows(page, "#from", "sliders.json")


@pytest.mark.slow
def test_a_page_goes_on_with_the_address_of_a_new_start(folder, page):
    with serving(folder) as first, Tunnel(first.port) as tunnel, serving(folder) as second:
        page.goto(re.sub(":[0-9]+/", f":{tunnel.port}/", first.address))
        shows(page, "#status", "Click M0")
        for place in list(PLACES.values())[:3]:
            clicked(page, place)
        points_of(folder, 3)
        tunnel.state = "cut"
        shows(page, "#alert", "doesn't answer")
        tunnel.state, tunnel.to = "open", second.port
        clicked(page, PLACES["M3"])
        shows(page, "#alert", "open the one of now")
        page.evaluate("token => { location.hash = token; }", second.token)  # as it is pasted
        points_of(folder, 4)
        playwright.expect(page.locator("#alert")).to_be_empty(timeout=LONG)


@pytest.mark.slow
def test_a_page_without_the_secret_says_so(folder, page):
    with serving(folder) as server:
        page.goto(server.address.split("#")[0])
        shows(page, "#alert", "open the one of now")


BITS = 8


def numbered(path, codec):
    """A film whose frames show their numbers as black and white fields."""
    with VideoWriter(path, 640, 360, 30, codec, crf=30) as writer:
        for number in range(120):
            image = np.zeros((360, 640, 3), np.uint8)
            for bit in range(BITS):
                image[:, 80 * bit : 80 * (bit + 1)] = 255 * (number >> bit & 1)
            writer.write(image)


READ = """async () => {   // what has been said for a whole picture of the screen, and what is drawn
  const said = () => document.querySelector("#at").textContent, next = () => new Promise(requestAnimationFrame);
  for (let before = null; before !== said(); await next()) before = await next().then(said);
  const canvas = document.createElement("canvas"), { width, height } = document.querySelector("#picture");
  Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  pen.drawImage(document.querySelector("#picture"), 0, 0);
  const k = 0.98 * Math.min(width / 640, height / 360), left = (width - 640 * k) / 2;
  let number = 0;
  for (let bit = 0; bit < 8; bit++)
    if (pen.getImageData(left + (80 * bit + 40) * k, height / 2, 1, 1).data[0] > 127) number += 1 << bit;
  return [said(), number];
}"""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "codec"), [("swim.mp4", "h264"), ("swim.avi", "mjpeg")])
def test_a_film_plays_in_the_browser_and_frame_by_frame_where_that_cannot(folder, page, name, codec):
    for film in folder.glob("*.mp4"):
        film.unlink()
    numbered(folder / name, codec)
    with serving(folder) as server:
        page.goto(server.address)
        shows(page, "#at", "0 · 0.00 s")
        page.click("#play")
        seen = {}
        for _ in range(100):
            page.wait_for_timeout(50)
            said, number = page.evaluate(READ)
            seen[int(said.split()[0])] = number
            if len(seen) > 8:
                break
        assert len(seen) > 8
        assert all(said == number for said, number in seen.items()), seen
        page.click("#play")
        page.wait_for_timeout(500)
        said, number = page.evaluate(READ)
        assert int(said.split()[0]) == number
        names = page.evaluate("performance.getEntriesByType('resource').map(one => one.name)")
        assert (sum("/api/frame" in one for one in names) < 5) == (codec == "h264"), names
