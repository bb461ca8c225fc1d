"""The docs' film of the live page, by clicks alone: `python benchmarks/film_of_page.py RAW OUT.mp4 [MINUTES]`.

RAW gets the pictures of the screen, named by their milliseconds and the factor that they are sped up by; a folder that
is there is only cut anew. After MINUTES (12) *Stop here* ends the search.
"""

import json
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from live_page import opened
from PIL import Image, ImageDraw

from markertrack.video import VideoWriter
from swim2real.demo.example import FILMS

RAW, OUT, MINUTES = Path(sys.argv[1]), Path(sys.argv[2]), float((*sys.argv, 12)[3])
RATE, FILM = 12, np.array([1280, 720])
POINTER = """addEventListener("load", () => {   // a headless browser shows none
  const dot = document.createElement("output"), size = "left: -11px; top: -11px; width: 22px; height: 22px";
  dot.style.cssText = `position: fixed; ${size}; border-radius: 11px; pointer-events: none; background: #ffd400b0`;
  document.body.append(dot);
  addEventListener("pointermove", ({ x, y }) => { dot.style.translate = `${x}px ${y}px`; }, true);
});"""


def rest(seconds, factor=1):
    end = time.monotonic() + seconds
    while (now := time.monotonic()) < end:
        page.screenshot(path=RAW / f"{round(1000 * now):012d}-{factor}.jpg", quality=90)
        page.wait_for_timeout(1000 * max(min(now + factor / RATE, end) - time.monotonic(), 0.01))


def wait(selector, text, factor, seconds=600.0):
    end = time.monotonic() + seconds
    while not (there := text in page.text_content(selector)) and time.monotonic() < end:
        rest(max(0.3, factor / RATE), factor)
    return there


def press(x, y):
    page.mouse.move(x, y, steps=8)
    rest(0.3)
    page.mouse.click(x, y)
    rest(0.3)


def click(selector):
    page.locator(selector).scroll_into_view_if_needed()
    x, y, width, height = page.locator(selector).bounding_box().values()
    press(x + width / 2, y + height / 2)


def mark(name):
    """The markers of a film clicked and tracked."""
    page.select_option("#film", f"{name}.mp4")
    wait("#status", "Click M0", 4)
    places = np.array(list(json.loads((FILMS / f"{name}.points.json").read_text())["markers"].values()))
    x, y, *size = page.locator("#stage canvas[tabindex]").bounding_box().values()
    scale, near = 0.98 * (size / FILM).min(), places.mean(axis=0)  # as the whole film is shown
    middle = (x, y) + np.divide(size, 2) + (near + 0.5 - FILM / 2) * scale
    page.mouse.move(*middle, steps=8)
    for _ in range(5):  # each enlarges by exp(0.24)
        page.mouse.wheel(0, -120)
        rest(0.25)
    for place in np.add(places, (0.8, -0.5)):  # a hand, beside the middle
        press(*(middle + (place - near) * scale * np.exp(5 * 0.24)))
    click("#fit")
    click("#track")
    wait("#track", "Track again", 4)


def drag(number, *shares):
    slider = page.locator("#sliders input").nth(number)
    slider.evaluate("one => one.scrollIntoView({ block: 'center' })")
    x, y, width, height = slider.bounding_box().values()
    stops = [float(slider.input_value()), *shares]
    for k, share in enumerate(np.interp(np.linspace(0, len(shares), 30), range(len(stops)), stops)):
        page.mouse.move(x + 8 + share * (width - 16), y + height / 2)
        if k == 0:
            page.mouse.down()
        rest(0.15)
    page.mouse.up()
    rest(1.2)


if not RAW.is_dir():
    RAW.mkdir()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "pool")
        folder.mkdir()
        for file in ("f0_50.mp4", "f1_50.mp4", "camera.json"):
            shutil.copy(FILMS / file, folder)
        with opened(str(folder), 800, POINTER) as (page, _):
            mark("f0_50")
            mark("f1_50")
            click("#tofit")
            wait("#trials", "mm", 8)
            drag(0, 0.3, 0.7)
            drag(2, 0.75, 0.4)
            click("#search")
            page.mouse.wheel(0, -9000)
            rest(3)
            if not wait("#said", "run fit-1:", 10, 60 * MINUTES):
                click("#stop")
                wait("#said", "run fit-1:", 10)
            rest(3)
            click("#play")
            rest(4)
seconds, before, last = 0.0, None, -1
with VideoWriter(OUT, 1280, 800, RATE, crf=26) as writer:
    for file in sorted(RAW.glob("*.jpg")):
        moment, factor = map(int, file.stem.split("-"))
        seconds, before = seconds + (moment - (before or moment)) / 1000 / factor, moment
        if int(seconds * RATE) > last:
            last, picture = int(seconds * RATE), Image.open(file)
            ImageDraw.Draw(picture).text((20, 16), f"{factor} x" * (factor > 1), "black", font_size=30)
            writer.write(np.asarray(picture), last / RATE)
